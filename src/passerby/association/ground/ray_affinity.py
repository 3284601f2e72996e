"""Test whether two tracklets meet in space, with a calibrated rig: by rays to the middles of bodies, not by feet on a plane.

Two cameras at known poses see one person along two rays that meet at half a body's height, at a distance that fits the body's
size in both pictures. This is also true on slopes and kerbs, and for low cameras, where a foot's ground position does not
determine the distance. Two samples are compared at the best of three points: the point nearest to both rays, the point of
camera a's ray at half a body's height above the ground, and the point of this ray at the distance given by the body's size.
(The first is undetermined where two cameras stand side by side.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.association.sampling import STEP_S, interpolate_samples
from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import least_of_groups, rows_of_equal
from passerby.people.sightings import Sightings

MIDDLE_FLOOR_RAD = 0.002
"""Least sigma of a ray, radians: two pixels of a usual lens."""
AGAINST = 12.0
"""Cost at which two samples are evidence neither for one person nor for two; one person's five residuals have a mean cost of 5.
"""
TAIL = 2.0
"""Squared sigmas from which a height or a size is weighted down."""
NEAREST = 50
"""Least number of mutually nearest samples from which the spread of one person's samples is estimated."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the residuals between two samples of one person."""

    middle: float = 0.08
    """Of a ray from the point, as a share of the body's size in the picture: boxes jitter by 2 to 3 % of it, bodies lean, and
    the rig has errors too."""
    height_m: float = 0.3
    """Of the height of a body's middle above the ground, metres: crouching, kerbs and slopes."""
    size: float = 0.15
    """Of the logarithm of a body's apparent height: people differ by 5 %, bend, and are half hidden."""

    @classmethod
    def limits(cls) -> tuple[Spread, Spread]:
        """Return the limits of a recording's own spread. Errors last over time, so that more samples are not more evidence."""
        return cls(0.03, 0.12, 0.07), cls(0.16, 0.6, 0.25)


@dataclass(frozen=True, eq=False)
class RayTracks:
    """The tracklets of one camera sampled on the grid of time: N samples, sorted by time."""

    step: Ints
    """(N,) grid times: the camera's time is `step * STEP_S`."""
    tracklet: Ints
    ray: Floats
    """(N, 3) directions to the bodies' middles, world."""
    rate: Floats
    """(N, 3) change of the directions per second."""
    size: Floats
    """(N,) angular height of the whole body, radians."""
    pose: Pose


def ray_tracks(bodies: Sightings, pose: Pose) -> RayTracks:
    """Sample the bodies that belong to a tracklet.

    Args:
        bodies: one camera's people.
        pose: pose of the camera, world z up and ground at z = 0.
    """
    own = np.flatnonzero(bodies.identity >= 0)
    order = own[np.lexsort((bodies.seconds[own], bodies.identity[own]))]
    ray = bodies.top[order] + bodies.bottom[order]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    cosine = np.einsum("ni,ni->n", bodies.top[order], bodies.bottom[order])
    size = np.arccos(np.clip(cosine, -1, 1)) / np.maximum(bodies.top_fraction[order] - bodies.bottom_fraction[order], 0.2)
    columns = np.column_stack([ray @ pose.R_cw, np.log(np.maximum(size, 1e-4))])
    found = interpolate_samples(bodies.identity[order], bodies.seconds[order], columns)
    by_time = np.argsort(found.step, kind="stable")
    value, rate = found.value[by_time], found.rate[by_time]
    length = np.linalg.norm(value[:, :3], axis=1, keepdims=True)
    return RayTracks(
        found.step[by_time], found.tracklet[by_time], value[:, :3] / length, rate[:, :3] / length, np.exp(value[:, 3]), pose
    )


def pairwise_ray_affinity(a: RayTracks, b: RayTracks, lag_s: float, person_height_m: float) -> tuple[Ints, Ints, Floats]:
    """Score the agreement of every two tracklets of two cameras.

    Args:
        a: tracks of the first camera.
        b: tracks of the second camera.
        lag_s: time of camera b's clock minus that of camera a's, seconds.
        person_height_m: typical standing height, metres.

    Returns:
        (K,) tracklets of camera a, (K,) of camera b, and (K,) the sum over their common samples of 1 (they meet) down to -1.
    """
    lag = round(lag_s / STEP_S)
    i, j = rows_of_equal(a.step, b.step - lag)
    if not len(i):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    meetings = _meetings(a, b, i, j, b.ray[j] + b.rate[j] * (lag_s - lag * STEP_S), person_height_m)
    spread = Spread()
    for _ in range(2):
        spread = _learnt(*_best_residuals(meetings, spread), i, j, spread)
    _, cost = _best_residuals(meetings, spread)
    value = np.maximum(1.0 - cost / AGAINST, -1.0)
    n_b = int(b.tracklet.max()) + 1
    pair, which = np.unique(a.tracklet[i] * n_b + b.tracklet[j], return_inverse=True)
    return pair // n_b, pair % n_b, np.asarray(np.bincount(which.ravel(), value, len(pair)), dtype=np.float64)


