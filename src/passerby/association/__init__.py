"""From observations to identities and clocks: who in one camera is who in another, and at what time.

`tracking/` within one camera; `appearance/`, `ground/`, `joints/` between cameras; `clocks/`. Imports `people` and below, and
no solver: only `calibration` knows both.
"""
