"""People's trajectories in the world, through all cameras of a rig that is known.

`trajectories` is the way in. Imports `people` and below.
"""
