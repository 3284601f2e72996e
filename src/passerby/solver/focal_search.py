"""Initial focal lengths of unknown lenses, from the fit of the grounds below two cameras.

One view barely determines a focal length: with a wrong one, a level camera's ground is stretched along the view, and people
appear as tall as before. Two views do determine it. Where both see the same people, the two grounds are one plane, rotated and
shifted. At wrong focal lengths, each is stretched in its own direction, and no rotation makes them fit, except for two cameras
that face each other. Every camera is therefore levelled at each focal length of a grid, and every pair is fitted at every two
of them. The focal lengths with the lowest total cost of all pairs are taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.unknown_focals import choose_focals, focals_to_try, shared_lenses
from passerby.geometry.groups import cauchy_weights
from passerby.geometry.single_view import Level, keep_horizon, level_by_heights
from passerby.people.sightings import Sightings
from passerby.solver.evidence import Evidence
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.pairs import MIN_MATCHES, shared_rows

Complexes = NDArray[np.complex128]

FOCALS = np.geomspace(0.45, 3.0, 14)
"""Focal lengths tried, in units of the longer side of the image: steps of 1.16."""
FOUND_SD = 0.1
"""One sigma of the logarithm of focal lengths from the search. Their error was 6.5 % over 60 cameras of 15 simulated scenes
(three presets, seeds 900 to 904, boxes with 2 % noise), at most 19 %."""
# Largest numbers of people by which a camera is levelled, of matches of two cameras that are compared, of pairs of matches that
# propose a rotation, and of matches by which these are compared; more add no information.
_MOST_PEOPLE, _MOST_MATCHES, _TRIALS, _TRIED = 400, 500, 300, 200
# Standard deviation of a place on the ground, metres and as a share of its distance; largest distance of a place, metres.
_FLOOR_M, _SHARE, _FARTHEST_M = 0.15, 0.05, 80.0
# Cost per match at focal lengths that give most people no place on the ground: as if all differed by 10 sigmas.
_NOWHERE = float(np.log1p(10.0**2))


@dataclass(frozen=True, eq=False)
class _Grounds:
    """Places of one camera's people on its ground, at each focal length tried."""

    focals: Floats
    """(F,) logarithms of the factor on the stated focal length."""
    places: list[Complexes | None]
    """Per focal length, places (M,) of the camera's sightings, x + iy, metres; NaN above the horizon. None where the camera
    could not be levelled."""


def search_focals(
    evidence: Evidence, stated: Rig, unknowns: LensUnknowns, person_height_m: float, rng: np.random.Generator
) -> Rig:
    """Search initial focal lengths, and return the rig with them; as stated where no search is needed or no pair helps.

    Args:
        evidence: sightings with identities.
        stated: lenses as stated; the focal length of an unknown one is a guess.
        unknowns: unknowns of the lenses.
        person_height_m: expected standing height, metres.
        rng: draws samples.
    """
    # Adds the pixels from which the rays were computed.
    s = unknowns.sightings(evidence.sightings, stated, np.zeros((len(stated), unknowns.size)))
    rows = [np.flatnonzero(s.camera == c) for c in range(len(stated))]
    grounds = [_grounds(s.take(rows[c]), stated, c, unknowns, person_height_m, rng) for c in range(len(stated))]
    costs: dict[tuple[int, int], Floats] = {}
    for a in range(len(stated)):
        for b in range(a + 1, len(stated)):
            if len(grounds[a].focals) * len(grounds[b].focals) == 1:
                continue
            rows_a, rows_b = shared_rows(s.camera, s.block, a, b)
            if len(rows_a) < MIN_MATCHES:
                continue
            pick = np.sort(rng.permutation(len(rows_a))[:_MOST_MATCHES])
            at_a, at_b = np.searchsorted(rows[a], rows_a[pick]), np.searchsorted(rows[b], rows_b[pick])
            costs[a, b] = pair_costs(grounds[a], grounds[b], at_a, at_b, rng)
    shared, compared = shared_lenses(stated), {c for pair in costs for c in pair}
    chosen = choose_focals([len(ground.focals) for ground in grounds], costs, shared)
    cameras = list(stated)
    for c in (c for members in shared if compared & set(members) for c in members):
        if len(grounds[c].focals) > 1:
            factor = float(np.exp(grounds[c].focals[chosen[c]]))
            cameras[c] = replace(cameras[c], lens=cameras[c].lens.started(factor, FOUND_SD))
    return replace(stated, cameras=tuple(cameras))


