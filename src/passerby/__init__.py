"""Passerby: the poses of a camera network from the people who walk through its view."""

__version__ = "0.1.0"
