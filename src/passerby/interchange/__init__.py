"""Files: boxes, joints, rigs, lenses, trajectories, the output folder, and in `formats/` the files of other tools.

All input is checked here. This package imports `core` and below. `storage/` has the code that is independent of the content.
"""
