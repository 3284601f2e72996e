"""The way of one identity: its boxes vote, those that agree are solved for a body at each instant, the places are smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Floats
from passerby.solver.standing import MIN_INSTANTS, standing_share
from passerby.tracks3d.bodies import STANCE_SD, Rays, measure, stand, stand_alone
from passerby.tracks3d.smoothing import smooth
from passerby.tracks3d.voting import FITS, apart2, vote

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

ROUNDS = 3
"""Of solving, smoothing and judging the boxes again; the choice of boxes rests after two."""
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
height, stance and what hides him last."""
MODEL_SD = 0.05
"""Metres, in each of two directions: a body's middle is not above the middle between its feet, for arms, stride and load.
Without any noise upright people are placed to 0.05 to 0.09 m (root mean square) in simulated scenes,"""
BENT_SD, BENT = 0.11, 0.12
"""and those whose highest point is this share below where it is when they stand, who crouch, bend or sit, to 0.15 to 0.2 m."""


@dataclass(frozen=True, eq=False)
class Seen:
    """M boxes of one identity, sorted by instant, then by camera; T instants."""

    instant: Ints
    """(M,) rows of `seconds`."""
    camera: Ints
    """(M,) rows of the rig's cameras."""
    rays: Rays
    seconds: Floats
    """(T,) ascending."""


@dataclass(frozen=True, eq=False)
class Way:
    """Where somebody was at W instants."""

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
    """(M,) boxes that it rests on."""
    miss_m: Floats
    """(M,) distance of each box's ray from the body's middle, metres; NaN for one that is not accepted."""
    height_m: float
    """Highest point of the body where it stands."""


def follow(seen: Seen, instants: Floats, max_gap_s: float, body_m: float, foot_shift: float) -> Way:
    """One identity's way.

    Args:
        seen: its boxes.
        instants: (T',) all instants of the recording, ascending, those of `seen` among them.
        max_gap_s: longest time without an agreeing box that is bridged.
        body_m: typical standing height, metres.
        foot_shift: how much nearer to a camera the lowest visible point is than the body's axis, as a share of the height.
    """
    alone, alone_covariance, _ = stand_alone(seen.rays, body_m, foot_shift * body_m)
    alone_covariance = alone_covariance[:, :2, :2]
    accepted = vote(seen.instant, seen.camera, seen.seconds, alone[:, :2], alone_covariance)
    state = _State(_mean_bodies(seen, alone, accepted), body_m, np.ones(len(accepted)))
    trust = np.ones(len(seen.seconds))
    for number in range(ROUNDS):
        state = _solve(seen, accepted, state, foot_shift, body_m)
        row, part = _asked(seen, accepted, instants, max_gap_s)
        smoothed = _smoothed(seen, state, trust, instants, row, part)
        if number == ROUNDS - 1:
            break
        # An instant that lies outside all parts has no smoothed place: nothing that was seen then is believed.
        xy, covariance = _at(seen, instants, row, smoothed[0]), _at(seen, instants, row, smoothed[1])
        spread = np.maximum(state.spread, 1.0)[:, None, None] ** 2
        with np.errstate(invalid="ignore"):
            off2 = apart2(alone[:, :2] - xy[seen.instant], alone_covariance * spread + covariance[seen.instant])
            accepted = off2 < FITS
            assert state.covariance is not None
            missed2 = apart2(state.body[:, :2] - xy, state.covariance)
        trust = np.where(np.isfinite(missed2), 1 / (1 + missed2 / FITS), 1.0)
    return _result(seen, state, smoothed, accepted, instants, row, part)


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


def _mean_bodies(seen: Seen, alone: Floats, accepted: Bools) -> Floats:
    """(T, 3) mean of what the accepted boxes say one by one."""
    total = _sums(seen.instant[accepted], alone[accepted], len(seen.seconds))
    count = np.bincount(seen.instant[accepted], minlength=len(seen.seconds))
    return np.asarray(total / np.maximum(count, 1)[:, None])


