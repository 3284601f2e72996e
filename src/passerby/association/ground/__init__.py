"""Registration of pairs of cameras by the tracks of people on the ground.

Imports `people` and below.
"""
