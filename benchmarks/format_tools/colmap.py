"""COLMAP's text models, by pycolmap."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from format_tools.case import Case

TOOL = "pycolmap"
ENVIRONMENT = "colmap"
PACKAGES = ("pycolmap==4.2.1",)
NEEDS = ("numpy",)


def check(folder: Path, binary: bool = False) -> float:
    """The largest difference in pixels; COLMAP counts from the corner of the first pixel."""
    import pycolmap

    case = Case.read(folder)
    model = pycolmap.Reconstruction(str(case.target))
    images = [model.images[number] for number in sorted(model.images)]
    projected = [np.array([image.project_point(point) for point in case.seen(i)]) - 0.5 for i, image in enumerate(images)]
    case.back.mkdir(parents=True, exist_ok=True)
    (model.write_binary if binary else model.write_text)(str(case.back))
    return case.largest(projected)
