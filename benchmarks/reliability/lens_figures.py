"""What the odds of lens alternatives are in simulated scenes: lenses stated wrongly, and right ones where something else is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.hypotheses.comparison import LOG_ODDS
from passerby.hypotheses.lenses import LEAST_SCREENED, examine_lenses
from passerby.simulation import PRESETS, SimulationOptions, simulate
from passerby.solver.people import PeopleOptions, PeopleSolution, solve_people
from reliability.footage import footage, true_rig
from reliability.hostile_pairs import FAULTS, FIRST, SECOND
from reliability.staging import HandedIn, staged

FIRST_SEED = 945_000
TRIED = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
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
    """The largest score and log odds of a scene, and what becomes of it; no score where there is no rig."""
    kind, seed = case
    rig, seen = _handed_in(kind, seed)
    blind = Rig(tuple(Camera(camera.name, camera.lens) for camera in rig))
    try:
        solution = solve_people(blind, seen, ScaleCues(), OPTIONS, rng=np.random.default_rng(seed))
    except EvidenceError:
        return {"gain": None, "log_odds": None, "decision": "nothing", "named": []}
    assert isinstance(solution, PeopleSolution)
    result = examine_lenses(solution)
    names = solution.start.rig.names if solution.start is not None else ()
    return {
        "gain": max((one.gain for one in result.screened), default=0.0),
        "log_odds": max((one.log_odds for one in result.tested), default=None),
        "decision": result.decision,
        "named": [[names[c] for c in one.alternative.cameras] for one in result.suspects],
    }


def tabulate(outcomes: Outcomes, wanted: Mapping[str, tuple[str, int]]) -> Found:
    """The section of the page."""
    head = (
        "scenes",
        "number",
        "score, nats: median",
        "90 %",
        "largest",
        *(f"odds above {odds:g}" for odds in TRIED),
        "corrected",
    )
    rows = []
    for kind in (*OTHERS, *LASTING, JOINTS):
        found = [one for key, one in outcomes.items() if wanted[key][0] == kind and one["gain"] is not None]
        gains = np.array([one["gain"] for one in found])
        odds = np.array([-np.inf if one["log_odds"] is None else one["log_odds"] for one in found])
        counts = [str(int((odds > np.log(limit)).sum())) for limit in TRIED]
        quantiles = [f"{np.quantile(gains, q):.0f}" for q in (0.5, 0.9, 1.0)] if len(gains) else ["-"] * 3
        corrected = str(sum(one["decision"] == "correct" for one in found))
        rows.append([kind, str(len(found)), *quantiles, *counts, corrected])
    run = f"Odds above {np.exp(LOG_ODDS):.0f}, LEAST_SCREENED = {LEAST_SCREENED:g}"
    return Found({"Odds": table(head, rows)}, run=run)


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
