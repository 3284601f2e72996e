"""Files: boxes, joints, rigs, lenses, trajectories, the output folder, and in `formats/` those of other tools.

Everything that is read is checked here. Imports `core` and below; what handles files as such lives in `storage/`.
"""
