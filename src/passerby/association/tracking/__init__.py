"""Tracklets within one camera: linked, stitched and split.

Imports `people` and below.
"""
