"""Corridors of many cameras in one group, people known: what zones and the adjustment of all take, and how sure it is."""

from __future__ import annotations

import multiprocessing
import resource
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import AdjustedFigures
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.solver.people import solve_people

EVERY_M, ASIDE_M, HEIGHT_M, AHEAD_M, REACH_M = 5.0, 4.0, 3.0, 5.0, 13.0
"""Cameras on alternating sides of the corridor: how far apart, beside its middle and above the ground, how far ahead they look,
and how far off they see people."""
OF_CAMERA, INSTANTS, BOX_NOISE = 0.5, 400, 0.01
"""People for each camera; instants; noise of a box's edges, as a share of its height."""
FAR_M = 100.0
FIRST_SEED = 830
LENS = Lens((1280, 720), np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]), np.zeros(0))


def corridors(seeds: int) -> dict[str, tuple[int, int]]:
    """Number of cameras and seed of each corridor by key."""
    del seeds
    return {f"{count} cameras": (count, FIRST_SEED) for count in (75, 150, 300)}


def corridor(count: int) -> Rig:
    """Cameras that all look a little ahead."""
    cameras = []
    for k in range(count):
        centre = np.array([EVERY_M * k, ASIDE_M * (1 if k % 2 else -1), HEIGHT_M])
        cameras.append(Camera(f"C{k + 1}", LENS, _looking(centre, np.array([EVERY_M * k + AHEAD_M, 0.0, 0.9]))))
    return Rig(tuple(cameras))


def _looking(centre: np.ndarray, at: np.ndarray) -> Pose:
    """The level pose of a camera that looks at a point."""
    forward = (at - centre) / np.linalg.norm(at - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Pose.from_centre(np.array([right, np.cross(forward, right), forward]), centre)


def people_in(rig: Rig, rng: np.random.Generator) -> Observations:
    """People at random places at each instant, as boxes in the cameras that are near."""
    n = round(OF_CAMERA * len(rig))
    height = np.tile(rng.normal(1.74, 0.07, n), INSTANTS)
    ground = np.column_stack([
        rng.uniform(0, EVERY_M * len(rig) + AHEAD_M, n * INSTANTS), rng.uniform(-3, 3, n * INSTANTS), np.zeros(n * INSTANTS),
    ])  # fmt: skip
    frame, identity = np.repeat(np.arange(1, INSTANTS + 1), n), np.tile(np.arange(1, n + 1), INSTANTS)
    out = {}
    for camera in rig:
        assert camera.pose is not None
        near = np.flatnonzero(np.linalg.norm(ground[:, :2] - camera.pose.centre[:2], axis=1) < REACH_M)
        foot, head = camera.project(ground[near]), camera.project(ground[near] + np.outer(height[near], [0.0, 0.0, 1.0]))
        tall = foot[:, 1] - head[:, 1]
        ltwh = np.column_stack([0.5 * (foot[:, 0] + head[:, 0]) - 0.2 * tall, head[:, 1], 0.4 * tall, tall])
        ltwh += BOX_NOISE * tall[:, None] * rng.normal(size=ltwh.shape)
        with np.errstate(invalid="ignore"):
            inside = (ltwh[:, :2] > 1).all(axis=1) & (ltwh[:, :2] + ltwh[:, 2:] < np.array(camera.lens.size) - 1).all(axis=1)
        rows = near[inside]
        boxes = Boxes(frame[rows], identity[rows], ltwh[inside], np.ones(len(rows)))
        out[camera.name] = CameraObservations(boxes, Keypoints.empty())
    return Observations(out)


def measure(case: tuple[int, int]) -> dict[str, Any]:
    """Time and memory of one solve in a process of its own, and its errors."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as alone:
        return alone.submit(_measured, case).result()


def _measured(case: tuple[int, int]) -> dict[str, Any]:
    truth = corridor(case[0])
    seen = people_in(truth, np.random.default_rng(case[1]))
    blank = Rig(tuple(replace(camera, pose=None) for camera in truth))
    cpu, wall = time.process_time(), time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        solution = solve_people(blank, seen, ScaleCues(), rng=np.random.default_rng(0))
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        within, alone = _zones_alone(solution, blank, truth, seen)
    figures = solution.figures
    assert isinstance(figures, AdjustedFigures)
    errors = compare(solution.rig.posed(), truth).similarity
    off = _distance_errors(figures, truth)
    return {
        "cameras": len(truth), "cpu_s": cpu, "wall_s": wall, "memory_mb": memory_mb, "registered": len(solution.rig.posed()),
        "verdict": solution.verdict, "zones": len(figures.zones or ()), "position_mm": errors.median_position_mm,
        "orientation_deg": errors.median_orientation_deg, "far": len(off), "within_2": float(np.mean(np.abs(off) < 2)),
        "of_zones_mm": within, "alone_mm": alone,
    }  # fmt: skip


def _zones_alone(solution: Solution, blank: Rig, truth: Rig, seen: Observations) -> tuple[float, float]:
    """Medians over all zones' cameras of their position errors after the best similarity of their zone, millimetres: in the
    whole rig, and with the zone solved alone.
    """
    assert isinstance(solution.figures, AdjustedFigures)
    whole: list[float] = []
    alone: list[float] = []
    for zone in solution.figures.zones or ():
        part = Rig(tuple(blank[name] for name in zone.cameras))
        own = Observations({name: seen[name] for name in zone.cameras})
        by_itself = solve_people(part, own, ScaleCues(), rng=np.random.default_rng(0)).rig.posed()
        for rig, errors in ((_of(solution.rig, zone.cameras), whole), (by_itself, alone)):
            errors += compare(rig, truth).similarity.position_mm.values()
    return float(np.median(whole)), float(np.median(alone))


def _of(rig: Rig, names: Sequence[str]) -> Rig:
    return Rig(tuple(rig[name] for name in names)).posed()


def _distance_errors(figures: AdjustedFigures, truth: Rig) -> np.ndarray:
    """Errors of the distances of cameras that are far from each other, over their sigmas; infinite where no sigma is told."""
    off = []
    for one in figures.distances:
        first, second = (truth[name].pose for name in one.cameras)
        assert first is not None
        assert second is not None
        metres = float(np.linalg.norm(first.centre - second.centre))
        if metres >= FAR_M:
            off.append((one.metres - metres) / one.sigma_m if one.sigma_m else np.inf)
    return np.array(off)
