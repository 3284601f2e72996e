"""Evidence against a result: moved cameras, missed people, walking speed, uneven ground; and the verdict.

Imports what `calibration` may.
"""
