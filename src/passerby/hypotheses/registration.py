"""Registration of one camera, without an initial pose, to the positions of people by the other cameras.

The heights of its people level the camera, which gives a plan of their positions. This plan is turned, moved and scaled onto
the positions by the other cameras. From there, a robust resection fits the lower and the upper end of each body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Columns, Floats, Ints
from passerby.core.cameras import Lens, Pose
from passerby.core.observations import CameraObservations
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.groups import compute_cut_cauchy_cost, compute_cut_cauchy_weights
from passerby.geometry.single_view import level_camera
from passerby.geometry.triangulation import pose_jacobian, project_near
from passerby.people.body_centres import FLOOR_PX, SHARE, TriangulatedPeople
from passerby.people.resection import BEYOND, LOSS, fit_pose
from passerby.people.segments import upright_segments

MOST_ROWS = 200
"""Largest number of observations by which a camera is registered, evenly spread."""
FEWEST = 30
HEIGHT_SHARE = 0.15
"""Relative standard deviation of a body's height in the image: stature, gait and errors of the box."""
NEAR_M = 1.0
"""Distance on the ground, metres, within which a plan agrees with a position by the other cameras."""
MOST_SCALED = 2.0
"""Largest factor on a plan's lengths: people are as tall as expected, except for the scale of the rig."""
WIDENING, STEPS = 16.0, 12


@dataclass(frozen=True, eq=False)
class SeenBodies(Columns):
    """M bodies that a camera saw, from their lower to their upper end."""

    frame: Ints
    identity: Ints
    top: Floats
    """(M, 3) unit rays to the upper ends, camera frame."""
    bottom: Floats
    """(M, 3) unit rays to the lower ends, camera frame."""
    top_tangent: Floats
    """(M, 2, 3) tangents of these rays from `Lens.tangents`, pixels."""
    bottom_tangent: Floats
    """(M, 2, 3) likewise, pixels."""
    extent_px: Floats
    length_m: Floats
    """(M,) distance of the two ends of a body of usual height."""
    low_m: Floats
    """(M,) height of the lower end above the ground."""

    def with_places(self, people: TriangulatedPeople, later: int = 0) -> SeenPeople:
        """Select the bodies of people with positions by other cameras `later` time steps after the observation."""
        ids = max(int(each.max(initial=0)) for each in (self.identity, people.identity)) + 1
        at = rows_of_keys((self.frame + later) * ids + self.identity, people.instant * ids + people.identity)
        own = self.take(at >= 0)
        return SeenPeople(**vars(own), place=people.place[at[at >= 0]], covariance=people.covariance[at[at >= 0]])


