"""A calibration, from its inputs to its output folder: `calibrate` has all stages.

This is the only package that imports both `association` and `solver`. `diagnostics/` checks a result, `alignment/` sets the
world frame. It may import all packages below it except `simulation`.
"""
