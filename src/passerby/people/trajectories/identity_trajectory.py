"""Trajectory of one identity. Its boxes vote, boxes that agree are solved for a body at each instant, and the positions are
smoothed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.geometry.groups import cauchy_weights, group_sums
from passerby.people.sightings import Sightings
from passerby.people.standing import MIN_INSTANTS, standing_share
from passerby.people.trajectories.smoothing import smooth
from passerby.people.trajectories.voting import FITS, mahalanobis_squared, vote
from passerby.people.upright_body import STANCE_SD, linearise_on_ground, single_view_bodies, solve_bodies

ROUNDS = 3
"""Rounds of solving, smoothing and selecting the boxes again; the selection is fixed after two."""
STATURES = 0.87, 1.15
"""Limits of standing heights, as shares of the usual one: two and a half standard deviations of adults. A person who is always
lower does not stand."""
FREE_SD = 0.35
"""Metres: sigma of a highest point about the standing height while the person's height and stance are estimated."""
HEIGHT_INSTANTS = 2000
"""Approximate largest number of instants from which a person's height is taken: more would only take memory."""
SPREADS = (0.7, 4.0)
"""Limits of the noise of a camera's boxes, as multiples of the usual noise."""
USUAL_MEDIAN = 0.455
"""Median of the square of a standard normal variable."""
FEWEST_ROWS = 20
"""Least number of boxes of a camera from which their noise is estimated."""
LASTING = 0.35
"""Share of an instant's own sigma that smoothing does not reduce: errors of neighbouring boxes are alike, since a person's
height, stance and occlusion last."""
MODEL_SD = 0.05
"""Metres, in each of two directions: a body's middle is not above the middle between its feet, because of arms, stride and
load. Without any noise the positions of upright people have errors of 0.05 to 0.09 m (root mean square) in simulated scenes."""
BENT_SD, BENT = 0.11, 0.12
"""Metres, the same for people who crouch, bend or sit: their highest point is this share or more below its standing height.
Their errors are 0.15 to 0.2 m. For smaller shares the sigma is proportional to the share."""


@dataclass(frozen=True, eq=False)
class IdentityTrajectory:
    """Positions of a person at W instants."""

    xy: Floats
    """(W, 2) metres."""
    middle: Floats
    """(W,) height of the body's middle above the ground, metres."""
    sigma: Floats
    """(W,) root of the trace of the position's covariance, metres."""
    cameras: Ints
    """(W,) number of cameras that agree; 0 for an instant that is interpolated."""
    part: Ints
    """(W,) number of the part, a stretch without long gaps, from 0."""
    row: Ints
    """(W,) rows in the `instants` that were given."""
    accepted: Bools
    """(M,) mask of the boxes that the trajectory uses."""
    miss_m: Floats
    """(M,) distance of each box's ray from the body's middle, metres; NaN for one that is not accepted."""


def estimate_identity_trajectories(
    people: Sequence[Sightings], instants: Floats, max_gap_s: float, person_height_m: float, foot_shift: float
) -> list[IdentityTrajectory]:
    """Estimate the trajectories of several identities, each independently; only their smoothing is done side by side.

    Args:
        people: for each identity its M boxes, sorted by time step, then by camera, rays in the world's frame; a block is one of
            its T time steps.
        instants: (T',) all instants of the recording, seconds, ascending, including those of the people.
        max_gap_s: longest time without an agreeing box that is bridged.
        person_height_m: typical standing height, metres.
        foot_shift: distance by which the lowest visible point is nearer to a camera than the body's axis, as a share of the
            height.
    """
    walks = [_begun(seen, person_height_m, foot_shift) for seen in people]
    for number in range(ROUNDS):
        walks = [_stepped(walk, instants, max_gap_s, person_height_m, foot_shift) for walk in walks]
        smoothed = _smoothed(walks, instants)
        if number < ROUNDS - 1:
            walks = [_judged(walk, instants, *way) for walk, way in zip(walks, smoothed, strict=True)]
    return [_result(walk, instants, *way) for walk, way in zip(walks, smoothed, strict=True)]


@dataclass(frozen=True, eq=False)
class _State:
    """Estimates of a person at T instants."""

    body: Floats
    """(T, 3) x, y, top; where no box was accepted, the last known one."""
    height: float
    spread: Floats
    """(M,) ratio of the boxes' noise to the usual noise."""
    covariance: Floats | None = None
    """(T, 2, 2) covariance of x, y; None before the first solution."""
    measured: Bools | None = None
    """(T,) whether a box was accepted."""
    miss_m: Floats | None = None
    """(M,) distances of rays from the body's middle, metres."""