@dataclass(frozen=True, eq=False)
class SeenPeople(SeenBodies):
    """Bodies that a camera saw, with the positions of these people by other cameras."""

    place: Floats
    """(M, 3) middle of the two ends by the other cameras, world, metres."""
    covariance: Floats
    """(M, 3, 3) covariance of `place`."""

    def __len__(self) -> int:
        return len(self.frame)

    def thinned(self) -> SeenPeople:
        """Select `MOST_ROWS` of them at most, evenly spread."""
        return (
            self.take(np.unique(np.linspace(0, len(self) - 1, MOST_ROWS).astype(np.int64))) if len(self) > MOST_ROWS else self
        )

    def residuals(self, pose: Pose) -> tuple[Floats, Floats]:
        """Compute the residuals under a pose, and their derivatives.

        Returns:
            (M, 2, 2, 7) whitened residuals of the middle and of the vector from the upper to the lower end, two coordinates
            each; the last axis has the residual and its six derivatives by the pose. (M,) logarithm of the ratio of square
            roots of determinants: of the middle's covariance with and without that of the places.
        """
        half = np.zeros_like(self.place)
        half[:, 2] = 0.5 * self.length_m
        R = np.broadcast_to(pose.R_cw, (len(self), 3, 3))
        ends = []
        for ray, tangent, point in (
            (self.top, self.top_tangent, self.place + half), (self.bottom, self.bottom_tangent, self.place - half),
        ):  # fmt: skip
            d = (point - pose.centre) @ pose.R_cw.T
            residual, by_d = project_near(ray, tangent, d)
            ends.append((residual, *pose_jacobian(by_d, d, R)))
        (top, top_by, top_at), (bottom, bottom_by, bottom_at) = ends
        rows = np.stack([
            np.concatenate([0.5 * (top + bottom)[:, :, None], 0.5 * (top_by + bottom_by)], axis=2),
            np.concatenate([(bottom - top)[:, :, None], bottom_by - top_by], axis=2),
        ], axis=1)  # fmt: skip
        by_place = 0.5 * (top_at + bottom_at)
        spread = by_place @ self.covariance @ by_place.transpose(0, 2, 1)
        own = np.hypot(FLOOR_PX, SHARE * self.extent_px)
        of_middle = spread + (own**2)[:, None, None] * np.eye(2)
        of_length = np.hypot(2 * FLOOR_PX, HEIGHT_SHARE * self.extent_px)
        root = np.linalg.cholesky(of_middle)
        rows[:, 0] = np.linalg.solve(root, rows[:, 0])
        rows[:, 1] /= of_length[:, None, None]
        return rows, np.log(root[:, 0, 0] * root[:, 1, 1] / own**2)

    def costs(self, pose: Pose) -> Floats:
        """Return the robust costs (M,) under a pose, nats."""
        rows, wider = self.residuals(pose)
        return np.asarray(0.5 * compute_cut_cauchy_cost((rows[..., 0] ** 2).sum(axis=2), LOSS, BEYOND).sum(axis=1) + wider)

    def fitted(self, start: Pose) -> Pose:
        """Fit the pose, near `start`."""
        part = self.thinned()
        return fit_pose(start, lambda pose, wide: _Equations(*part._normal(pose, wide)), widening=WIDENING, steps=STEPS).pose

    def _normal(self, pose: Pose, wide: float) -> tuple[Floats, Floats]:
        rows = self.residuals(pose)[0]
        weight = compute_cut_cauchy_weights((rows[..., 0] ** 2).sum(axis=2), LOSS * wide, BEYOND * wide**2)
        J = rows[..., 1:] * weight[:, :, None, None]
        return np.einsum("mkeu,mke->u", J, rows[..., 0]), np.einsum("mkeu,mkev->uv", J, rows[..., 1:])

    def anew(self, rng: np.random.Generator) -> Pose | None:
        """Fit the pose without an initial one; None if no level or no position fits, or only one below the ground.

        A camera below the middle of people sees nearly the same boxes, upside down, as one that is as far above it.
        """
        part = self.thinned()
        if len(part) < FEWEST:
            return None
        level = level_camera(part.top, part.bottom, part.top_tangent, part.extent_px, part.length_m, part.low_m, rng)
        if level is None:
            return None
        plan = level.ground_positions(part.bottom) @ np.array([1, 1j])
        placed = _onto(plan, part.place[:, :2] @ np.array([1, 1j]))
        if placed is None:
            return None
        turn, move = placed
        c, s = np.real(turn) / abs(turn), np.imag(turn) / abs(turn)
        to_world = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        centre = np.array([move.real, move.imag, abs(turn) * level.height])
        found = part.fitted(Pose.from_centre(level.R_lc.T @ to_world.T, centre))
        return found if found.centre[2] > 0 else None


def find_bodies(seen: CameraObservations, lens: Lens) -> SeenBodies:
    """Return the bodies of people with identities."""
    ends = upright_segments(seen, lens)
    ends = ends.take(ends.identity >= 0)
    top, bottom = lens.bearings(ends.top), lens.bearings(ends.bottom)
    found = SeenBodies(
        ends.frame, ends.identity, top, bottom, lens.tangents(top), lens.tangents(bottom),
        np.linalg.norm(ends.bottom - ends.top, axis=1), (ends.top_fraction - ends.bottom_fraction) * PERSON_HEIGHT_M,
        ends.bottom_fraction * PERSON_HEIGHT_M,
    )  # fmt: skip
    return found.take(np.isfinite(np.concatenate([top, bottom], axis=1)).all(axis=1))


@dataclass(frozen=True, eq=False)
class _Equations:
    gradient: Floats
    information: Floats

    def summed(self) -> tuple[Floats, Floats]:
        return self.gradient, self.information


def _onto(plan: Floats, places: Floats) -> tuple[complex, complex] | None:
    """Find the similarity `turn * plan + move` that brings most points (N,), complex, near their places; None if too few."""
    known = np.isfinite(plan)
    plan, places = plan[known], places[known]
    n, best, most = len(plan), None, FEWEST / 2
    for step in {n // 2, n // 3, n // 5, n // 7} - {0}:
        first, other = np.arange(n - step), np.arange(step, n)
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = (places[other] - places[first]) / (plan[other] - plan[first])
        sound = np.flatnonzero((np.abs(turn) < MOST_SCALED) & (np.abs(turn) > 1 / MOST_SCALED))[:100]
        turn = turn[sound]
        move = places[first[sound]] - turn * plan[first[sound]]
        near = (np.abs(turn[:, None] * plan + move[:, None] - places) < NEAR_M).sum(axis=1)
        if len(near) and near.max() > most:
            at = int(near.argmax())
            best, most = (complex(turn[at]), complex(move[at])), near[at]
    return best


def rows_of_keys(keys: Ints, among: Ints) -> Ints:
    """Return the row (N,) of each key (N,) in unique keys `among` (K,); -1 where it is not there."""
    if not len(among):
        return np.full(len(keys), -1)
    order = np.argsort(among, kind="stable")
    at = order[np.minimum(np.searchsorted(among[order], keys), len(among) - 1)]
    return np.where(among[at] == keys, at, -1)
