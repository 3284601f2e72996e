"""A rig in use: which cameras have moved since it was calibrated.

Stands beside `calibration` and does not know it.
"""
