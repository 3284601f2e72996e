"""Training, adaptation to a scene, evaluation and export of re-ID networks. Only this package imports torch (extra `reid`).

Only some modules import torch, and commands import them when they run. This package imports `calibration` and lower packages.
"""
