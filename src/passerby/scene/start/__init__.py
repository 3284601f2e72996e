"""`passerby init`: makes a scene file from a folder of videos, tracks and lenses.

This package imports the scene's tables, `perception` for videos, and `interchange` for lenses.
"""
