"""The world frame of a rig by cameras, known points, known positions, a plan, marked lines or a scene file.

Also moves an output folder into another frame. It may import the same packages as `calibration`.
"""
