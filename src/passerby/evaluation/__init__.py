"""How far a result is from the truth: rigs, trajectories, re-ID, and reprojection.

The only room that sees the truth. Imports `interchange`, `people` and below.
"""
