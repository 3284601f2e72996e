"""What people's appearance says about their identity, and how much that is worth in a scene.

Imports `people` and below.
"""
