"""A calibration from its inputs to its folder: `pipeline` is the order of the stages.

The one room that knows association and solver both. `diagnostics/` finds problems of a result, `alignment/` sets the
world. Imports all rooms below but `simulation`.
"""
