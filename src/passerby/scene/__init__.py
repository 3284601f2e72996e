"""The scene file that a user writes, its inputs, and all checks that need no calibration.

`start/` writes a scene file from a folder. This package imports `perception`, `association`, `people`, `interchange` and lower
packages.
"""
