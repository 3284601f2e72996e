"""Monitoring of a rig in use: it finds the cameras that have moved since the calibration.

It is on the level of `calibration`, and does not import it.
"""
