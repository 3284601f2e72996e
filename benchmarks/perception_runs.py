"""Scenes whose people are found in videos: how they are written, calibrated and judged."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from command import ONE_THREAD, Calibrated, Run, calibrate, judge, passerby, run_program
from datasets import models_folder
from metrics.detections import BoxScore, score_boxes
from metrics.tracklets import TrackletScore, score_tracklets
from passerby.association.tracking.stitching import stitch_tracklets
from passerby.association.tracking.tracking import track
from passerby.common.errors import InputError
from passerby.common.progress import silent
from passerby.core.observations import UNKNOWN, Boxes
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor

CRASHED = "crashed"
WEIGHT_FREE = {"detector": "background", "embedder": "stripes", "keypoints": "none"}
NETWORKS = {"detector": "yolox-nano", "embedder": "person-reid-retail-0248", "keypoints": "auto"}
BOXES = "boxes"
BOXES_ALONE = NETWORKS | {"keypoints": "none"}
METHODS = {"weight-free": WEIGHT_FREE, "networks": NETWORKS}
PETS_FPS = 7.0
PETS_CAMERA = "V1"


@dataclass(frozen=True)
class Watched:
    """A calibration and how well its people were found."""

    calibrated: Calibrated
    found: BoxScore | None = None
    """All boxes that were found; None where truth is not at hand, or the run crashed."""
    used: BoxScore | None = None
    """Those that got an identity."""


@dataclass(frozen=True)
class Demo:
    """The demonstration, and the same videos calibrated once more."""

    whole: Run
    calibrated: Calibrated
    """What the demonstration calibrates."""
    again: Calibrated
    """The same videos with nothing kept: what a calibration takes."""


def with_models(method: dict[str, str]) -> dict[str, str]:
    """A `[perception]` table; the models are those at hand."""
    return method if method == WEIGHT_FREE else method | {"models": str(models_folder())}


def run_demo(into: Path) -> Demo:
    """`passerby demo`, then its calibration alone, both in the user's own environment."""
    whole = passerby("demo", "-o", str(into / "demo"))
    folder = into / "demo" / "scene"
    first = judge(into / "demo" / "out", folder / "truth.toml", whole)
    scene = write(into / "scene.toml", absolute(folder / "scene.toml") | {"perception": WEIGHT_FREE})
    return Demo(whole, first, calibrated(scene, folder / "truth.toml", into / "out", {}))


def absolute(scene: Path) -> dict[str, Any]:
    """The content of a scene file, its paths absolute."""
    content = tomllib.loads(scene.read_text())
    for camera in content["cameras"].values():
        camera |= {key: str((scene.parent / value).resolve()) for key, value in camera.items() if isinstance(value, str)}
    return content


def write(path: Path, content: dict[str, Any]) -> Path:
    """A scene file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(content))
    return path


def run_rendered(folder: Path, method: str, into: Path) -> Watched:
    """Calibrate a rendered scene from its videos by one of `METHODS`, or from its true boxes without their identities."""
    truth = {name: read_boxes(folder / "truth" / f"{name}.txt") for name in read_rig(folder / "truth.toml").names}
    if method == BOXES:
        content = absolute(folder / "boxes.toml") | {"association": {"mode": "combined"}}
        for name, camera in content["cameras"].items():
            seen = read_boxes(Path(camera.pop("tracks")))
            camera["detections"] = str(into / f"{name}.txt")
            write_boxes(into / f"{name}.txt", replace(seen, identity=np.full(len(seen), UNKNOWN)))
    else:
        content = absolute(folder / "scene.toml") | {"perception": with_models(METHODS[method])}
    scene = write(into / "scene.toml", content)
    result = calibrated(scene, folder / "truth.toml", into / "out")
    if method == BOXES or result.verdict == CRASHED:
        return Watched(result)
    found, used = found_boxes(scene, into / "out"), used_boxes(into / "out", tuple(truth))
    return Watched(
        result,
        score_boxes((found[name], truth[name]) for name in truth),
        score_boxes((used[name], truth[name]) for name in truth),
    )


def run_with_and_without_joints(folder: Path, into: Path) -> dict[str, tuple[Calibrated, float]]:
    """A rendered scene by networks, with and without keypoints; each with the processor time of watching, seconds.

    Watching is what a second run saves, which finds the people where the first one kept them.
    """
    found = {}
    for name, method in (("without", BOXES_ALONE), ("with", NETWORKS)):
        scene = write(into / name / "scene.toml", absolute(folder / "scene.toml") | {"perception": with_models(method)})
        first, again = (calibrated(scene, folder / "truth.toml", into / name / "out") for _ in range(2))
        found[name] = first, first.cpu_seconds - again.cpu_seconds
    return found


def run_room(folder: Path, into: Path) -> Calibrated:
    """A rendered room from its videos, without weights."""
    scene = write(into / "scene.toml", absolute(folder / "scene.toml") | {"perception": WEIGHT_FREE})
    return calibrated(scene, folder / "truth.toml", into / "out")


def found_boxes(scene: Path, out: Path) -> dict[str, Boxes]:
    """What a calibration found in the videos and kept, before anybody asked who is who."""
    inputs = read_inputs(Scene.load(scene), SceneVideoProcessor(out, None, silent))
    return {name: seen.boxes for name, seen in inputs.observations.cameras.items()}


def used_boxes(out: Path, names: Sequence[str]) -> dict[str, Boxes]:
    """The boxes of the people that a calibration knows."""
    none = Boxes.empty()
    paths = {name: out / "tracks" / f"{name}.txt" for name in names}
    known = {name: read_boxes(path) if path.is_file() else none for name, path in paths.items()}
    return {name: boxes.take(boxes.identity != UNKNOWN) for name, boxes in known.items()}


def run_pets(folder: Path, method: str, into: Path) -> Calibrated:
    """pets2009 with one camera's people found in its video by one of `METHODS`, or, as the others, from its boxes."""
    rig = folder / "rig.toml"
    cameras: dict[str, dict[str, str]] = {}
    for name in read_rig(rig).names:
        seen = {"detections": str(folder / "detections" / f"{name}.txt")}
        if name == PETS_CAMERA and method != BOXES:
            seen = {"video": str(folder / f"{name}.avi")}
        cameras[name] = {"intrinsics": str(rig), **seen}
    content: dict[str, Any] = {"scene": {"name": "pets2009", "fps": PETS_FPS}, "cameras": cameras}
    if method != BOXES:
        content["perception"] = with_models(METHODS[method])
    return calibrated(write(into / "scene.toml", content), rig, into / "out")


