"""The way of one identity: its boxes vote, those that agree are solved for a body at each instant, the places are smoothed."""

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
"""Of solving, smoothing and judging the boxes again; the choice of boxes rests after two."""
STATURES = 0.87, 1.15
"""Standing heights, as shares of the usual one: two and a half standard deviations of adults. Who is lower all the time does
not stand."""
FREE_SD = 0.35
"""Metres: what is assumed of a highest point while it is found out how tall a person is, and who crouches."""
HEIGHT_INSTANTS = 2000
"""Instants that a person's height is taken from, at most: more would only take memory."""
SPREADS = (0.7, 4.0)
"""A camera's boxes are believed to be between so many times as noisy as usual."""
USUAL_MEDIAN = 0.455
"""Median of the square of a normal variable."""
FEWEST_ROWS = 20
"""Boxes of a camera that tell how noisy they are."""
LASTING = 0.35
"""Share of an instant's own sigma that smoothing does not lessen: the errors of neighbouring boxes are alike, since a person's
height, stance and what hides the person last."""
MODEL_SD = 0.05
"""Metres, in each of two directions: a body's middle is not above the middle between its feet, for arms, stride and load.
Without any noise upright people are placed to 0.05 to 0.09 m (root mean square) in simulated scenes,"""
BENT_SD, BENT = 0.11, 0.12
"""and those whose highest point is this share below where it is when they stand, who crouch, bend or sit, to 0.15 to 0.2 m."""


@dataclass(frozen=True, eq=False)
class IdentityTrajectory:
    """Where a person was at W instants."""

    xy: Floats
    """(W, 2) metres."""
    middle: Floats
    """(W,) height of the body's middle above the ground, metres."""
    sigma: Floats
    """(W,) root of the trace of the place's covariance, metres."""
    cameras: Ints
    """(W,) cameras that agree; 0 for an instant that lies between others."""
    part: Ints
    """(W,) number of the stretch without long gaps, from 0."""
    row: Ints
    """(W,) rows of the instants asked for."""
    accepted: Bools
    """(M,) boxes that it uses."""
    miss_m: Floats
    """(M,) distance of each box's ray from the body's middle, metres; NaN for one that is not accepted."""


def estimate_identity_trajectories(
    people: Sequence[Sightings], instants: Floats, max_gap_s: float, person_height_m: float, foot_shift: float
) -> list[IdentityTrajectory]:
    """The ways of several identities, each by itself; only their smoothing is done side by side.

    Args:
        people: of each identity its M boxes, sorted by time step, then by camera, rays in the world's frame; a block is one of
            its T time steps.
        instants: (T',) all instants of the recording, ascending, those of the people among them.
        max_gap_s: longest time without an agreeing box that is bridged.
        person_height_m: typical standing height, metres.
        foot_shift: how much nearer to a camera the lowest visible point is than the body's axis, as a share of the height.
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
    """What is known of a person at T instants."""

    body: Floats
    """(T, 3) x, y, top; where nothing was accepted the last that was known."""
    height: float
    spread: Floats
    """(M,) by how much the boxes are noisier than usual."""
    covariance: Floats | None = None
    """(T, 2, 2) of x, y; None before anything was solved."""
    measured: Bools | None = None
    """(T,) whether a box was accepted."""
    miss_m: Floats | None = None
    """(M,) distances of rays from the body's middle."""


@dataclass(frozen=True, eq=False)
class _Walk:
    """One identity on its way through the rounds."""

    seen: Sightings
    alone: Floats
    """(M, 2) where each box by itself puts the person."""
    alone_covariance: Floats
    """(M, 2, 2)"""
    accepted: Bools
    """(M,)"""
    trust: Floats
    """(T,) by how much less than usual an instant is believed, 0 to 1."""
    state: _State
    row: Ints
    """(W,) rows of the instants that its way is made of,"""
    part: Ints
    """(W,) and the number of the stretch of each."""


def _begun(seen: Sightings, person_height_m: float, foot_shift: float) -> _Walk:
    """Before the first round: the boxes have voted."""
    alone, covariance = single_view_bodies(seen, person_height_m, foot_shift * person_height_m)
    covariance = covariance[:, :2, :2]
    accepted = vote(seen.block, seen.camera, seen.block_seconds, alone[:, :2], covariance)
    state = _State(_mean_bodies(seen, alone, accepted), person_height_m, np.ones(len(accepted)))
    nothing = np.zeros(0, np.int64)
    return _Walk(seen, alone[:, :2], covariance, accepted, np.ones(seen.n_blocks), state, nothing, nothing)