def _grounds(
    s: Sightings, stated: Rig, camera: int, unknowns: LensUnknowns, person_height_m: float, rng: np.random.Generator
) -> _Grounds:
    """Compute one camera's ground at each focal length tried."""
    lens = stated.cameras[camera].lens
    focals = focals_to_try(lens, FOCALS)
    some = np.sort(rng.permutation(len(s))[:_MOST_PEOPLE])
    change = np.zeros((len(stated), unknowns.size))
    places: list[Complexes | None] = []
    level, before = None, 0.0
    for focal in focals.tolist():
        change[camera, unknowns.columns_of("focal")] = focal
        seen = unknowns.sightings(s, stated, change)
        u = seen.take(some)
        body, foot = person_height_m * (u.top_fraction - u.bottom_fraction), person_height_m * u.bottom_fraction
        start = None if level is None else Level(keep_horizon(level.up, np.exp(focal - before)), level.height, 0.0)
        level, before = level_by_heights(u.top, u.bottom, u.top_tangent, u.extent_px, body, foot, start), focal
        if level is None:
            places.append(None)
            continue
        ground = level.ground_positions(seen.bottom)
        places.append(ground[:, 0] + 1j * ground[:, 1])
    return _Grounds(focals, places)


def pair_costs(a: _Grounds, b: _Grounds, at_a: Ints, at_b: Ints, rng: np.random.Generator) -> Floats:
    """Return the robust cost (F_a, F_b), summed over matches, of the fit of two grounds at every two focal lengths.

    Args:
        a: ground of the first camera.
        b: ground of the second camera.
        at_a: (K,) sightings of camera a that are matched.
        at_b: (K,) the matching sightings of camera b.
        rng: draws samples.
    """
    cost = np.full((len(a.focals), len(b.focals)), len(at_a) * _NOWHERE)
    first, second = rng.integers(min(len(at_a), _TRIED), size=(2, _TRIALS))
    for i, ground_a in enumerate(a.places):
        for j, ground_b in enumerate(b.places):
            if ground_a is not None and ground_b is not None:
                cost[i, j] = _misfit(ground_a[at_a], ground_b[at_b], first, second)
    return cost


def _misfit(x: Complexes, y: Complexes, first: Ints, second: Ints) -> float:
    """Return the robust cost of the best rotation and shift from places x (K,) to y (K,)."""
    good = np.isfinite(x) & np.isfinite(y) & (np.abs(x) < _FARTHEST_M) & (np.abs(y) < _FARTHEST_M)
    if np.count_nonzero(good) < MIN_MATCHES:
        return len(x) * _NOWHERE
    sigma = np.where(good, np.hypot(_FLOOR_M + _SHARE * np.abs(x), _FLOOR_M + _SHARE * np.abs(y)), 1.0)
    x, y = np.where(good, x, 0.0), np.where(good, y, 0.0)
    span = x[second] - x[first]
    turn = np.divide(y[second] - y[first], span, out=np.zeros_like(span), where=np.abs(span) > 1e-9)
    sound = good[first] & good[second] & (np.abs(span) > 2 * sigma[first]) & (np.abs(turn) > 0.6) & (np.abs(turn) < 1.6)
    if not sound.any():
        return len(x) * _NOWHERE
    turn = turn[sound] / np.abs(turn[sound])
    shift = y[first[sound]] - turn * x[first[sound]]
    few = np.flatnonzero(good[:_TRIED])
    miss = _squares(turn[:, None] * x[few] + shift[:, None] - y[few]) / sigma[few] ** 2
    best = int(np.argmin(np.log1p(miss).sum(axis=1)))
    T, S = turn[best], shift[best]
    for _ in range(8):
        weight = np.where(good, cauchy_weights(_squares(T * x + S - y) / sigma**2) / sigma**2, 0.0)
        total = weight.sum()
        middle_x, middle_y = (weight * x).sum() / total, (weight * y).sum() / total
        T = (weight * (y - middle_y) * np.conj(x - middle_x)).sum()
        T = T / max(abs(T), 1e-12)
        S = middle_y - T * middle_x
    cost = np.where(good, np.log1p(_squares(T * x + S - y) / sigma**2), _NOWHERE)
    return float(cost.sum())


def _squares(z: Complexes) -> Floats:
    """Return the squared absolute values, without computing roots."""
    return np.asarray(z.real**2 + z.imag**2)
