"""What `LEAST_GAIN` is held against: stated lenses that are wrong, and right ones where something else is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.page import table
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.simulation import PRESETS, SimulationOptions, simulate
from passerby.solver.contradicted_lenses import LEAST_GAIN, LEAST_GAIN_OF_JOINTS, contradicted_lenses
from passerby.solver.initialisation import Initialisation, refine_in_stages, select_initial_rig
from passerby.solver.lens_scores import score_lenses
from passerby.solver.people import PeopleOptions
from passerby.solver.uncertainty import design_effect
from reliability.footage import footage, true_rig
from reliability.hostile_pairs import FAULTS, FIRST, SECOND
from reliability.staging import HandedIn, staged

FIRST_SEED = 945_000
TRIED = (8.0, 10.0, 12.5, 15.0, 20.0, 25.0, 30.0, 40.0)
OTHERS: Mapping[str, tuple[str | None, str | None]] = {
    "boxes, right lenses": (None, None),
    "boxes, right lenses, two people exchanged": (None, "exchanged"),
    "boxes, a picture cropped by 12 %": ("cropped", None),
    "boxes, the same, two people exchanged": ("cropped", "exchanged"),
    "boxes, a focal length 10 % too long": ("longer", None),
    "boxes, the same, two people exchanged elsewhere": ("longer", "exchanged"),
}
"""Kind -> what is wrong with the camera `FIRST`, and with `SECOND`."""
LASTING: Mapping[str, str | None] = {
    "boxes with errors that last, right lenses": None,
    "the same, a picture cropped by 12 %": "cropped",
    "the same, a focal length 10 % too long": "longer",
}
JOINTS = "joints that err alike, right lenses"
JOINTS_OFF = 0.025
"""Of the body's height, one standard deviation of what joints are off by: COCO's annotators differ by 1 to 5 %, by kind."""
OPTIONS = PeopleOptions(max_joints=5000)


def cases(seeds: int) -> dict[str, tuple[str, int]]:
    """Scenes of each kind, six for each seed, twice as many with joints, by key."""
    boxes = {
        f"{kind} {seed}": (kind, seed) for kind in (*OTHERS, *LASTING) for seed in range(FIRST_SEED, FIRST_SEED + 6 * seeds)
    }
    joints = {f"{JOINTS} {seed}": (JOINTS, seed) for seed in range(FIRST_SEED + 500, FIRST_SEED + 500 + 12 * seeds)}
    return {**boxes, **joints}


def measure(case: tuple[str, int]) -> dict[str, Any]:
    """The largest gain of a scene, and the cameras that would be named if it were enough; no gain where there is no rig."""
    kind, seed = case
    rig, seen = _handed_in(kind, seed)
    rng = np.random.default_rng(seed)
    blind = Rig(tuple(Camera(camera.name, camera.lens) for camera in rig))
    try:
        start = Initialisation.prepare(blind, seen, ScaleCues(), OPTIONS, rng)
        fit = refine_in_stages(start, select_initial_rig(start, OPTIONS, rng).state, OPTIONS, rng)
    except EvidenceError:
        return {"gain": None, "named": []}
    problem, state = fit.model.problem, fit.result.state
    inflation = design_effect(fit.model, start.evidence, problem.terms(state, jacobians=False))
    scores = score_lenses(start.rig, problem, state, inflation)
    named = contradicted_lenses(start, fit, inflation, least_gain=min(TRIED))
    return {"gain": scores[0].gain, "named": [[start.rig.names[c] for c in one.hypothesis.cameras] for one in named]}


def section(outcomes: Outcomes, wanted: Mapping[str, tuple[str, int]]) -> str:
    """The section of the page."""
    head = ("scenes", "number", "gain: median", "90 %", "largest", *(f"{limit:g}" for limit in TRIED))
    rows = []
    for kind in (*OTHERS, *LASTING, JOINTS):
        found = [one for key, one in outcomes.items() if wanted[key][0] == kind and one["gain"] is not None]
        gains = np.array([one["gain"] for one in found])
        named = np.array([bool(one["named"]) for one in found], dtype=bool)
        counts = [str(int((named & (gains >= limit)).sum())) for limit in TRIED]
        quantiles = [f"{np.quantile(gains, q):.0f}" for q in (0.5, 0.9, 1.0)] if len(gains) else ["-"] * 3
        rows.append([kind, str(len(found)), *quantiles, *counts])
    return f"""### LEAST_GAIN in `solver/contradicted_lenses.py`: {LEAST_GAIN:g}

