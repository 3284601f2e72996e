"""Ordinary scenes: what users record, drawn from a seed. Their rigs should be accepted."""

from __future__ import annotations

from typing import Any

import numpy as np

from passerby.simulation import PRESETS, SimulationOptions, simulate
from reliability.judging import judge
from reliability.staging import HandedIn

CAMERAS, CAMERA_SHARES = (3, 4, 5, 6, 7, 8), (0.3, 0.35, 0.2, 0.08, 0.04, 0.03)
"""Mostly few: a scene of eight cameras takes as long as ten of three."""


def ordinary_options(seed: int) -> SimulationOptions:
    """What the scene of a seed is like."""
    rng = np.random.default_rng((seed, 2000))
    preset = list(PRESETS)[seed % len(PRESETS)]
    given = bool(seed // len(PRESETS) % 2)
    return SimulationOptions(
        preset=preset,
        seed=seed,
        cameras=int(rng.choice(CAMERAS, p=CAMERA_SHARES)),
        people=int(rng.integers(4, 15)),
        seconds=float(rng.uniform(20.0, 60.0)),
        box_noise=float(rng.uniform(0.01, 0.04)),
        false_boxes=float(rng.uniform(0.0, 0.1)),
        missing=float(rng.uniform(0.0, 0.1)),
        unrelated_ids=not given,
        tracklet_seconds=0.0 if given else float(rng.uniform(6.0, 20.0)),
        clock_offsets=0.0 if given else float(rng.uniform(0.0, 2.0)),
    )


def ordinary_scene(seed: int) -> HandedIn:
    """The scene of a seed; its identities are given where its clocks agree."""
    options = ordinary_options(seed)
    scene = simulate(options)
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    mode = "combined" if options.unrelated_ids else "given"
    return HandedIn(scene.rig, boxes, scene.rig, options.fps, {"association": {"mode": mode}})


def work(seed: int) -> dict[str, Any]:
    """The scene of a seed: its verdict, and how wrong its rig is."""
    return judge(ordinary_scene(seed))
