"""Re-ID networks: trained, adapted to a scene, evaluated, exported. The only room that imports torch (extra `reid`).

Only the modules that import torch need it, and commands import one of them when they run. Imports `calibration` and below.
"""
