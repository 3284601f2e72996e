"""A calibrated rig in use: has a camera moved since, which, when and by how much."""
