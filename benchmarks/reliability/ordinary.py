"""Ordinary scenes: what users record, drawn from a seed. Their rigs should be accepted."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from passerby.calibration.calibrate import calibrate
from passerby.scene.scene import Scene
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from reliability.judging import judge, judge_run
from reliability.staging import HandedIn, walked_places

CAMERAS, CAMERA_SHARES = (3, 4, 5, 6, 7, 8), (0.3, 0.35, 0.2, 0.08, 0.04, 0.03)
"""Mostly few: a scene of eight cameras takes as long as ten of three."""


BOXES, JOINTS, LENSES, PIXELS, PIXELS_AND_LENSES = (
    "boxes", "joints", "boxes and joints, lenses unknown", "videos", "videos, lenses unknown",
)  # fmt: skip
KINDS = (BOXES, JOINTS, BOXES, LENSES, BOXES, JOINTS, BOXES, PIXELS)
"""By turns; every other scene of videos has unknown lenses."""
MOST_CAMERAS, MOST_PEOPLE, MOST_SECONDS = 4, 8, 30.0
"""Of scenes that are rendered."""


def ordinary_kind(seed: int) -> str:
    """What is handed in of the scene of a seed."""
    turn = seed // (2 * len(PRESETS))
    kind = KINDS[turn % len(KINDS)]
    return PIXELS_AND_LENSES if kind == PIXELS and turn // len(KINDS) % 2 else kind


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
    return HandedIn(scene.rig, boxes, scene.rig, options.fps, {"association": {"mode": mode}}, walked=walked_places(scene))


def work(seed: int) -> dict[str, Any]:
    """The scene of a seed: what is handed in, its verdict, and how wrong its rig is."""
    kind = ordinary_kind(seed)
    if kind == BOXES:
        return judge(ordinary_scene(seed)) | {"kind": kind}
    options = replace(ordinary_options(seed), joint_noise_px=float(np.random.default_rng((seed, 2001)).uniform(1, 3)))
    filmed = kind in (PIXELS, PIXELS_AND_LENSES)
    if filmed:
        options = replace(
            options, cameras=min(options.n_cameras, MOST_CAMERAS), people=min(options.n_people, MOST_PEOPLE),
            seconds=min(options.seconds, MOST_SECONDS), unrelated_ids=False, tracklet_seconds=0.0,
        )  # fmt: skip
    scene = simulate(options)
    with tempfile.TemporaryDirectory() as scratch:
        path = write_scene(scene, Path(scratch) / "scene", keypoints=not filmed, video=RenderOptions() if filmed else None)
        _leave_out(path, scene, lenses=kind in (LENSES, PIXELS_AND_LENSES))
        return judge_run(lambda: calibrate(Scene.load(path)), [scene.rig], walked_places(scene)) | {"kind": kind}


def _leave_out(path: Path, scene: SimulatedScene, *, lenses: bool) -> None:
    """Take from the scene file what a user does not know: how tall these people are, and perhaps the lenses."""
    content: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    content.pop("scale")
    if lenses:
        content["cameras"] = {name: _without_lens(table, scene, name) for name, table in content["cameras"].items()}
    path.write_text(tomli_w.dumps(content), encoding="utf-8")


def _without_lens(table: Mapping[str, Any], scene: SimulatedScene, name: str) -> dict[str, Any]:
    known = {key: value for key, value in table.items() if key != "intrinsics"}
    return known if "video" in known else known | {"image_size": list(scene.rig[name].lens.size)}
