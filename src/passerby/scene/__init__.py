"""What a user declares, and what follows from it: the scene file, its inputs, and all checks that need no calibration.

`start/` writes a scene file from a folder. Imports `perception`, `association`, `people`, `interchange` and below.
"""
