"""OpenCV's files, by cv2.FileStorage and OpenCV's projections."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from format_tools.case import Case

TOOL = "opencv-python-headless"
ENVIRONMENT = "opencv4"
# The other versions are tried by Passerby itself, which runs on OpenCV 5.
PACKAGES = ("opencv-python-headless==4.10.0.84",)
NEEDS = ("numpy",)


def check(folder: Path) -> float:
    """The largest difference in pixels."""
    import cv2

    case = Case.read(folder)
    cameras = {}
    for path in case.target.iterdir():
        storage = cv2.FileStorage(str(path), cv2.FileStorage_READ)
        cameras[storage.getNode("camera_name").string()] = {
            **{key: storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients", "R", "T")},
            "fisheye": storage.getNode("fisheye_model").real() == 1,
        }
        storage.release()
    projected = []
    for index, name in enumerate(case.names):
        camera, points = cameras[name], case.seen(index).reshape(-1, 1, 3)
        project = cv2.fisheye.projectPoints if camera["fisheye"] else cv2.projectPoints
        turned = cv2.Rodrigues(camera["R"])[0]
        lens = camera["camera_matrix"], camera["distortion_coefficients"]
        projected.append(np.asarray(project(points, turned, camera["T"], *lens)[0]))
    return case.largest(projected)
