"""Sparse least squares that eliminates people and instants, and the bundle adjustment of points.

Imports `geometry` and `core`.
"""
