"""What `DOUBT_POWER` is held against: joints that a network finds in rendered films, and the rigs that they give."""

from __future__ import annotations

import itertools
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import tomli_w
from numpy.typing import NDArray

from datasets import models_folder
from metrics.detections import paired
from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.calibration.calibrate import calibrate
from passerby.common.arrays import Floats
from passerby.common.progress import silent
from passerby.core.observations import MIN_JOINT_SCORE, MIN_JOINTS, Boxes, Keypoints
from passerby.evaluation.metrics import compare
from passerby.people.segments import MIN_EXTENT_PX
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from passerby.simulation import PRESETS, SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from passerby.solver import evidence
from passerby.solver.evidence import DOUBT_POWER, DOUBT_RANGE
from reliability.stature_figures import detectors_at_hand

FIRST_SEED = 950_000
POWERS = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
METHOD = {"detector": "yolox-nano", "embedder": "person-reid-retail-0248", "keypoints": "auto"}
LEAST_OVERLAP = 0.5
"""Of the extent of found joints and that of the true ones that they stand for, intersection over union."""
BINS = (0.5, 0.8, 1.0, 1.25, 1.5, 2.0, 4.0)
"""Of the usual score over a joint's own."""


def cases(seeds: int) -> dict[str, tuple[str, int]]:
    """Films of each preset by key; none without networks."""
    if "network" not in detectors_at_hand():
        return {}
    films = [(preset, FIRST_SEED + k) for preset in PRESETS for k in range(max(1, seeds // 2))]
    return {" ".join(map(str, film)): film for film in films}


def measure(film: tuple[str, int]) -> dict[str, Any]:
    """Errors of the joints by their scores, and the errors of the rig by each power."""
    preset, seed = film
    options = SimulationOptions(preset=preset, seed=seed, cameras=3, people=5, seconds=25.0)
    scene = simulate(options)
    truth = simulate(replace(options, occlusion=False)).observations
    with tempfile.TemporaryDirectory() as scratch:
        path, out = write_scene(scene, Path(scratch) / "scene", video=RenderOptions()), Path(scratch) / "out"
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        content["perception"] = METHOD | {"models": str(models_folder())}
        path.write_text(tomli_w.dumps(content), encoding="utf-8")
        rigs = []
        for power in POWERS:
            with patch.object(evidence, "DOUBT_POWER", power):
                rigs.append(calibrate(Scene.load(path), keep=out).rig)
        seen = read_inputs(Scene.load(path), SceneVideoProcessor(out, None, silent)).observations
    joints = [joint_errors(truth[name].keypoints, seen[name].keypoints) for name in scene.rig.names]
    ratio, error = (np.concatenate(columns) for columns in zip(*joints, strict=True))
    similar = [compare(rig, scene.rig).similarity if len(rig.posed()) == len(scene.rig) else None for rig in rigs]
    return {
        "position_mm": [None if one is None else one.mean_position_mm for one in similar],
        "orientation_deg": [None if one is None else one.mean_orientation_deg for one in similar],
        "loss": [cauchy_loss(error, np.clip(ratio**power, *DOUBT_RANGE)) for power in POWERS],
        "errors": [error[(ratio >= low) & (ratio < high)].tolist() for low, high in itertools.pairwise(BINS)],
    }  # fmt: skip


def joint_errors(truth: Keypoints, found: Keypoints) -> tuple[Floats, Floats]:
    """(N,) the usual score over each found joint's, and its distance from the true one as a share of the person's size.

    What all joints of a kind are off by is left out: no score tells of it.
    """
    used = (found.score > MIN_JOINT_SCORE) & (((found.score > MIN_JOINT_SCORE).sum(axis=1) >= MIN_JOINTS)[:, None])
    rows = np.flatnonzero(used.any(axis=1))
    rows = rows[np.argsort(found.frame[rows], kind="stable")]
    found, used = found.take(rows), used[rows]
    truth = truth.take(np.argsort(truth.frame, kind="stable"))
    if not len(found) or not len(truth):
        return np.zeros(0), np.zeros(0)
    extents = _extents(found, used)
    a, b = paired(_extents(truth, np.ones(truth.score.shape, dtype=bool)), extents, LEAST_OVERLAP)
    off = (found.xy[b] - truth.xy[a]) / np.maximum(extents.ltwh[b, 3], MIN_EXTENT_PX)[:, None, None]
    known = used[b]
    for kind in np.flatnonzero(known.any(axis=0)):
        off[:, kind] -= np.median(off[known[:, kind], kind], axis=0)
    ratio = float(np.median(found.score[used])) / np.where(known, found.score[b], np.inf)
    return ratio[known], np.linalg.norm(off[known], axis=1)


def cauchy_loss(error: Floats, widening: Floats) -> float:
    """Mean negative log likelihood of distances by a Cauchy distribution in the plane, at the best of its scales."""
    scales = np.exp(np.linspace(np.log(1e-3), np.log(0.1), 200))
    off = error / widening
    losses = [np.mean(2 * np.log(scale * widening) + 1.5 * np.log1p((off / scale) ** 2)) for scale in scales]
    return float(min(losses))


def _extents(joints: Keypoints, used: NDArray[np.bool_]) -> Boxes:
    """Boxes about the joints of each row."""
    low = np.where(used[..., None], joints.xy, np.inf).min(axis=1)
    size = np.where(used[..., None], joints.xy, -np.inf).max(axis=1) - low
    ltwh = np.concatenate([low, np.maximum(size, 1.0)], axis=1)
    return Boxes(joints.frame, np.zeros(len(joints), np.int64), ltwh, np.ones(len(joints)))


def tabulate(outcomes: Outcomes, wanted: Mapping[str, tuple[str, int]]) -> Found:
    """Errors by score, and what each power makes of them and of the rigs; `outcomes` of `measure`, by key."""
    run = f"{len(outcomes)} films; DOUBT_POWER = {DOUBT_POWER:g}"
    if not outcomes:
        return Found(notes=["The networks were not at hand: not measured."], run=run)
    bins = []
    for index, (low, high) in enumerate(itertools.pairwise(BINS)):
        errors = np.concatenate([np.array(one["errors"][index]) for one in outcomes.values()])
        shares = [f"{100 * np.quantile(errors, q):.1f}" for q in (0.5, 0.9)] if len(errors) else ["-"] * 2
        bins.append([f"{low:g} to {high:g}", str(len(errors)), *shares])
    rows = []
    for index, power in enumerate(POWERS):
        name = f"**{power:g}**" if power == DOUBT_POWER else f"{power:g}"
        loss = np.mean([one["loss"][index] - one["loss"][0] for one in outcomes.values()])
        by_preset = [_median(outcomes, wanted, preset, index) for preset in PRESETS]
        ratios = [
            one["position_mm"][index] / one["position_mm"][0]
            for one in outcomes.values()
            if one["position_mm"][index] is not None and one["position_mm"][0] is not None
        ]
        rows.append([name, f"{loss:+.3f}", *by_preset, f"{np.exp(np.mean(np.log(ratios))):.2f}" if ratios else "-"])
    head = ("power", "loss", *(f"{preset}, mm" for preset in PRESETS), "error over that by power 0, geometric mean")
    found = table(("usual score over the joint's", "joints", "median", "90 %"), bins)
    return Found({"Errors": found, "DOUBT_POWER": table(head, rows)}, run=run)


def _median(outcomes: Outcomes, wanted: Mapping[str, tuple[str, int]], preset: str, index: int) -> str:
    known = [
        one["position_mm"][index]
        for key, one in outcomes.items()
        if wanted[key][0] == preset and one["position_mm"][index] is not None
    ]
    return f"{np.median(known):.1f}" if known else "-"
