"""Crops of people for training: from folders, published data sets, and scenes.

This package may import the same packages as `training`.
"""

from passerby.training.data.reading import read_all, read_data

__all__ = ["read_all", "read_data"]
