"""Registration of pairs of cameras by people's joints.

Imports `people` and below.
"""
