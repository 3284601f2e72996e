"""Recording of streams: all cameras of a site at once, packets unchanged, into complete files (pieces).

This package is independent of `calibration` and does not import it.
"""
