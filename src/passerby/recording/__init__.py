"""From streams to files: all cameras of a site recorded at once, packets as they come, in pieces that are whole.

Stands beside `calibration` and does not know it.
"""
