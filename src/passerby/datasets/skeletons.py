"""3D joints as published, and what follows from them: joints in the pictures, and where people stood.

The joints in the pictures are projections of the 3D ones through the published cameras, and so fit these exactly: they measure
what a calibration makes of the layout of cameras and people, not of a detector's errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera, Floats, Rig
from passerby.datasets.published import GroundTruth
from passerby.errors import InputError
from passerby.observations import UNKNOWN, Ints, Keypoints

PROJECTED = (
    "Joints are the set's 3D joints, projected through its cameras: free of noise, and there also where somebody else stands "
    "in front. Run a detector on the pictures for joints as they would be found."
)
BETWEEN_ANKLES = "Ground positions are the middle between the ankles; where an ankle is missing there is none."
RAY_TOLERANCE = 1e-4
"""A distortion polynomial can fold points far outside back into the picture; the ray of such a pixel is another one."""
HEADS, ANKLES = ("nose", "head_top"), ("left_ankle", "right_ankle")


@dataclass(frozen=True, eq=False)
class Skeletons:
    """The 3D joints of N people at instants."""

    frame: Ints
    """(N,) from 1."""
    identity: Ints
    """(N,) true ids, or -1."""
    xyz: Floats
    """(N, J, 3) metres, z up; meaningless where the score is 0."""
    score: Floats
    """(N, J) confidence from 0 to 1; 0 for a joint that is not known."""
    joints: tuple[str, ...]


def projected(rig: Rig, skeletons: Skeletons, place: str) -> dict[str, Keypoints]:
    """The joints of every camera's picture; people with none are left out.

    Raises `InputError` where no camera has any joint in its picture; `place` is the file of the joints.
    """
    found = {camera.name: _in_camera(camera, skeletons) for camera in rig}
    if len(skeletons.frame) and not any(len(people) for people in found.values()):
        raise InputError(
            f"{place}: none of the {len(skeletons.frame)} people lies in the picture of any camera: joints and calibration are "
            "not of one recording, or in different units; take both from the set again"
        )
    return found


def ground_under(skeletons: Skeletons) -> GroundTruth:
    """Where people of known identity stood: the middle between their ankles."""
    at = [skeletons.joints.index(name) for name in ANKLES]
    rows = (skeletons.score[:, at] > 0).all(axis=1) & (skeletons.identity != UNKNOWN)
    return GroundTruth(skeletons.frame[rows], skeletons.identity[rows], skeletons.xyz[rows][:, at, :2].mean(axis=1))


def check_upright(skeletons: Skeletons, place: str) -> None:
    """That heads are above feet. Raises `InputError` where in most people they are not."""
    ankles = [skeletons.joints.index(name) for name in ANKLES]
    head = next(skeletons.joints.index(name) for name in HEADS if name in skeletons.joints)
    known = (skeletons.score[:, [*ankles, head]] > 0).all(axis=1)
    height = skeletons.xyz[known, head, 2] - skeletons.xyz[known][:, ankles, 2].mean(axis=1)
    if len(height) and np.median(height) < 0:
        raise InputError(
            f"{place}: the heads of the people lie {-float(np.median(height)):.2f} m below their ankles: the axes are not "
            "those of the set as published; take calibration and joints from the set again"
        )


def _in_camera(camera: Camera, skeletons: Skeletons) -> Keypoints:
    pixels = camera.project(skeletons.xyz.reshape(-1, 3)).reshape(*skeletons.score.shape, 2)
    seen = (skeletons.score > 0) & _inside(camera, pixels)
    seen[seen] = _same_ray(camera, skeletons.xyz[seen], pixels[seen])
    rows = seen.any(axis=1)
    xy = np.where(seen[..., None], pixels, 0.0)[rows]
    score = np.where(seen, skeletons.score, 0.0)[rows]
    return Keypoints(skeletons.frame[rows], skeletons.identity[rows], xy, score, skeletons.joints)


def _inside(camera: Camera, pixels: Floats) -> NDArray[np.bool_]:
    """(...) whether pixels lie in the picture; not where they are NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= -0.5) & (pixels <= np.array(camera.lens.size) - 0.5)).all(axis=-1))


def _same_ray(camera: Camera, points: Floats, pixels: Floats) -> NDArray[np.bool_]:
    """(K,) whether the pixels' rays lead back to the points."""
    away = points - camera.centre
    assert camera.pose is not None
    true = away / np.linalg.norm(away, axis=1, keepdims=True) @ camera.pose.R_cw.T
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.norm(camera.lens.bearings(pixels) - true, axis=1) < RAY_TOLERANCE)
