"""Do people stand on their heads in a picture? Either it was flipped top to bottom, or its camera hangs upside down.

A box has neither head nor foot: its upper edge is taken for the head. Where that is wrong the ground lies where the ceiling
would be. But who stands nearer is larger, and lower in the picture of a camera that looks over heads, and higher in a flipped
one. So the level of the camera is fitted to the boxes as they are and turned over: where they fit far better turned over, they
are. A camera about as high as people's middles sees both alike, and so does one that looks straight down: then nothing is said.
Joints have names, and say it themselves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from passerby.core.cameras import Lens
from passerby.core.observations import MIN_JOINT_SCORE, CameraObservations, Clock, Keypoints
from passerby.findings.finding import Finding, doubt
from passerby.geometry.single_view import Level, level_camera
from passerby.people.segments import FEET, HEAD
from passerby.people.upright_rays import upright_rays

MIN_BODIES = 50
FITS_BETTER = 1.6
"""Misfit of the boxes as they are over that of the boxes turned over: 1.19 at most for 130 right cameras, 1.2 to 8 m high
(mostly below 0.6 for those at 2 to 5 m); 1.2 to 5 for their pictures turned over at 2 to 5 m, above 1.6 for nine of ten."""
LEAST_MISFIT = 0.1
"""A better fit does not count where the boxes as they are fit as well as ordinary ones do: 0.04 to 0.1."""
HEADS_BELOW = 0.8
"""Of the bodies of joints: in a right picture some lie, bend or do handstands, but hardly anybody for long."""
TURNED = np.diag([1.0, -1.0, 1.0])


def doubt_of_upside_down(name: str, lens: Lens, seen: CameraObservations, person_height_m: float) -> Finding | None:
    """A doubt where the people of a camera stand on their heads; None where they do not, or it cannot be told.

    Args:
        name: of the camera.
        lens: of the camera.
        seen: its boxes and joints.
        person_height_m: expected standing height, metres.
    """
    below = heads_below(seen.keypoints)
    if not (fits_better_turned(lens, seen, person_height_m) >= FITS_BETTER if below is None else below > HEADS_BELOW):
        return None
    return doubt("image_upside_down", name)


def heads_below(keypoints: Keypoints) -> float | None:
    """The share of the bodies whose head is below their feet in the picture; None where fewer than 50 show both."""
    bare = [name.removeprefix("left_").removeprefix("right_") for name in keypoints.joints]
    ends = []
    for wanted in (HEAD, FEET):
        columns = np.array([name in wanted for name in bare])
        found = keypoints.score[:, columns] > MIN_JOINT_SCORE
        down = np.where(found, keypoints.xy[:, columns, 1], 0.0).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            ends.append(np.where(found.any(axis=1), down / found.sum(axis=1), np.nan))
    whole = np.isfinite(ends[0]) & np.isfinite(ends[1])
    if whole.sum() < MIN_BODIES:
        return None
    return float(np.mean(ends[0][whole] > ends[1][whole]))


def fits_better_turned(lens: Lens, seen: CameraObservations, person_height_m: float) -> float:
    """How many times smaller the misfit of people to one ground is with boxes turned over; 0 where nothing can be said."""
    bodies = upright_rays(CameraObservations(seen.boxes), lens, Clock(1.0))
    if len(bodies) < MIN_BODIES:
        return 0.0
    span, foot = person_height_m * (bodies.top_fraction - bodies.bottom_fraction), person_height_m * bodies.bottom_fraction

    def level(top: NDArray[np.float64], bottom: NDArray[np.float64], tangent: NDArray[np.float64]) -> Level | None:
        return level_camera(top, bottom, tangent, bodies.extent_px, span, foot, np.random.default_rng(0))

    upright = level(bodies.top, bodies.bottom, bodies.top_tangent)
    if upright is None or upright.residual < LEAST_MISFIT:
        return 0.0
    turned = level(bodies.bottom @ TURNED, bodies.top @ TURNED, lens.tangents(bodies.bottom) @ TURNED)
    return 0.0 if turned is None else upright.residual / max(turned.residual, 1e-9)