def run_single(folder: Path, into: Path) -> Calibrated:
    """pose2sim_single from its four videos, with all that is used by default where networks are at hand."""
    rig = folder / "rig.toml"
    cameras = {name: {"intrinsics": str(rig), "video": str(folder / "videos" / f"{name}.mp4")} for name in read_rig(rig).names}
    content = {"scene": {"name": "pose2sim_single"}, "cameras": cameras, "perception": with_models(NETWORKS)}
    return calibrated(write(into / "scene.toml", content), rig, into / "out")


def score_pets_tracklets(folder: Path, into: Path) -> dict[str, TrackletScore | str]:
    """What follows the people of the one camera with a video, against their true identities."""
    truth = read_boxes(folder / "identities" / f"{PETS_CAMERA}.txt")
    scores: dict[str, TrackletScore | str] = {}
    for appearance, embedder in (("re-ID network", NETWORKS["embedder"]), ("stripes", "stripes")):
        content = tomllib.loads((into / "scene.toml").read_text())
        content["perception"]["embedder"] = embedder
        scene = write(into / f"{embedder}.toml", content)
        # The same folder: what was found there need not be found again.
        tracked = track(found_boxes(scene, into / "out")[PETS_CAMERA], PETS_FPS)
        scores[f"tracker, {appearance}"] = _scored(tracked, truth)
        scores[f"tracker and mending, {appearance}"] = _scored(stitch_tracklets(tracked, PETS_FPS), truth)
    scores["tracks that `calibrate` writes"] = _scored(used_boxes(into / "out", [PETS_CAMERA])[PETS_CAMERA], truth)
    given = read_boxes(folder / "detections" / f"{PETS_CAMERA}.txt")
    scores["for comparison: tracker, boxes of detections/"] = _scored(track(given, PETS_FPS), truth)
    return scores


def _scored(found: Boxes, truth: Boxes) -> TrackletScore | str:
    """The score, or why there is none."""
    try:
        return score_tracklets(found, truth)
    except InputError as error:
        return str(error)


def watch_alone(video: Path, method: str, into: Path) -> dict[str, float]:
    """One camera's video watched in a process of its own: see `perception_memory`."""
    program = Path(__file__).with_name("perception_memory.py")
    detector = METHODS[method]["detector"]
    arguments = [str(program), str(video), "--detector", detector, "--shelf", str(into)]
    models = models_folder()
    result = json.loads(run_program(arguments + (["--models", str(models)] if models else [])).output)
    return {name: float(value) for name, value in result.items()}


def calibrated(scene: Path, truth: Path, out: Path, environment: dict[str, str] | None = None) -> Calibrated:
    """A run that ends in a bug is one more that has missed its goal, and the benchmark goes on."""
    try:
        result = calibrate(scene, truth, out, environment=ONE_THREAD if environment is None else environment)
    except RuntimeError as error:
        print(error, file=sys.stderr)
        cameras = len(tomllib.loads(scene.read_text())["cameras"])
        nothing = float("nan")
        return Calibrated(CRASHED, None, None, cameras, status=1, report={}, seconds=nothing, peak_mb=nothing)
    for reason in result.report["reasons"]:
        print(f"{scene}: {result.verdict}: {reason}", file=sys.stderr)
    return result
