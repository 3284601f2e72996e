"""Geometry of rays, poses and points: pure numpy and PoseLib, no files and no solver."""