@dataclass(frozen=True, eq=False)
class _Walk:
    """One identity during the rounds."""

    seen: Sightings
    alone: Floats
    """(M, 2) position of the person by each box alone, metres."""
    alone_covariance: Floats
    """(M, 2, 2)"""
    accepted: Bools
    """(M,)"""
    trust: Floats
    """(T,) weight of each instant in the smoothing, 0 to 1."""
    state: _State
    row: Ints
    """(W,) rows of the instants of its trajectory."""
    part: Ints
    """(W,) number of the part of each."""


def _begun(seen: Sightings, person_height_m: float, foot_shift: float) -> _Walk:
    """Start an identity before the first round: its boxes vote."""
    alone, covariance = single_view_bodies(seen, person_height_m, foot_shift * person_height_m)
    covariance = covariance[:, :2, :2]
    accepted = vote(seen.block, seen.camera, seen.block_seconds, alone[:, :2], covariance)
    state = _State(_mean_bodies(seen, alone, accepted), person_height_m, np.ones(len(accepted)))
    nothing = np.zeros(0, np.int64)
    return _Walk(seen, alone[:, :2], covariance, accepted, np.ones(seen.n_blocks), state, nothing, nothing)


def _stepped(walk: _Walk, instants: Floats, max_gap_s: float, person_height_m: float, foot_shift: float) -> _Walk:
    """Solve the bodies with the boxes accepted so far."""
    row, part = _asked(walk.seen, walk.accepted, instants, max_gap_s)
    return replace(walk, state=_solve(walk.seen, walk.accepted, walk.state, foot_shift, person_height_m), row=row, part=part)


def _judged(walk: _Walk, instants: Floats, xy: Floats, covariance: Floats) -> _Walk:
    """Select the boxes and weight the instants by the smoothed positions (W, 2) and their covariances (W, 2, 2)."""
    seen, state = walk.seen, walk.state
    assert state.covariance is not None
    # An instant outside all parts has no smoothed position: its boxes are rejected.
    here, here_covariance = _at(walk, instants, xy), _at(walk, instants, covariance)
    spread = np.maximum(state.spread, 1.0)[:, None, None] ** 2
    with np.errstate(invalid="ignore"):
        off2 = mahalanobis_squared(walk.alone - here[seen.block], walk.alone_covariance * spread + here_covariance[seen.block])
        missed2 = mahalanobis_squared(state.body[:, :2] - here, state.covariance)
    trust = np.where(np.isfinite(missed2), cauchy_weights(missed2 / FITS), 1.0)
    return replace(walk, accepted=off2 < FITS, trust=trust)


def _mean_bodies(seen: Sightings, alone: Floats, accepted: Bools) -> Floats:
    """Return the mean bodies (T, 3) of the accepted boxes, each taken alone."""
    total = group_sums(seen.block[accepted], alone[accepted], seen.n_blocks)
    count = np.bincount(seen.block[accepted], minlength=seen.n_blocks)
    return np.asarray(total / np.maximum(count, 1)[:, None])


def _solve(seen: Sightings, accepted: Bools, state: _State, foot_shift: float, person_height_m: float) -> _State:
    """Solve the bodies from the accepted boxes, the person's height, and the noise of the cameras."""
    rows = np.flatnonzero(accepted)
    instant, n = seen.block[rows], seen.n_blocks
    rays = seen.take(rows)
    count = np.bincount(instant, minlength=n)
    body, height = np.array(state.body), state.height
    for _ in range(2):
        found = linearise_on_ground(rays, body[instant], foot_shift * height)
        weight = state.spread[rows] ** -2
        information = group_sums(instant, found.information * weight[:, None, None], n)
        pull = group_sums(instant, found.pull * weight[:, None], n)
        top = solve_bodies(information, pull, np.full(n, height), np.full(n, FREE_SD))[0][:, 2]
        height = _height(top[count > 1], person_height_m)
        sd = STANCE_SD * height
        sd_here = sd * np.sqrt(1 + ((top - height) / (2 * sd)) ** 2)
        solved, covariance = solve_bodies(information, pull, np.full(n, height), sd_here)
        body[count > 0] = solved[count > 0]
    body[:, 2] = np.clip(body[:, 2], 0.3 * height, 1.3 * height)
    residual = found.residual(body[instant])
    miss = np.full(len(accepted), np.nan)
    miss[rows] = np.linalg.norm(residual[:, :2], axis=1) * rays.centre_sd * found.distance
    spread = np.array(state.spread)
    spread[rows] = _spread(seen.camera[rows], residual[:, :2], count[instant])
    return _State(body, height, spread, covariance[:, :2, :2], count > 0, miss)


