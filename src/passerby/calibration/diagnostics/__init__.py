"""Evidence against a result: the up direction, uneven ground, smaller pictures; and the verdict.

It may import the same packages as `calibration`.
"""
