"""All that may be wrong with what a calibration was given, one small class each, and one test that compares them with the
inputs as stated.

Imports `solver` and below.
"""
