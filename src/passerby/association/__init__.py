"""From observations to identities and clocks: the same people in different cameras, and the cameras' time offsets.

`tracking/` within one camera; `appearance/`, `ground/`, `joints/` between cameras; `clocks/`. Imports `people` and below, and
no solver: only `calibration` knows both.
"""
