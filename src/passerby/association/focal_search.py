"""First focal lengths of unknown lenses, from people without identities.

As among identified people (`solver.focal_search`), the grounds below two cameras fit at the right focal lengths only: there the
registration by ground tracks finds most people who walk together. Every pair of cameras is registered at every two focal
lengths of a coarse grid, and those are taken at which the pairs together agree most. Identities come from a registration with
the lenses found, and finer focal lengths from the identities.
"""

from __future__ import annotations

from collections.abc import Sequence
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
"""Focal lengths tried, in longer sides of the picture: steps of 1.4, of which the registration bears half."""
FOUND_SD = 0.2
"""What the focal lengths found are off by, one sigma of their logarithm: the step of the grid, and its
neighbours where they do as well."""
_MOST_PEOPLE = 400


def search_focals_by_tracks(
    rig: Rig, cameras: Sequence[CameraTracklets], max_lag_s: float, person_height_m: float, rng: np.random.Generator,
    tell: Progress, executor: Executor | None = None,
) -> Rig:  # fmt: skip
    """The rig with first focal lengths of the unknown lenses; the others, and those that no pair determines, stay.

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
    jobs = [_Job(tracks[a], tracks[b], max_lag_s) for a, b in pairs]
    tables = dict(zip(pairs, side_by_side(_costs, jobs, executor, tell, "focal lengths"), strict=True))
    told = {pair: table for pair, table in tables.items() if table.any()}
    shared, compared = shared_lenses(rig), {c for pair in told for c in pair}
    chosen = choose_focals([len(one) for one in focals], told, shared)
    out = list(rig)
    for c in (c for members in shared if compared & set(members) for c in members):
        if len(focals[c]) > 1:
            out[c] = replace(out[c], lens=out[c].lens.started(float(np.exp(focals[c][chosen[c]])), FOUND_SD))
    return replace(rig, cameras=tuple(out))


def _tracks(
    camera: Camera, tracklets: CameraTracklets, focals: Floats, person_height_m: float, rng: np.random.Generator
) -> tuple[GroundTracks | None, ...]:
    """One camera's ground tracks at each focal length."""
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


@dataclass(frozen=True, eq=False)
class _Job:
    a: tuple[GroundTracks | None, ...]
    b: tuple[GroundTracks | None, ...]
    max_lag_s: float


def _costs(job: _Job) -> Floats:
    """(F_a, F_b) how little a pair agrees at every two focal lengths; 0 where nothing fits."""
    cost = np.zeros((len(job.a), len(job.b)))
    for i, a in enumerate(job.a):
        for j, b in enumerate(job.b):
            if a is not None and b is not None and len(a) and len(b):
                cost[i, j] = -best_merit(a, b, job.max_lag_s)
    return cost
