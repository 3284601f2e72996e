"""`passerby init`: a scene file from a folder of videos, tracks and lenses.

Imports the scene's tables, `perception` for videos, `interchange` for lenses.
"""
