"""Bodies on flat ground by boxes of held cameras: linear measurements of where each stands and how tall it is.

A body stands at (x, y) on the ground z = 0 and its highest point is `top` metres high. This is the person model of the solver
(`passerby.solver.person_model`) with the cameras held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.people.model import Priors
from passerby.people.upright_body import Rays, body_ends, linearise_ends, reach_by_size

ROUNDS = 4
"""Of a box's distance, from its size to the place where the body stands; the fourth moves no person by a millimetre."""
SHORTEST_SHARE, LONGEST_SHARE = 0.3, 1.3
"""Of the usual height: what a body's highest point is taken to be while its distance is sought."""
STANCE_SD = Priors().high
"""Of the highest point, as a share of the standing height: gait, a bent neck, shoes."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Of N boxes: three whitened rows `by_body @ (x, y, top) = value`."""

    by_body: Floats
    """(N, 3, 3) across, up, size."""
    value: Floats
    """(N, 3)"""
    distance: Floats
    """(N,) metres along the ray to the body's middle."""

    @property
    def information(self) -> Floats:
        """(N, 3, 3)"""
        return np.asarray(self.by_body.transpose(0, 2, 1) @ self.by_body)

    @property
    def pull(self) -> Floats:
        """(N, 3)"""
        return np.asarray((self.by_body.transpose(0, 2, 1) @ self.value[:, :, None])[:, :, 0])


def linearise(rays: Rays, body: Floats, foot_shift: float | Floats) -> Measurements:
    """The measurements about bodies (N, 3): x, y, top.

    Args:
        rays: of the boxes.
        body: about where each of them stands; only distances are taken from it.
        foot_shift: how much nearer to the camera the lowest visible point is than the body's axis, metres; (N, 1) where bodies
            differ in it.
    """
    standing = np.column_stack([body[:, :2], np.zeros(len(body)), body[:, 2]])
    top, bottom, _, _ = body_ends(rays.centre, standing, np.asarray(foot_shift))
    rows = linearise_ends(rays, top, bottom)
    by_body = np.concatenate([(rows.by_top + rows.by_bottom)[:, :, :2], rows.by_top[:, :, 2:]], axis=2)
    return Measurements(by_body, rows.residual + (by_body @ body[:, :, None])[:, :, 0], rows.distance)


def solve_bodies(information: Floats, pull: Floats, height: Floats, height_sd: Floats) -> tuple[Floats, Floats]:
    """Bodies from sums of measurements and what is known of their height.

    Args:
        information: (N, 3, 3) of (x, y, top).
        pull: (N, 3)
        height: (N,) expected highest point, metres.
        height_sd: (N,) its sigma.

    Returns:
        (N, 3) x, y, top; (N, 3, 3) covariance.
    """
    weight = 1 / np.asarray(height_sd) ** 2
    normal, right = np.array(information), np.array(pull)
    normal[:, 2, 2] += weight
    right[:, 2] += weight * height
    covariance = np.linalg.inv(normal + 1e-9 * np.eye(3))
    return (covariance @ right[:, :, None])[:, :, 0], np.asarray(covariance, dtype=np.float64)


def single_view_bodies(rays: Rays, height_m: float, foot_shift: float) -> tuple[Floats, Floats, Measurements]:
    """Where each box by itself puts a body of about the given height.

    Returns:
        (N, 3) x, y, top; (N, 3, 3) covariance; the measurements about them. NaN where the lens cannot tell the rays.
    """
    middle, reach = reach_by_size(rays.top, rays.bottom, rays.size, height_m)
    body = np.column_stack([rays.centre[:, :2] + reach[:, None] * middle[:, :2], np.full(len(reach), height_m)])
    known = np.full(len(reach), height_m)
    for _ in range(ROUNDS):
        seen = linearise(rays, body, foot_shift)
        body, covariance = solve_bodies(seen.information, seen.pull, known, STANCE_SD * known)
        body[:, 2] = np.clip(body[:, 2], SHORTEST_SHARE * height_m, LONGEST_SHARE * height_m)
    return body, covariance, seen
