"""Geometry of rays, poses and points: arrays in, arrays out, with no notion of a camera's lens or of a person.

Uses numpy, scipy and PoseLib; imports `common` only.
"""
