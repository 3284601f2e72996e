"""Does a camera keep turning while it films? Its sightings by a rotation that changes piecewise linearly over time.

A mount that gives way turns a camera slowly, and an electronic stabiliser shifts its images, which is a rotation as well. A
step explains a part of such a drift. So both are fitted to the same sightings, and the one with the larger gain is reported.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.calibration.diagnostics.correspondences import Correspondences, fit_costs, pose_residuals
from passerby.calibration.diagnostics.pose_change import MIDDLE_GAIN, WINDOW_ROWS
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Pose
from passerby.geometry.robust import cut_cauchy_weights
from passerby.geometry.rotations import angle_between, exp_rotation
from passerby.people.resection import BEYOND, LOSS, TURN_SD, weak_prior

SEGMENTS = 1, 2, 4, 8
"""Numbers of linear pieces that are tried."""
STEPS, WIDENING = 12, 16.0
"""Gauss-Newton steps, and the factor on the scale of the loss at the first one, halved at each."""


@dataclass(frozen=True, eq=False)
class PoseDrift:
    """A camera that keeps turning: the rotation from its mean orientation, linear in time between knots."""

    knots: Ints
    """(K + 1,) instants."""
    turn: Floats
    """(K + 1, 3) rotation vectors at the knots, radians, in the camera frame: the camera's rotation is exp(turn) R_cw."""
    mean: Pose
    """The pose from which the rotations count: its mean over the sightings."""
    gain: float
    """By how much the drift lowers half the robust cost of a single pose; the cost of its further knots is subtracted."""
    pixels: float
    """How far the drift moves people in the image, between its two farthest knots (median)."""

    @property
    def degrees(self) -> float:
        """The largest rotation between two knots."""
        first, second = self._farthest
        R = exp_rotation(self.turn)
        return float(np.degrees(angle_between(R[first], R[second])))

    @property
    def steady(self) -> bool:
        """Whether it turns at one rate all the time."""
        return len(self.knots) == 2

    @property
    def _farthest(self) -> tuple[int, int]:
        return _farthest_knots(self.turn)

    def turn_at(self, instants: Floats) -> Floats:
        """(N, 3) rotation vectors at instants (N,); constant before the first and after the last knot."""
        return np.column_stack([np.interp(instants, self.knots, axis) for axis in self.turn.T])

    def shift(self, lens: Lens, pixels: Floats, instants: Floats) -> Floats:
        """(N, 2) where the camera would see what it saw at pixels (N, 2), had it kept its mean orientation.

        NaN where the lens model cannot be inverted.
        """
        rays = lens.bearings(pixels)
        return lens.project_rays(np.einsum("nji,nj->ni", exp_rotation(self.turn_at(instants)), rays))


def detect_drift(m: Correspondences, pose: Pose) -> PoseDrift | None:
    """The drift that explains a camera's sightings best, with as few linear pieces as needed; None for too few sightings.

    Args:
        m: the camera's sightings with the people of their instants.
        pose: of the whole recording, as found without regard to changes.
    """
    drifts = [drift for segments in SEGMENTS if (drift := fit_drift(m, pose, segments)) is not None]
    return max(drifts, key=lambda drift: drift.gain, default=None)


def fit_drift(m: Correspondences, pose: Pose, segments: int) -> PoseDrift | None:
    """The drift of so many linear pieces, equally long; None for fewer than `WINDOW_ROWS` sightings a piece.

    Iteratively reweighted Gauss-Newton. The gain is the difference to the same fit with one pose for all of the time, in the
    unit of `PoseChange.gain`; a further piece costs `MIDDLE_GAIN`, as a further change of a step does.
    """
    if len(m) < 2 * WINDOW_ROWS * segments or m.own.instant[0] == m.own.instant[-1]:
        return None
    knots = np.linspace(m.own.instant[0], m.own.instant[-1], segments + 1)
    hats = np.column_stack([np.interp(m.own.instant, knots, row) for row in np.eye(segments + 1)])
    # The hat functions sum to 1: without their means one of them is determined by the others.
    mean = hats.mean(axis=0)[:-1]
    basis = hats[:, :-1] - mean
    still, _ = _fitted(m, pose, basis[:, :0])
    single = min(fit_costs(m, one).cost.sum() for one in (still, pose))
    held, found = _fitted(m, still, basis)
    cost = fit_costs(turned(m, basis @ found), held).cost.sum()
    turn = np.vstack([found, np.zeros(3)]) - mean @ found
    gain = 0.5 * float(single - cost) - MIDDLE_GAIN * (segments - 1)
    first, second = _farthest_knots(turn)
    # A rotation by `turn` moves a ray by their cross product.
    moved = np.einsum("nij,nj->ni", m.own.tangent, np.cross(turn[first] - turn[second], m.own.ray))
    pixels = float(np.median(np.linalg.norm(moved, axis=1)))
    return PoseDrift(np.round(knots).astype(np.int64), turn, held, gain, pixels)


def turned(m: Correspondences, turn: Floats) -> Correspondences:
    """The sightings as they would be without the rotations `turn` (M, 3) of the camera, rotation vectors in its frame."""
    R = exp_rotation(turn)
    ray = np.einsum("nji,nj->ni", R, m.own.ray)
    return replace(m, own=replace(m.own, ray=ray, tangent=m.own.tangent @ R))


def _fitted(m: Correspondences, start: Pose, basis: Floats) -> tuple[Pose, Floats]:
    """A pose and (K, 3) coefficients of rotation vectors, by functions of time `basis` (M, K)."""
    k = basis.shape[1]
    pose, turn = start, np.zeros((k, 3))
    prior = np.zeros((6 + 3 * k, 6 + 3 * k))
    prior[:6, :6] = weak_prior()
    prior[6:, 6:] = np.eye(3 * k) / TURN_SD**2
    for step in range(STEPS):
        scale = max(1.0, WIDENING / 2.0**step)
        seen = turned(m, basis @ turn)
        pairs = fit_costs(seen, pose).pair
        residual, information, by_pose, square = pose_residuals(seen, pose, pairs)
        weight = cut_cauchy_weights(square, LOSS * scale, BEYOND * scale**2)
        by_turn = by_pose[:, :, None, :3] * basis[m.row[pairs]][:, None, :, None]
        J = np.concatenate([by_pose, by_turn.reshape(len(pairs), 2, -1)], axis=2)
        weighed = np.einsum("nki,nkl,n->nil", J, information, weight)
        normal = np.einsum("nil,nlj->ij", weighed, J) + prior
        delta = -np.linalg.solve(normal, np.einsum("nil,nl->i", weighed, residual))
        pose = Pose.from_centre(exp_rotation(delta[:3]) @ pose.R_cw, pose.centre + delta[3:6])
        turn = turn + delta[6:].reshape(k, 3)
    return pose, turn


def _farthest_knots(turn: Floats) -> tuple[int, int]:
    """The two knots between which the camera turns most."""
    apart = np.linalg.norm(turn[:, None] - turn[None], axis=2)
    first, second = np.unravel_index(int(apart.argmax()), apart.shape)
    return int(first), int(second)
