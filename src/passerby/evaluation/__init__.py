"""Errors of results against the truth: rigs, trajectories, re-ID, and reprojection.

Only this package compares results with the truth. It imports `interchange`, `people` and lower packages.
"""
