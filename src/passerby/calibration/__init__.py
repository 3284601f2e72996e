"""A calibration from its inputs to its folder: `calibrate` is the whole of it in stages.

The only room that imports both association and solver. `diagnostics/` checks a result, `alignment/` sets the world. Imports all
rooms below but `simulation`.
"""
