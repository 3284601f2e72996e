"""Time offsets, frame rates and drift of the cameras' clocks.

Imports `people` and below.
"""
