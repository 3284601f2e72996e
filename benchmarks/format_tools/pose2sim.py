"""Pose2Sim's Calib.toml, by its own reader, projected as its triangulation does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from format_tools.case import Case

TOOL = "pose2sim"
ENVIRONMENT = "pose2sim"
PACKAGES = ("pose2sim==0.10.49",)
# Of what it depends on only what its reader imports: OpenSim is not on PyPI's index, the rest are gigabytes.
WITHOUT = True
NEEDS = ("rtoml", "numpy", "opencv-python-headless", "matplotlib", "pandas", "scipy", "c3d", "anytree", "mpl_interactions")


def check(folder: Path) -> float:
    """The largest difference in pixels."""
    import cv2
    from Pose2Sim.common import retrieve_calib_params

    case = Case.read(folder)
    found = retrieve_calib_params(case.target)
    projected = [
        np.asarray(cv2.projectPoints(case.seen(index), *lens)[0])
        for index, lens in enumerate(zip(found["R"], found["T"], found["K"], found["dist"], strict=True))
    ]
    return case.largest(projected)
