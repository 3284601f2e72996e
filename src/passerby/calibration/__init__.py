"""A calibration from its inputs to its folder: `pipeline` is the order of the stages.

The one room that knows association and solver both. `diagnostics/` finds what speaks against a result, `alignment/` sets the
world. Imports all rooms below but `simulation`.
"""
