"""Pairs of cameras registered by the tracks of people on the ground.

Imports `people` and below.
"""