def _solve(seen: Seen, accepted: Bools, state: _State, foot_shift: float, body_m: float) -> _State:
    """The bodies by the accepted boxes, the person's height, and how noisy the cameras are."""
    rows = np.flatnonzero(accepted)
    instant, n = seen.instant[rows], len(seen.seconds)
    rays = seen.rays.take(rows)
    count = np.bincount(instant, minlength=n)
    body, height = np.array(state.body), state.height
    for _ in range(2):
        found = measure(rays, body[instant], foot_shift * height)
        weight = state.spread[rows] ** -2
        information = _sums(instant, (found.information * weight[:, None, None]).reshape(-1, 9), n).reshape(-1, 3, 3)
        pull = _sums(instant, found.pull * weight[:, None], n)
        top = stand(information, pull, np.full(n, height), np.full(n, FREE_SD))[0][:, 2]
        height = _height(top[count > 1], body_m)
        sd = STANCE_SD * height
        sd_here = sd * np.sqrt(1 + ((top - height) / (2 * sd)) ** 2)
        solved, covariance = stand(information, pull, np.full(n, height), sd_here)
        body[count > 0] = solved[count > 0]
    body[:, 2] = np.clip(body[:, 2], 0.3 * height, 1.3 * height)
    residual = (found.by_body @ body[instant][:, :, None])[:, :, 0] - found.value
    miss = np.full(len(accepted), np.nan)
    miss[rows] = np.linalg.norm(residual[:, :2], axis=1) * rays.centre_sd * found.distance
    spread = np.array(state.spread)
    spread[rows] = _spread(seen.camera[rows], residual[:, :2], count[instant])
    return _State(body, height, spread, covariance[:, :2, :2], count > 0, miss)


def _height(top: Floats, body_m: float) -> float:
    """The standing height by highest points that two cameras or more saw; the usual one where there are too few."""
    if len(top) < MIN_INSTANTS:
        return body_m
    every = max(1, len(top) // HEIGHT_INSTANTS)
    return float(np.clip(standing_share(top[::every] / body_m), 0.75, 1.25)) * body_m


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


def _asked(seen: Seen, accepted: Bools, instants: Floats, max_gap_s: float) -> tuple[Ints, Ints]:
    """Rows of the instants between the first and the last accepted box of each part, and the parts' numbers."""
    at = np.unique(np.searchsorted(instants, seen.seconds)[seen.instant[accepted]])
    if not len(at):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    cut = np.flatnonzero(np.diff(instants[at]) > max_gap_s + 1e-9)
    first, last = at[np.append(0, cut + 1)], at[np.append(cut, len(at) - 1)]
    rows = [np.arange(low, high + 1) for low, high in zip(first, last, strict=True)]
    return np.concatenate(rows), np.repeat(np.arange(len(rows)), [len(part) for part in rows])


def _smoothed(seen: Seen, state: _State, trust: Floats, instants: Floats, row: Ints, part: Ints) -> tuple[Floats, Floats]:
    """(W, 2) and (W, 2, 2) at the instants asked for."""
    assert state.covariance is not None
    assert state.measured is not None
    place, covariance = np.full((len(row), 2), np.nan), np.tile(np.eye(2), (len(row), 1, 1))
    index = np.searchsorted(row, np.searchsorted(instants, seen.seconds)[state.measured])
    place[index] = state.body[state.measured, :2]
    covariance[index] = (state.covariance / trust[:, None, None])[state.measured]
    return smooth(instants[row], place, covariance, part)


def _at(seen: Seen, instants: Floats, row: Ints, values: Floats) -> Floats:
    """The values (W, ...) of the instants that were asked for at the person's own instants (T, ...); NaN elsewhere."""
    at = np.searchsorted(instants, seen.seconds)
    out = np.full((len(at), *values.shape[1:]), np.nan)
    if len(row):
        index = np.minimum(np.searchsorted(row, at), len(row) - 1)
        here = row[index] == at
        out[here] = values[index[here]]
    return out


def _result(
    seen: Seen, state: _State, smoothed: tuple[Floats, Floats], accepted: Bools, instants: Floats, row: Ints, part: Ints
) -> Way:
    """Everything in columns, with sigmas that keep what smoothing cannot lessen."""
    assert state.covariance is not None
    assert state.measured is not None
    assert state.miss_m is not None
    xy, covariance = smoothed
    known = np.flatnonzero(state.measured)
    own = instants[row]
    count = np.zeros(len(row), np.int64)
    count[np.searchsorted(row, np.searchsorted(instants, seen.seconds)[known])] = np.bincount(
        seen.instant[accepted], minlength=len(seen.seconds)
    )[known]
    variance = np.trace(covariance, axis1=1, axis2=2)
    if not len(known):
        return Way(xy, variance, variance, count, part, row, accepted, np.full(len(accepted), np.nan), state.height)
    lasting = np.interp(own, seen.seconds[known], np.trace(state.covariance[known], axis1=1, axis2=2))
    top = np.interp(own, seen.seconds[known], state.body[known, 2])
    bent = BENT_SD * np.clip((1 - top / state.height) / BENT, 0.0, 1.0)
    sigma = np.sqrt(variance + LASTING**2 * lasting + 2 * (MODEL_SD**2 + bent**2))
    return Way(xy, top / 2, sigma, count, part, row, accepted, np.where(accepted, state.miss_m, np.nan), state.height)


def _sums(group: Ints, values: Floats, n: int) -> Floats:
    """(n, K) sums of the rows (M, K) of each group."""
    return np.stack([np.bincount(group, values[:, k], minlength=n) for k in range(values.shape[1])], axis=1)
