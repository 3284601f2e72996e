"""Speed zones drawn at random in the images of a calibrated rig: their sides on the ground against the true ones."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from passerby.calibration.in_memory import calibrate_observations
from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.interchange.formats.frigate import MARGIN, SHORTEST_M, side_lengths
from passerby.simulation import PRESETS, SimulationOptions, simulate

FIRST_SEED, SECONDS = 800_000, 60.0
BOX_NOISE, MISSING = 0.02, 0.1
ZONES = 100  # of a rig
NEAREST_SHARE, MOST_TRIES = 0.08, 20_000
"""Smallest width and height of a zone, as a share of the image's; zones that are drawn before a rig is given up."""


@dataclass(frozen=True)
class ZoneCase:
    """One rig."""

    preset: str
    seed: int


def cases(count: int) -> dict[str, ZoneCase]:
    """`count` seeds of each preset by key."""
    drawn = [ZoneCase(preset, FIRST_SEED + seed) for seed in range(count) for preset in PRESETS]
    return {f"{case.preset} {case.seed}": case for case in drawn}


def work(case: ZoneCase) -> dict[str, Any]:
    """A rig from boxes and one known distance, and the sides of its zones: plain values."""
    options = SimulationOptions(preset=case.preset, seed=case.seed, seconds=SECONDS, box_noise=BOX_NOISE, missing=MISSING)
    scene = simulate(options)
    boxes = {name: seen.boxes for name, seen in scene.observations.cameras.items()}
    names, centres = scene.rig.names, np.array([camera.centre for camera in scene.rig])
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    one, other = np.unravel_index(int(apart.argmax()), apart.shape)
    known = {"between": [names[one], names[other]], "metres": float(apart.max())}
    began = time.process_time()
    found = calibrate_observations(
        scene.rig, fps=options.fps, association={"mode": "given"}, boxes=boxes, scale={"distances": [known]}
    )
    posed = found.rig.posed()
    errors = zone_errors(posed, scene.rig, np.random.default_rng((case.seed, 4))) if len(posed) else []
    return {
        "about": {"preset": case.preset}, "cpu_s": time.process_time() - began, "verdict": found.verdict,
        "zones": len(errors) // 4, "percent": errors,
    }  # fmt: skip


def zone_errors(rig: Any, truth: Any, rng: np.random.Generator) -> list[float]:
    """Of all sides of `ZONES` zones, how far each is off, per cent; a side that the rig gives no length is infinitely wrong."""
    found: list[float] = []
    names = rig.names
    for _ in range(MOST_TRIES):
        if len(found) == 4 * ZONES:
            break
        name = names[int(rng.integers(len(names)))]
        corners = _drawn(truth[name], rng)
        true = side_lengths(truth[name], corners)
        if not (np.isfinite(true).all() and true.min() >= SHORTEST_M):
            continue
        sides = side_lengths(rig[name], corners)
        off = 100 * np.abs(sides / true - 1)
        found += np.where(np.isfinite(off), off, np.inf).tolist()
    return found


def _drawn(camera: Camera, rng: np.random.Generator) -> Floats:
    """(4, 2) corners of a rectangle in the image."""
    low, high = np.sort(rng.uniform(MARGIN, 1 - MARGIN, (2, 2)), axis=0)
    high = np.maximum(high, low + NEAREST_SHARE)
    return np.array(camera.lens.size) * np.array([low, (high[0], low[1]), high, (low[0], high[1])]) - 0.5


def all_errors(done: Mapping[str, Mapping[str, Any]]) -> Floats:
    """Of all sides of all zones, per cent."""
    return np.array([value for case in done.values() for value in case["percent"]])
