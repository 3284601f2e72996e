"""The world's frame: from known points and positions, a plan, or a scene file's wishes; and a folder moved into it.

Imports what `calibration` may.
"""
