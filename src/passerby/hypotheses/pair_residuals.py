"""Residuals of one camera's sightings under a pose, relative to the people's positions by the other cameras.

They are computed thousands of times. Arrays have their components first, so that each operation works on all pairs of a
sighting and a person at once: with a small matrix for each pair, the matrices would take most of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.triangulation import hold_depth
from passerby.people.body_centres import TriangulatedPeople
from passerby.people.sightings import Sightings

SIZE_SD = 0.25
"""Standard deviation of the logarithm of a box's size relative to that of a person of typical height at the same place."""
NEAREST_M = 0.3
"""Least distance of a person from a camera, metres."""


@dataclass(frozen=True, eq=False)
class PairColumns:
    """K pairs of a sighting and a person."""

    ray: Floats
    """(3, K) unit rays, camera frame."""
    tangent: Floats
    """(2, 3, K) pixels, from `Lens.tangents`."""
    place: Floats
    """(3, K) the person's middle, world, metres."""
    covariance: Floats
    """(3, 3, K) covariance of the place."""
    variance: Floats
    """(K,) variance of the sighting, pixels squared."""
    size: Floats
    """(K,) logarithm of the box's extent over that of a person of typical height one metre away."""

    @classmethod
    def of(cls, own: Sightings, people: TriangulatedPeople, row: Ints, person: Ints, person_height_m: float) -> PairColumns:
        """Pair the sightings `own` at `row` (K,) with the `people` at `person` (K,)."""
        pixels = np.linalg.norm(own.middle_tangent, axis=(1, 2)) / np.sqrt(2.0)
        size = np.log(own.extent_px / (pixels * person_height_m))
        tangent, covariance = (each.transpose(1, 2, 0) for each in (own.middle_tangent, people.covariance))
        return cls(
            own.middle.T[:, row], tangent[:, :, row], people.place.T[:, person], covariance[:, :, person],
            own.middle_sd_px[row] ** 2, size[row],
        )  # fmt: skip

    def take(self, pairs: Ints) -> PairColumns:
        """Select some of the pairs."""
        return PairColumns(
            self.ray[:, pairs], self.tangent[:, :, pairs], self.place[:, pairs], self.covariance[:, :, pairs],
            self.variance[pairs], self.size[pairs],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class PairResiduals:
    """Residuals of K pairs under a pose, and their derivatives."""

    residual: Floats
    """(2, K) pixels."""
    information: Floats
    """(3, K) elements (0, 0), (0, 1) and (1, 1) of the information of the residuals."""
    square: Floats
    """(K,) squared residual, in sigmas, including that of the box's size."""
    at: Floats
    """(3, K) positions of the people, camera frame."""
    by_at: Floats
    """(2, 3, K) derivative of the residual by `at`."""
    by_place: Floats
    """(2, 3, K) derivative of the residual by the positions in the world."""

    def by_pose(self) -> Floats:
        """Return the derivative (2, 6, K) of the residual by a rotation vector in the camera's frame, then the centre."""
        x, y, z = self.at
        out = np.empty((2, 6, self.at.shape[1]))
        for axis, (a, b, c) in enumerate(self.by_at):
            out[axis, 0], out[axis, 1], out[axis, 2] = y * c - z * b, z * a - x * c, x * b - y * a
            np.negative(self.by_place[axis], out=out[axis, 3:])
        return out

    def take(self, pairs: Ints) -> PairResiduals:
        """Select the residuals of some of the pairs."""
        return PairResiduals(
            self.residual[:, pairs], self.information[:, pairs], self.square[pairs], self.at[:, pairs],
            self.by_at[:, :, pairs], self.by_place[:, :, pairs],
        )  # fmt: skip


def residuals_at(pairs: PairColumns, pose: Pose) -> PairResiduals:
    """Compute the residuals of pairs under a pose."""
    at = pose.R_cw @ (pairs.place - pose.centre[:, None])
    along, square = _dot(pairs.ray, at), _dot(at, at)
    inverse = 1.0 / hold_depth(along, square)
    residual = np.array([_dot(pairs.tangent[0], at), _dot(pairs.tangent[1], at)]) * inverse
    by_at = (pairs.tangent - residual[:, None] * pairs.ray) * inverse
    by_place = np.array([pose.R_cw.T @ by_at[0], pose.R_cw.T @ by_at[1]])
    information = _information(by_place, pairs)
    across, both, down = information
    miss = across * residual[0] ** 2 + 2 * both * residual[0] * residual[1] + down * residual[1] ** 2
    # The size of the box is a residual too: a person of the wrong size is another person.
    distance = np.maximum(np.sqrt(square), NEAREST_M)
    size = (pairs.size + np.log(distance)) / SIZE_SD
    miss = np.where(along < NEAREST_M * distance, 1e6, miss + np.maximum(size**2 - 4.0, 0.0))
    return PairResiduals(residual, information, miss, at, by_at, by_place)


def _information(by_place: Floats, pairs: PairColumns) -> Floats:
    """Return the inverse covariance (3, K) of residuals, from the sighting and, by its derivative (2, 3, K), the place."""
    c = pairs.covariance
    u, v = by_place
    turned = np.array([_dot(c[0], v), _dot(c[1], v), _dot(c[2], v)])
    own = np.array([_dot(c[0], u), _dot(c[1], u), _dot(c[2], u)])
    across, both, down = _dot(own, u) + pairs.variance, _dot(turned, u), _dot(turned, v) + pairs.variance
    determinant = across * down - both * both
    return np.array([down, -both, across]) / determinant


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