A stated lens is freed where that gains so much, of twice the log likelihood; it is named where people put it far from where it
is stated and agree with it there. With joints, which err alike, the limit is `LEAST_GAIN_OF_JOINTS`: {LEAST_GAIN_OF_JOINTS:g}.
Boxes: scenes of 30 s of all presets, four cameras, six people, identities given; the faults are in two cameras. Errors that
last: 60 to 150 s, 4 to 9 people at a time, whose boxes err for seconds alike, by bags, gait and hidden legs. Joints: 2 to 4
cameras, 1 to 5 people, 10 to 25 s, off by {100 * JOINTS_OFF:g} % of the body's height, by kind and by camera, throughout. Seeds
from {FIRST_SEED}. The last columns count the scenes in which a lens is named, by limit. The limit is the largest one that names
no right lens by boxes, and nearly as many of the wrong ones as lower ones do.

{table(head, rows)}
"""


def _handed_in(kind: str, seed: int) -> tuple[Rig, Observations]:
    """The lenses as they are stated, and what was seen."""
    if kind == JOINTS:
        return _with_joints(seed)
    return _with_boxes(seed, *OTHERS[kind]) if kind in OTHERS else _with_lasting_errors(seed, LASTING[kind])


def _with_lasting_errors(seed: int, fault: str | None) -> tuple[Rig, Observations]:
    """Boxes whose errors last for seconds."""
    rng = np.random.default_rng((seed, 4))
    presets = list(PRESETS)
    preset = presets[seed % len(presets)]
    rig = true_rig(preset, 4, rng)
    seen = footage(preset, rig, float(rng.uniform(60, 150)), float(rng.uniform(4, 9)), rng)
    if fault is None:
        return rig, seen
    scene = HandedIn(rig, {name: own.boxes for name, own in seen.cameras.items()}, rig)
    return FAULTS[fault].spoil(scene, FIRST).lenses, seen


def _with_boxes(seed: int, first: str | None, second: str | None) -> tuple[Rig, Observations]:
    presets = list(PRESETS)
    scene = staged(seed, preset=presets[seed % len(presets)])
    for fault, camera in ((first, FIRST), (second, SECOND)):
        if fault is not None:
            scene = FAULTS[fault].spoil(scene, camera)
    seen = {name: CameraObservations(boxes, Keypoints.empty()) for name, boxes in scene.boxes.items()}
    return scene.lenses, Observations(seen, scene.fps if isinstance(scene.fps, float) else 5.0)


def _with_joints(seed: int) -> tuple[Rig, Observations]:
    """Joints beside the true ones, by kind and camera; in a third of the scenes there are no boxes."""
    rng = np.random.default_rng((seed, 3))
    presets = list(PRESETS)
    scene = simulate(
        SimulationOptions(
            preset=presets[seed % len(presets)], seed=seed, cameras=int(rng.integers(2, 5)), people=int(rng.integers(1, 6)),
            seconds=float(rng.uniform(10, 25)), box_noise=0.03, joint_noise_px=0.5,
        )
    )  # fmt: skip
    boxes = rng.uniform() > 1 / 3
    seen = with_joints_off(scene.observations, rng)
    cameras = {name: own if boxes else replace(own, boxes=Boxes.empty()) for name, own in seen.cameras.items()}
    return scene.rig, replace(seen, cameras=cameras)


def with_joints_off(seen: Observations, rng: np.random.Generator) -> Observations:
    """Joints beside the true ones throughout, by kind: mostly alike in all cameras, a part of it in each camera on its own."""
    alike = rng.normal(0, 0.95 * JOINTS_OFF, (17, 2))
    cameras = {}
    for name, own in seen.cameras.items():
        off = alike + rng.normal(0, 0.3 * JOINTS_OFF, (17, 2))
        tall = np.nan_to_num(np.ptp(own.keypoints.xy[:, :, 1], axis=1))
        cameras[name] = replace(own, keypoints=replace(own.keypoints, xy=own.keypoints.xy + tall[:, None, None] * off))
    return replace(seen, cameras=cameras)