def _cost(residuals: Floats) -> Floats:
    """Return the costs (K,) of residuals (5, K) under the hypothesis of one person.

    The costs of the rays are quadratic. People crouch, climb and are half hidden, so that height and sizes have long tails.
    """
    squares = residuals**2
    return np.asarray(squares[:2].sum(axis=0) + (TAIL * np.log1p(squares[2:] / TAIL)).sum(axis=0))


def _learnt(residuals: Floats, cost: Floats, i: Ints, j: Ints, spread: Spread) -> Spread:
    """Estimate the spread from mutually nearest samples."""
    near = np.flatnonzero(cost < 4 * AGAINST)
    mutual = near[np.intersect1d(least_of_groups(i[near], cost[near]), least_of_groups(j[near], cost[near]))]
    if len(mutual) < NEAREST:
        return spread
    # Median absolute deviations as sigmas of a normal distribution.
    middle, height, size = (
        float(np.median(np.abs(residuals[columns][:, mutual]))) / 0.6745 for columns in ([0, 1], [2], [3, 4])
    )
    low, high = Spread.limits()
    return Spread(
        float(np.clip(spread.middle * middle, low.middle, high.middle)),
        float(np.clip(spread.height_m * height, low.height_m, high.height_m)),
        float(np.clip(spread.size * size, low.size, high.size)),
    )


@dataclass(frozen=True, eq=False)
class _View:
    """A camera's K samples, compared with a possible position of the person for each."""

    sine: Floats
    """(K,) sine of the angle between the sample's ray and the direction to the position."""
    behind: Bools
    """(K,) whether the position is behind the camera."""
    larger: Floats
    """(K,) logarithm of the ratio of the sample's size to that of a person there."""
    size: Floats
    """(K,) angular height of the sample."""

    @classmethod
    def of(cls, place: Floats, centre: Floats, ray: Floats, size: Floats, person_height_m: float) -> _View:
        """Compare positions (K, 3) with rays (K, 3) from a centre (3,)."""
        to = place - centre
        reach = np.linalg.norm(to, axis=1)
        sine = np.linalg.norm(np.cross(ray, to), axis=1) / reach
        return cls(sine, np.einsum("ki,ki->k", ray, to) <= 0, np.log(reach * size / person_height_m), size)


@dataclass(frozen=True, eq=False)
class _Meeting:
    """One of the three points where each of K pairs of samples may meet."""

    rise_m: Floats
    """(K,) height of the point above the middle of a standing body, metres."""
    views: tuple[_View, _View]


def _meetings(a: RayTracks, b: RayTracks, i: Ints, j: Ints, ray_b: Floats, person_height_m: float) -> list[_Meeting]:
    """Return the three points: nearest to both rays, of a body that stands on the ground, and at the distance by size."""
    from_a, from_b, ray_a = a.pose.centre, b.pose.centre, a.ray[i]
    apart = from_b - from_a
    cosine = np.einsum("ki,ki->k", ray_a, ray_b)
    along_a, along_b = ray_a @ apart, ray_b @ apart
    with np.errstate(divide="ignore", invalid="ignore"):
        reach_a = (along_a - cosine * along_b) / (1 - cosine**2)
        reach_b = (cosine * along_a - along_b) / (1 - cosine**2)
        nearest = 0.5 * (from_a + reach_a[:, None] * ray_a + from_b + reach_b[:, None] * ray_b)
        level = from_a + ((0.5 * person_height_m - from_a[2]) / ray_a[:, 2])[:, None] * ray_a
        sized = from_a + (person_height_m / a.size[i])[:, None] * ray_a
        return [
            _Meeting(
                place[:, 2] - 0.5 * person_height_m,
                (
                    _View.of(place, from_a, ray_a, a.size[i], person_height_m),
                    _View.of(place, from_b, ray_b, b.size[j], person_height_m),
                ),
            )
            for place in (nearest, level, sized)
        ]


def _best_residuals(meetings: Sequence[_Meeting], spread: Spread) -> tuple[Floats, Floats]:
    """Return the residuals (5, K) at the best of the three points, in sigmas, and their costs (K,).

    The residuals are those of the two rays, of the height of the point, and of the two sizes.
    """
    best = np.full((5, len(meetings[0].rise_m)), 1e3)
    least = _cost(best)
    for meeting in meetings:
        found = np.empty_like(best)
        found[2] = meeting.rise_m / spread.height_m
        for k, view in enumerate(meeting.views):
            found[k] = view.sine / np.hypot(spread.middle * view.size, MIDDLE_FLOOR_RAD)
            found[k, view.behind] = 1e3
            found[3 + k] = view.larger / spread.size
        found = np.where(np.isfinite(found), found, 1e3)
        cost = _cost(found)
        better = cost < least
        best, least = np.where(better, found, best), np.where(better, cost, least)
    return best, least
