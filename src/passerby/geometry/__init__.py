"""Geometry of rays, poses and points: functions of arrays that do not know the camera's lens or the person.

Uses numpy, scipy and PoseLib; imports `common` only.
"""