def _stepped(walk: _Walk, instants: Floats, max_gap_s: float, person_height_m: float, foot_shift: float) -> _Walk:
    """Solved with the boxes accepted so far."""
    row, part = _asked(walk.seen, walk.accepted, instants, max_gap_s)
    return replace(walk, state=_solve(walk.seen, walk.accepted, walk.state, foot_shift, person_height_m), row=row, part=part)


def _judged(walk: _Walk, instants: Floats, xy: Floats, covariance: Floats) -> _Walk:
    """The boxes and the instants, judged by the smoothed way (W, 2) and its covariance (W, 2, 2)."""
    seen, state = walk.seen, walk.state
    assert state.covariance is not None
    # An instant that lies outside all parts has no smoothed place: nothing that was seen then is believed.
    here, here_covariance = _at(walk, instants, xy), _at(walk, instants, covariance)
    spread = np.maximum(state.spread, 1.0)[:, None, None] ** 2
    with np.errstate(invalid="ignore"):
        off2 = mahalanobis_squared(walk.alone - here[seen.block], walk.alone_covariance * spread + here_covariance[seen.block])
        missed2 = mahalanobis_squared(state.body[:, :2] - here, state.covariance)
    trust = np.where(np.isfinite(missed2), cauchy_weights(missed2 / FITS), 1.0)
    return replace(walk, accepted=off2 < FITS, trust=trust)


def _mean_bodies(seen: Sightings, alone: Floats, accepted: Bools) -> Floats:
    """(T, 3) mean of what the accepted boxes say one by one."""
    total = group_sums(seen.block[accepted], alone[accepted], seen.n_blocks)
    count = np.bincount(seen.block[accepted], minlength=seen.n_blocks)
    return np.asarray(total / np.maximum(count, 1)[:, None])


def _solve(seen: Sightings, accepted: Bools, state: _State, foot_shift: float, person_height_m: float) -> _State:
    """The bodies by the accepted boxes, the person's height, and how noisy the cameras are."""
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
    """The standing height by highest points that two cameras or more saw; the usual one where there are too few."""
    if len(top) < MIN_INSTANTS:
        return person_height_m
    every = max(1, len(top) // HEIGHT_INSTANTS)
    return float(np.clip(standing_share(top[::every] / person_height_m), *STATURES)) * person_height_m


def _spread(camera: Ints, residual: Floats, count: Ints) -> Floats:
    """(K,) how noisy each box's camera is, by residuals (K, 2) of boxes at instants with `count` (K,) accepted ones."""
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
    """Rows of the instants between the first and the last accepted box of each part, and the parts' numbers."""
    at = np.unique(np.searchsorted(instants, seen.block_seconds)[seen.block[accepted]])
    if not len(at):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    cut = np.flatnonzero(np.diff(instants[at]) > max_gap_s + 1e-9)
    first, last = at[np.append(0, cut + 1)], at[np.append(cut, len(at) - 1)]
    rows = [np.arange(low, high + 1) for low, high in zip(first, last, strict=True)]
    return np.concatenate(rows), np.repeat(np.arange(len(rows)), [len(part) for part in rows])


def _smoothed(walks: Sequence[_Walk], instants: Floats) -> list[tuple[Floats, Floats]]:
    """Of each walk (W, 2) and (W, 2, 2) at the instants asked for."""
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
    """The values (W, ...) of the instants that were asked for at the person's own instants (T, ...); NaN elsewhere."""
    at = np.searchsorted(instants, walk.seen.block_seconds)
    out = np.full((len(at), *values.shape[1:]), np.nan)
    if len(walk.row):
        index = np.minimum(np.searchsorted(walk.row, at), len(walk.row) - 1)
        here = walk.row[index] == at
        out[here] = values[index[here]]
    return out


def _result(walk: _Walk, instants: Floats, xy: Floats, covariance: Floats) -> IdentityTrajectory:
    """Everything in columns, with sigmas that keep what smoothing cannot lessen."""
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