def _height(top: Floats, person_height_m: float) -> float:
    """Estimate the standing height from highest points seen by two cameras or more; return the usual one for too few."""
    if len(top) < MIN_INSTANTS:
        return person_height_m
    every = max(1, len(top) // HEIGHT_INSTANTS)
    return float(np.clip(standing_share(top[::every] / person_height_m), *STATURES)) * person_height_m


def _spread(camera: Ints, residual: Floats, count: Ints) -> Floats:
    """Estimate the noise (K,) of each box's camera from residuals (K, 2) at instants with `count` (K,) accepted boxes."""
    several = count > 1
    out = np.ones(len(camera))
    for index in np.unique(camera):
        own = (camera == index) & several
        if np.count_nonzero(own) < FEWEST_ROWS:
            continue
        free = 1 - 2 / (3 * count[own]).mean()
        out[camera == index] = np.clip(np.sqrt(np.median(residual[own] ** 2) / (USUAL_MEDIAN * free)), *SPREADS)
    return out


def _asked(seen: Sightings, accepted: Bools, instants: Floats, max_gap_s: float) -> tuple[Ints, Ints]:
    """Return the rows of the instants from the first to the last accepted box of each part, and the parts' numbers."""
    at = np.unique(np.searchsorted(instants, seen.block_seconds)[seen.block[accepted]])
    if not len(at):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    cut = np.flatnonzero(np.diff(instants[at]) > max_gap_s + 1e-9)
    first, last = at[np.append(0, cut + 1)], at[np.append(cut, len(at) - 1)]
    rows = [np.arange(low, high + 1) for low, high in zip(first, last, strict=True)]
    return np.concatenate(rows), np.repeat(np.arange(len(rows)), [len(part) for part in rows])


def _smoothed(walks: Sequence[_Walk], instants: Floats) -> list[tuple[Floats, Floats]]:
    """Smooth each walk: return its positions (W, 2) and covariances (W, 2, 2) at the instants `row`."""
    places, covariances, parts, first = [], [], [], 0
    for walk in walks:
        state, measured = walk.state, walk.state.measured
        assert state.covariance is not None
        assert measured is not None
        place, covariance = np.full((len(walk.row), 2), np.nan), np.tile(np.eye(2), (len(walk.row), 1, 1))
        index = np.searchsorted(walk.row, np.searchsorted(instants, walk.seen.block_seconds)[measured])
        place[index] = state.body[measured, :2]
        covariance[index] = (state.covariance / walk.trust[:, None, None])[measured]
        places.append(place)
        covariances.append(covariance)
        parts.append(walk.part + first)
        first += int(walk.part.max(initial=-1)) + 1
    seconds = instants[np.concatenate([walk.row for walk in walks])]
    xy, spread = smooth(seconds, np.concatenate(places), np.concatenate(covariances), np.concatenate(parts))
    cuts = np.cumsum([len(walk.row) for walk in walks])[:-1]
    return list(zip(np.split(xy, cuts), np.split(spread, cuts), strict=True))


def _at(walk: _Walk, instants: Floats, values: Floats) -> Floats:
    """Return the values (W, ...) of the trajectory's instants at the person's own instants (T, ...); NaN elsewhere."""
    at = np.searchsorted(instants, walk.seen.block_seconds)
    out = np.full((len(at), *values.shape[1:]), np.nan)
    if len(walk.row):
        index = np.minimum(np.searchsorted(walk.row, at), len(walk.row) - 1)
        here = walk.row[index] == at
        out[here] = values[index[here]]
    return out


def _result(walk: _Walk, instants: Floats, xy: Floats, covariance: Floats) -> IdentityTrajectory:
    """Assemble the result, with sigmas that include the errors that smoothing does not reduce."""
    seen, state, row, part = walk.seen, walk.state, walk.row, walk.part
    assert state.covariance is not None
    assert state.measured is not None
    assert state.miss_m is not None
    known = np.flatnonzero(state.measured)
    own = instants[row]
    variance = np.trace(covariance, axis1=1, axis2=2)
    count = np.zeros(len(row), np.int64)
    miss = np.where(walk.accepted, state.miss_m, np.nan)
    if not len(known):
        return IdentityTrajectory(xy, variance, variance, count, part, row, walk.accepted, miss)
    agreeing = np.bincount(seen.block[walk.accepted], minlength=seen.n_blocks)
    count[np.searchsorted(row, np.searchsorted(instants, seen.block_seconds)[known])] = agreeing[known]
    lasting = np.interp(own, seen.block_seconds[known], np.trace(state.covariance[known], axis1=1, axis2=2))
    top = np.interp(own, seen.block_seconds[known], state.body[known, 2])
    bent = BENT_SD * np.clip((1 - top / state.height) / BENT, 0.0, 1.0)
    sigma = np.sqrt(variance + LASTING**2 * lasting + 2 * (MODEL_SD**2 + bent**2))
    return IdentityTrajectory(xy, top / 2, sigma, count, part, row, walk.accepted, miss)
