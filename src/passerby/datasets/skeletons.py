"""3D joints as published, joints in the pictures by projection, and positions of people on the ground.

The joints in the pictures are projections of the 3D joints through the published cameras, and fit these exactly. They test a
calibration on the layout of cameras and people, without a detector's errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import UNKNOWN, Keypoints
from passerby.datasets.published import GroundTruth

PROJECTED = (
    "Keypoints are the set's 3D keypoints, projected through its cameras: without noise, also for people who are occluded. "
    "Run a detector on the images for realistic keypoints."
)
BETWEEN_ANKLES = "Ground positions are the middle between the ankles; where an ankle is missing there is none."
BORDER_POINTS = 50
"""Number of points on each side of the picture, for the largest angle from its axis that a camera sees."""
HEADS, ANKLES = ("nose", "head_top"), ("left_ankle", "right_ankle")


@dataclass(frozen=True, eq=False)
class Skeletons:
    """3D joints in N rows, each of one person at one instant."""

    frame: Ints
    """(N,) frame numbers from 1."""
    identity: Ints
    """(N,) true ids, or -1."""
    xyz: Floats
    """(N, J, 3) metres, z up; meaningless where the score is 0."""
    score: Floats
    """(N, J) confidence from 0 to 1; 0 for a joint that is not known."""
    joints: tuple[str, ...]


def project_joints(rig: Rig, skeletons: Skeletons, place: str) -> dict[str, Keypoints]:
    """Project the joints into the picture of each camera; people without any joint in it are left out.

    Raises `InputError` if no camera has any joint in its picture; `place` is the file of the joints.
    """
    found = {camera.name: _project_joints(camera, skeletons) for camera in rig}
    if len(skeletons.frame) and not any(len(people) for people in found.values()):
        raise InputError(
            f"{place}: none of the {len(skeletons.frame)} people lies in the image of any camera: keypoints and calibration "
            "are not of one recording, or in different units; take both from the set again"
        )
    return found


def ground_under(skeletons: Skeletons) -> GroundTruth:
    """Compute the positions of people of known identity on the ground: the middle between their ankles."""
    at = [skeletons.joints.index(name) for name in ANKLES]
    rows = (skeletons.score[:, at] > 0).all(axis=1) & (skeletons.identity != UNKNOWN)
    return GroundTruth(skeletons.frame[rows], skeletons.identity[rows], skeletons.xyz[rows][:, at, :2].mean(axis=1))


def check_upright(skeletons: Skeletons, place: str) -> None:
    """Check that heads are above feet. Raises `InputError` if the median height of a head above the ankles is negative."""
    ankles = [skeletons.joints.index(name) for name in ANKLES]
    head = next(skeletons.joints.index(name) for name in HEADS if name in skeletons.joints)
    known = (skeletons.score[:, [*ankles, head]] > 0).all(axis=1)
    height = skeletons.xyz[known, head, 2] - skeletons.xyz[known][:, ankles, 2].mean(axis=1)
    if len(height) and np.median(height) < 0:
        raise InputError(
            f"{place}: the heads of the people lie {-float(np.median(height)):.2f} m below their ankles: the axes are not "
            "those of the set as published; take calibration and keypoints from the set again"
        )


def _project_joints(camera: Camera, skeletons: Skeletons) -> Keypoints:
    """Project the joints into one camera's picture."""
    assert camera.pose is not None
    points = skeletons.xyz.reshape(-1, 3) @ camera.pose.R_cw.T + camera.pose.t_cw
    pixels = camera.lens.project_rays(points)
    with np.errstate(all="ignore"):
        inside = ((pixels >= -0.5) & (pixels <= np.array(camera.lens.size) - 0.5)).all(axis=1)
        inside &= np.hypot(points[:, 0], points[:, 1]) <= _reach(camera.lens) * points[:, 2]
    seen = (skeletons.score > 0) & inside.reshape(skeletons.score.shape)
    rows = seen.any(axis=1)
    xy = np.where(seen[..., None], pixels.reshape(*seen.shape, 2), 0.0)[rows]
    score = np.where(seen, skeletons.score, 0.0)[rows]
    return Keypoints(skeletons.frame[rows], skeletons.identity[rows], xy, score, skeletons.joints)


def _reach(lens: Lens) -> float:
    """Return the tangent of the largest angle from its axis that a pinhole lens sees, by the picture's border.

    A distortion polynomial can fold points at larger angles back into the picture.
    """
    along = np.linspace(0.0, 1.0, BORDER_POINTS)
    sides = [np.column_stack(side) for end in (0.0, 1.0) for side in ((along, 0 * along + end), (0 * along + end, along))]
    rays = lens.bearings(np.vstack(sides) * np.array(lens.size) - 0.5)
    return float(np.nanmax(np.hypot(rays[:, 0], rays[:, 1]) / rays[:, 2]))
