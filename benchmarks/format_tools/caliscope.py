"""Caliscope's camera_array.toml, by caliscope; points are projected as its bundle adjustment does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from format_tools.case import Case

TOOL = "caliscope"
ENVIRONMENT = "caliscope"
PACKAGES = ("caliscope==0.11.8",)
NEEDS = ()


def check(folder: Path) -> float:
    """The largest difference in pixels."""
    import cv2
    from caliscope.cameras.camera_array import CameraArray
    from caliscope.core.reprojection import project_points

    case = Case.read(folder)
    array = CameraArray.from_toml(case.target)
    projected = []
    for index, number in enumerate(sorted(array.posed_cameras)):
        camera = array.cameras[number]
        turned, moved = cv2.Rodrigues(camera.rotation)[0], np.asarray(camera.translation)
        lens = camera.matrix, camera.distortions
        projected.append(np.asarray(project_points(case.seen(index), turned, moved, *lens, camera.fisheye)))
    case.back.parent.mkdir(exist_ok=True)
    array.to_toml(case.back)
    return case.largest(projected)
