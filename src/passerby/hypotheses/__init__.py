"""Hypotheses about faults of a calibration's inputs, and one test that compares them with the inputs as stated.

It may import `solver` and the packages below it.
"""
