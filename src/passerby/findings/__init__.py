"""Findings, which are evidence against a calibration or unusual facts about its input; the register of codes; their sentences.

Sentences about findings are made only in this package. It imports `common` only.
"""
