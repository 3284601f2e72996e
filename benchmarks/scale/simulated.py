"""The cases of the benchmark of scale: what is known of each scene, and what becomes of its lengths."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from passerby.calibration.in_memory import calibrate_observations
from passerby.common.arrays import Floats
from passerby.core.figures import adjusted
from passerby.core.observations import Keypoints
from passerby.evaluation.metrics import compare
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate

FIRST_SEED = 700_000
SECONDS = 30.0
BOX_NOISE, MISSING = 0.02, 0.1
JOINT_NOISE_PX = 2.0
CLICK_PX = 2.0  # one standard deviation of every click, in the plan and in the images
LENGTH_SHARE = 0.6  # of the area's shorter side: how long the marked length is
LENGTH_SD_M = 0.02
PLAN_PX = 1000
UPPER = ("nose", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip",
         "right_hip")  # fmt: skip
FLAT = ("terrace", "basketball")  # the presets on which lengths and plans are tried


FOUND = "person, identities found"


@dataclass(frozen=True)
class ScaleCase:
    """One scene, and what is known of its scale."""

    known: str
    """nothing, person, person and keypoints, person with identities found, two points, two cameras, length, or upper bodies."""
    preset: str
    seed: int

    @property
    def key(self) -> str:
        """A name within its part."""
        return f"{self.preset} {self.seed} {self.known}"

    @property
    def identities_found(self) -> bool:
        """Whether ids mean nothing in another camera."""
        return self.known == FOUND

    @property
    def options(self) -> SimulationOptions:
        """Of the simulation."""
        upper = self.known == "upper bodies"
        return SimulationOptions(
            preset=self.preset, seed=self.seed, seconds=SECONDS, box_noise=BOX_NOISE, missing=MISSING,
            cameras=3 if upper else None, people=5 if upper else None, joint_noise_px=JOINT_NOISE_PX,
            unrelated_ids=self.identities_found,
        )  # fmt: skip


KNOWN: Mapping[str, tuple[tuple[str, ...], tuple[str, ...], int]] = {
    "nobody": (("nothing",), tuple(PRESETS), FIRST_SEED),
    "person": (("person", "person and keypoints", FOUND), tuple(PRESETS), FIRST_SEED),
    "plan": (("two points", "two cameras"), FLAT, 0),
    "length": (("length",), FLAT, 0),
    "upper": (("upper bodies",), ("terrace", "construction"), FIRST_SEED),
}
"""By part: what is known, the presets, and the first seed."""


def cases(part: str, count: int) -> dict[str, ScaleCase]:
    """The cases of a part by key: `count` seeds of each preset."""
    kinds, presets, first = KNOWN[part]
    drawn = [ScaleCase(kind, preset, first + seed) for kind in kinds for seed in range(count) for preset in presets]
    return {case.key: case for case in drawn}


def work(case: ScaleCase) -> dict[str, Any]:
    """A scene calibrated with what is known: plain values."""
    scene = simulate(case.options)
    rng = np.random.default_rng((case.seed, 19))
    boxes = {name: seen.boxes for name, seen in scene.observations.cameras.items()}
    joints = {name: seen.keypoints for name, seen in scene.observations.cameras.items()}
    used: dict[str, Any] = {"boxes": boxes}
    if case.known == "upper bodies":
        used = {"keypoints": {name: _upper(one) for name, one in joints.items()}}
    elif case.known == "person and keypoints":
        used["keypoints"] = joints
    with tempfile.TemporaryDirectory() as folder:
        tables = _tables(case, scene, rng, Path(folder))
        association = {"mode": "combined", "max_offset_s": 0.0} if case.identities_found else {"mode": "given"}
        began = time.process_time()
        found = calibrate_observations(scene.rig, fps=case.options.fps, association=association, **used, **tables)
        seconds = time.process_time() - began
    figures = adjusted(found.figures).scale
    out: dict[str, Any] = {
        "about": {"known": case.known, "preset": case.preset}, "cpu_s": seconds, "verdict": found.verdict,
        "cameras": len(scene.rig), "registered": len(found.rig.posed()), "codes": [one.code for one in found.doubts],
        "sigma_percent": None if figures.relative_sigma is None else 100 * figures.relative_sigma,
    }  # fmt: skip
    if len(found.rig.posed()) < 2:
        return out
    comparison = compare(found.rig.posed(), scene.rig)
    similar, ratio = comparison.similarity, comparison.scale_ratio
    return out | {
        "scale_percent": None if ratio is None else 100 * (ratio - 1), "mm": similar.mean_position_mm,
        "deg": similar.mean_orientation_deg,
    }  # fmt: skip


def _upper(keypoints: Keypoints) -> Keypoints:
    """The joints from the hips up, as of a detector that knows no others."""
    at = [keypoints.joints.index(joint) for joint in UPPER]
    return Keypoints(keypoints.frame, keypoints.identity, keypoints.xy[:, at], keypoints.score[:, at], UPPER)


def _tables(case: ScaleCase, scene: SimulatedScene, rng: np.random.Generator, folder: Path) -> dict[str, Any]:
    """What the scene file would state of the scale."""
    if case.known.startswith("person"):
        return {"scale": {"people": [_pointed_at(scene, rng)]}}
    if case.known == "length":
        ends = _far_points(scene) * LENGTH_SHARE
        pixels = _clicks(scene, ends, rng)
        both = {name: [one[0], one[1]] for name, one in pixels.items() if len(one) == 2}
        metres = float(np.linalg.norm(ends[0] - ends[1]))
        return {"scale": {"lengths": [{"metres": metres, "sd_m": LENGTH_SD_M, "points": both}]}}
    if case.known in ("two points", "two cameras"):
        return {"world": {"plan": _plan(case, scene, rng, folder)}}
    return {}


def _pointed_at(scene: SimulatedScene, rng: np.random.Generator) -> dict[str, Any]:
    """The table of somebody who stands alone in one of the cameras; which one is drawn."""
    for name in rng.permutation(scene.rig.names).tolist():
        boxes = scene.observations[name].boxes
        for row in rng.permutation(len(boxes)).tolist():
            at = boxes.ltwh[row, :2] + boxes.ltwh[row, 2:] / 2
            same = boxes.ltwh[boxes.frame == boxes.frame[row]]
            holding = ((same[:, :2] <= at) & (same[:, :2] + same[:, 2:] >= at)).all(axis=1)
            identity = int(scene.true_identities[name][row])
            if holding.sum() == 1 and identity in scene.heights:
                height_m = scene.heights[identity]
                return {"camera": name, "frame": int(boxes.frame[row]), "at": at.tolist(), "height_m": height_m}
    raise AssertionError("nobody stands alone in any camera")


def _far_points(scene: SimulatedScene) -> Floats:
    """(2, 3) two points of the ground, at opposite corners of the area, so that both are seen by two cameras or more."""
    half = np.array(PRESETS[scene.options.preset].area_m) / 2
    for share in np.arange(1.0, 0.2, -0.1):
        ends = np.array([[*(share * half), 0.0], [*(-share * half), 0.0]])
        seen = [[len(one) for one in _pixels(scene, end[None]).values()] for end in ends]
        if min(len(one) for one in seen) > 1:
            return ends
    raise AssertionError("no two points are seen by two cameras")


def _pixels(scene: SimulatedScene, points: Floats) -> dict[str, dict[int, Floats]]:
    """Camera -> number -> pixel of those points (N, 3) that it sees."""
    out: dict[str, dict[int, Floats]] = {}
    for camera in scene.rig:
        for number, pixel in enumerate(camera.project(points)):
            if np.isfinite(pixel).all() and (pixel > 3).all() and (pixel < np.array(camera.lens.size) - 3).all():
                out.setdefault(camera.name, {})[number] = pixel
    return out


def _clicks(scene: SimulatedScene, points: Floats, rng: np.random.Generator) -> dict[str, dict[int, list[float]]]:
    """The same as somebody clicks on them."""
    sizes = {camera.name: np.array(camera.lens.size) for camera in scene.rig}
    return {
        name: {
            number: np.clip(pixel + rng.normal(0, CLICK_PX, 2), 0, sizes[name] - 1).tolist() for number, pixel in own.items()
        }
        for name, own in _pixels(scene, points).items()
    }


def _plan(case: ScaleCase, scene: SimulatedScene, rng: np.random.Generator, folder: Path) -> dict[str, Any]:
    """A plan of `PLAN_PX` pixels over the scene, with two points or two cameras placed on it."""
    image = folder / "plan.png"
    cv2.imwrite(str(image), np.full((PLAN_PX, PLAN_PX, 3), 255, np.uint8))
    centre = np.array([camera.centre for camera in scene.rig])[:, :2]
    low, high = centre.min(axis=0) - 0.5, centre.max(axis=0) + 0.5
    unit = float((high - low).max()) / PLAN_PX

    def clicked(xy: Floats) -> list[float]:
        pixel = np.array([xy[0] - low[0], high[1] - xy[1]]) / unit
        return np.clip(pixel + rng.normal(0, CLICK_PX, 2), 0, PLAN_PX - 1).tolist()

    plan: dict[str, Any] = {"image": str(image), "metres_per_pixel": unit}
    if case.known == "two cameras":
        far = np.linalg.norm(centre[:, None] - centre[None], axis=-1)
        pair = np.unravel_index(np.argmax(far), far.shape)
        return plan | {"cameras": {scene.rig.names[c]: clicked(centre[c]) for c in map(int, pair)}}
    ends = _far_points(scene)
    pixels = _clicks(scene, ends, rng)
    points = [
        {"at": clicked(end[:2]), "pixels": {name: own[number] for name, own in pixels.items() if number in own}}
        for number, end in enumerate(ends)
    ]
    return plan | {"points": points}
