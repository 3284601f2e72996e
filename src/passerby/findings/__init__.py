"""Findings: what contradicts a calibration or is odd about its input, as values; the register of codes; their sentences.

The one place where sentences about findings are made. Imports `common` only.
"""
