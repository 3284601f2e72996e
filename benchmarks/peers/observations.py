"""Points of what the cameras saw: a box's centre, its top and bottom, or a skeleton's joints, the same table for every peer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from passerby.core.cameras import Lens, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.solver.geopose.correspondences import BOTTOM, CENTRE, TOP, ImagePoints, box_points, joint_points
from peers.protocol import Points

Kind = Literal["centre", "top+bottom", "joints"]
BOX_PARTS: Mapping[Kind, tuple[int, ...]] = {"centre": (CENTRE,), "top+bottom": (TOP, BOTTOM)}
COEFFICIENTS = 5
"""Of OpenCV's distortion that every peer takes: k1, k2, p1, p2, k3."""


def points_of(rig: Rig, seen: Mapping[str, CameraObservations], kind: Kind) -> Points:
    """All points that two cameras or more saw.

    They are picked as Passerby's own are: whole boxes only, joints of a confidence of 0.3 at least. A peer would suffer from
    the others more than Passerby does.
    """
    observations = Observations(seen)
    found = joint_points(rig, observations) if kind == "joints" else box_points(rig, observations, BOX_PARTS[kind])
    label, _ = found.labels()
    found = found.take(np.bincount(label, minlength=1)[label] >= 2)
    part = np.unique(found.part, return_inverse=True)[1].reshape(-1)
    return Points(
        names=np.array(rig.names),
        size=np.array([camera.lens.size for camera in rig]),
        matrix=np.array([camera.lens.matrix for camera in rig]),
        distortions=np.array([_coefficients(camera.lens) for camera in rig]),
        camera=found.camera,
        person=found.identity,
        instant=found.frame,
        part=found.part if kind == "joints" else part,
        pixel=found.pixel,
        undistorted=_undistorted(rig, found),
        score=_scores(rig, seen, found) if kind == "joints" else np.ones(len(found)),
    )


def _coefficients(lens: Lens) -> np.ndarray:
    if lens.fisheye or lens.distortions[COEFFICIENTS:].any():
        raise ValueError("the peers' table has room for pinhole lenses of five coefficients only")
    return np.concatenate([lens.distortions, np.zeros(COEFFICIENTS)])[:COEFFICIENTS]


def _undistorted(rig: Rig, found: ImagePoints) -> np.ndarray:
    """(M, 2) pixels of the same rays through a lens of the same matrix without distortion."""
    pixels = np.zeros((len(found), 2))
    for index, camera in enumerate(rig):
        rows = found.camera == index
        pixels[rows] = Lens(camera.lens.size, camera.lens.matrix, np.zeros(0)).project_rays(found.bearing[rows])
    return pixels


def _scores(rig: Rig, seen: Mapping[str, CameraObservations], found: ImagePoints) -> np.ndarray:
    """(M,) confidences of joints."""
    scores = np.zeros(len(found))
    for index, camera in enumerate(rig):
        people = seen[camera.name].keypoints
        row_of = {key: row for row, key in enumerate(zip(people.identity.tolist(), people.frame.tolist(), strict=True))}
        rows = np.flatnonzero(found.camera == index)
        people_rows = [row_of[key] for key in zip(found.identity[rows].tolist(), found.frame[rows].tolist(), strict=True)]
        scores[rows] = people.score[people_rows, found.part[rows]] if len(rows) else 0.0
    return scores
