"""Tracklets within one camera: linking, stitching and splitting.

Imports `people` and below.
"""
