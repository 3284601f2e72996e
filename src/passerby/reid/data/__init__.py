"""Sets of pictures of people: published ones, folders, and crops cut out of videos by tracks."""

from passerby.reid.data.reading import read_all, read_data

__all__ = ["read_all", "read_data"]
