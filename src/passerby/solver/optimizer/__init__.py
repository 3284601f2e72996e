"""Sparse least squares with people and instants eliminated, and the bundle adjustment of points.

Imports `geometry` and `core`.
"""
