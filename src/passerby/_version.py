"""The version of Passerby, for modules that write it into files."""

__version__ = "0.1.0"
