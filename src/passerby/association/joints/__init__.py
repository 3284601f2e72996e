"""Pairs of cameras registered by people's joints.

Imports `people` and below.
"""
