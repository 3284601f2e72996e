"""First focal lengths of unknown lenses, from people without identities.

As for identified people (`solver.focal_search`), the grounds below two cameras fit only at the right focal lengths. There the
registration by ground tracks finds the most people that both cameras see. Pairs of cameras are registered at focal lengths of a
coarse grid. The focal lengths are chosen at which all pairs together agree most. First all cameras have one focal length; then,
in rounds, each camera is tried at every focal length with the cameras that it agrees with most, until no camera changes.
Identities come from a registration with the lenses found, and finer focal lengths from the identities.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.ground.ground_tracks import GroundTracks, ground_tracks
from passerby.association.ground.registration import best_merit
from passerby.common.arrays import Floats
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.core.cameras import Camera, Rig
from passerby.core.unknown_focals import choose_focals, focals_to_try, shared_lenses
from passerby.geometry.single_view import Level, keep_horizon, level_by_heights
from passerby.people.sightings import upright_sightings

FOCALS = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
"""Focal lengths tried, in longer sides of the picture: steps of 1.4. The registration tolerates an error of half a step."""
FOUND_SD = 0.2
"""One sigma of the logarithm of the focal lengths found: it covers the step of the grid, and its neighbours where they fit as
well."""
_MOST_PEOPLE = 400
_PARTNERS = 3
"""Number of cameras with which a camera is tried at every focal length: those that it agrees with most so far."""

Pair = tuple[int, int]
Entry = tuple[int, int]
"""Indices into the focal lengths of both cameras of a pair."""


def search_focals_by_tracks(
    rig: Rig, cameras: Sequence[CameraTracklets], max_lag_s: float, person_height_m: float, rng: np.random.Generator,
    tell: Progress, executor: Executor | None = None,
) -> Rig:  # fmt: skip
    """Find first focal lengths of the unknown lenses. Other lenses, and those that no pair determines, stay as they are.

    Args:
        rig: names and lenses.
        cameras: their tracklets, built with these lenses.
        max_lag_s: largest difference of two clocks, seconds; 0 takes them as synchronised.
        person_height_m: expected standing height, metres.
        rng: draws people.
        tell: reports the pairs done.
        executor: registers pairs in parallel.
    """
    focals = [focals_to_try(camera.lens, FOCALS) for camera in rig]
    tracks = [
        _tracks(camera, cameras[c], focals[c], person_height_m, rng) for c, camera in enumerate(rig)
    ]  # fmt: skip
    pairs = [
        (a, b) for a in range(len(rig)) for b in range(a + 1, len(rig)) if len(focals[a]) * len(focals[b]) > 1
    ]  # fmt: skip
    counts, shared = [len(one) for one in focals], shared_lenses(rig)
    costs = {(a, b): np.zeros((counts[a], counts[b])) for a, b in pairs}
    known, chosen = {pair: set[Entry]() for pair in pairs}, list[int]()
    wanted = {pair: _diagonal(counts[pair[0]], counts[pair[1]]) for pair in pairs}
    for number in itertools.count(1):
        jobs = [
            _Job(pair, tracks[pair[0]], tracks[pair[1]], tuple(sorted(wanted[pair] - known[pair])), max_lag_s) for pair in pairs
        ]
        jobs = [job for job in jobs if job.entries]
        if not jobs:
            break
        stage = "focal lengths" if number == 1 else f"focal lengths, round {number}"
        for job, found in zip(jobs, side_by_side(_costs, jobs, executor, tell, stage), strict=True):
            costs[job.pair][tuple(np.transpose(job.entries))] = found
            known[job.pair].update(job.entries)
        chosen = choose_focals(counts, costs, shared)
        partners = _partners(costs, shared)
        wanted = {(a, b): _cross(costs[a, b].shape, chosen[a], chosen[b]) if (a, b) in partners else set() for a, b in pairs}
    compared = {c for pair, table in costs.items() if table.any() for c in pair}
    out = list(rig)
    for c in (c for members in shared if compared & set(members) for c in members):
        if len(focals[c]) > 1:
            out[c] = replace(out[c], lens=out[c].lens.started(float(np.exp(focals[c][chosen[c]])), FOUND_SD))
    return replace(rig, cameras=tuple(out))


def _tracks(
    camera: Camera, tracklets: CameraTracklets, focals: Floats, person_height_m: float, rng: np.random.Generator
) -> tuple[GroundTracks | None, ...]:
    """Compute one camera's ground tracks at each focal length; None where they cannot be levelled."""
    out: list[GroundTracks | None] = []
    level, before = None, 0.0
    for focal in focals.tolist():
        lens = camera.lens.started(float(np.exp(focal)), FOUND_SD)
        bodies = upright_sightings(tracklets.seen, lens, tracklets.clock)
        some = np.sort(rng.permutation(len(bodies))[:_MOST_PEOPLE])
        u = bodies.take(some)
        body, foot = person_height_m * (u.top_fraction - u.bottom_fraction), person_height_m * u.bottom_fraction
        start = None if level is None else Level(keep_horizon(level.up, float(np.exp(focal - before))), level.height, 0.0)
        level, before = level_by_heights(u.top, u.bottom, u.top_tangent, u.extent_px, body, foot, start), focal
        out.append(None if level is None else ground_tracks(bodies, level))
    return tuple(out)


def _diagonal(first: int, second: int) -> set[Entry]:
    """Return entries with both cameras at one focal length of the grid; at all of them where one lens is known."""
    most = max(first, second)
    return {(round(k * (first - 1) / max(most - 1, 1)), round(k * (second - 1) / max(most - 1, 1))) for k in range(most)}


def _cross(shape: tuple[int, ...], i: int, j: int) -> set[Entry]:
    """Return entries with one camera at the chosen focal length, and the other at every focal length."""
    return {(i, k) for k in range(shape[1])} | {(k, j) for k in range(shape[0])}


def _partners(costs: Mapping[Pair, Floats], shared: Sequence[Sequence[int]]) -> set[Pair]:
    """Return the pairs of each camera with the cameras it agrees with most; pairs with a shared lens are left out."""
    lens_of = {c: number for number, members in enumerate(shared) for c in members}
    ranked: dict[int, list[tuple[float, Pair]]] = {}
    for pair, table in costs.items():
        if lens_of[pair[0]] != lens_of[pair[1]]:
            for c in pair:
                ranked.setdefault(c, []).append((float(table.min(initial=0.0)), pair))
    return {pair for own in ranked.values() for _, pair in sorted(own)[:_PARTNERS]}


@dataclass(frozen=True, eq=False)
class _Job:
    pair: Pair
    a: tuple[GroundTracks | None, ...]
    b: tuple[GroundTracks | None, ...]
    entries: tuple[Entry, ...]
    max_lag_s: float


def _costs(job: _Job) -> Floats:
    """Return the costs (entries,) of a pair at two focal lengths each: minus the agreement; 0 where nothing fits."""
    out = np.zeros(len(job.entries))
    for k, (i, j) in enumerate(job.entries):
        a, b = job.a[i], job.b[j]
        if a is not None and b is not None and len(a) and len(b):
            out[k] = -best_merit(a, b, job.max_lag_s)
    return out
