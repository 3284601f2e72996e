"""COLMAP's binary models, by pycolmap."""

from __future__ import annotations

from pathlib import Path

from format_tools import colmap

TOOL, ENVIRONMENT, PACKAGES, NEEDS = colmap.TOOL, colmap.ENVIRONMENT, colmap.PACKAGES, colmap.NEEDS


def check(folder: Path) -> float:
    """The largest difference in pixels."""
    return colmap.check(folder, binary=True)
