"""People's trajectories in the world, through all cameras of a rig that is known.

Callers use the module `trajectories`. Imports `people` and below.
"""
