"""Simulated scenes, many seeds: both solvers without faults, and the person model with swapped identities."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from command import ONE_THREAD, Calibrated, calibrate, passerby
from datasets import Goal

PRESETS = {
    "terrace": Goal((15, 0.12), (7.5, 0.06)),
    "basketball": Goal((30, 0.12), (15, 0.06)),
    "construction": Goal((15, 0.06), (7.5, 0.03)),
}
SCALE_GOAL = (0.03, 0.015)
"""Error of the scale, acceptable and aim."""
GRAVITY_GOAL_DEG, GROUND_GOAL_MM = 0.3, 50.0
BOX_NOISE = 0.02
WORKERS = 2


@dataclass(frozen=True)
class Case:
    """One simulated scene and how it is solved."""

    preset: str
    seed: int
    method: str = "people"
    swaps: float = 0.0
    person_height_m: float | None = None
    """The height that the solver assumes; the simulated mean unless given."""


def run_cases(cases: Sequence[Case], scratch: Path) -> dict[Case, Calibrated]:
    """Simulate and calibrate through the command line, two at a time, one thread each."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return dict(zip(cases, pool.map(lambda case: _run_case(case, scratch), cases), strict=True))


def _run_case(case: Case, scratch: Path) -> Calibrated:
    folder = scratch / f"{case.preset}-{case.seed}-{case.method}-{case.swaps:g}"
    arguments = ["--preset", case.preset, "--seed", str(case.seed), "--box-noise", str(BOX_NOISE)]
    if case.swaps:
        arguments += ["--identity-swaps", str(case.swaps)]
    passerby("simulate", *arguments, "-o", str(folder), environment=ONE_THREAD)
    scene = folder / "scene.toml"
    content = tomllib.loads(scene.read_text())
    content["solver"]["method"] = case.method
    if case.person_height_m is not None:
        content["scale"]["person_height_m"] = case.person_height_m
    scene.write_text(tomli_w.dumps(content))
    return calibrate(scene, folder / "truth.toml", folder.with_name(f"{folder.name}-out"), environment=ONE_THREAD)


def figures(results: Sequence[Calibrated], *path: str) -> list[float]:
    """One figure of `evaluate --json` over the seeds; infinite where it is undefined, so that no failure is averaged away."""

    def of(result: Calibrated) -> float:
        value: Any = result.errors
        for key in path:
            value = None if value is None else value.get(key)
        return float("inf") if value is None or not complete(result) else float(value)

    return [of(result) for result in results]


def mean(results: Sequence[Calibrated], *path: str) -> float:
    """The mean of a figure over the seeds."""
    return float(np.mean(figures(results, *path)))


def complete(result: Calibrated) -> bool:
    """Whether all cameras were registered."""
    return result.errors is not None and result.errors["registered"] == result.cameras
