"""Fields of values that a file leaves out while they are None."""

from __future__ import annotations

ABSENT = {"absent": True}
"""Metadata of a field that is left out of a file while it is None."""
