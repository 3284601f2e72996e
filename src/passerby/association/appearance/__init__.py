"""Evidence of people's appearance on their identity, and its reliability in a scene.

Imports `people` and below.
"""
