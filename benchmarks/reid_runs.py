"""Networks trained, evaluated, exported and adapted by the `passerby` command, and what came of it."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations, islice
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from accuracy import WORKERS
from command import ONE_THREAD, Calibrated, judge, passerby, run_program
from datasets import ROOT, models_folder
from metrics.detections import paired
from metrics.identities import IdentityAgreement, identity_agreement
from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.appearance.embeddings import match_boxes
from passerby.association.camera_tracklets import build_tracklets
from passerby.common.progress import silent
from passerby.core.observations import UNKNOWN, Boxes
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.video_writer import VideoWriter
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.rendering import RenderOptions
from passerby.simulation.rendering.camera import CameraJob, camera_job, pictures
from passerby.simulation.write import write_scene
from perception_runs import absolute, calibrated, used_boxes, write
from perception_scenes import render_key

OVERLAP = 0.5  # intersection over union from which on a found box shows the person of a true one


@dataclass(frozen=True)
class LooksScore:
    """What the Hungarian algorithm makes of the looks alone, instant by instant, before anything is verified."""

    matched: int  # pairs of boxes, both on somebody known
    right: int
    useful_pairs: int  # pairs of cameras in which the association finds that looks tell more than chance
    pairs: int

    @property
    def precision(self) -> float | None:
        """Share of the matched pairs that show one person."""
        return self.right / self.matched if self.matched else None


def true_boxes(folder: Path) -> dict[str, Boxes]:
    """Camera -> the true boxes of a recording."""
    return {path.stem: read_boxes(path) for path in sorted((folder / "truth").glob("*.txt"))}


def identities(out: Path, truth: Mapping[str, Boxes]) -> IdentityAgreement:
    """The identities that a calibration has written, each carried over to the true box that its box overlaps best."""
    carried = {}
    for name, boxes in used_boxes(out, tuple(truth)).items():
        true, found, rows, columns = _on_truth(truth[name], boxes)
        identity = np.full(len(true), UNKNOWN)
        identity[rows] = found.identity[columns]
        carried[name] = Boxes(true.frame, identity, true.ltwh, true.score)
    return identity_agreement(carried, truth)


def appearance(scene: Path, out: Path, truth: Mapping[str, Boxes], seed: int = 0) -> LooksScore | None:
    """What the looks alone say of the boxes that a calibration has kept in `out`; None where there are no embeddings.

    As the association does in all modes: tracklets, the mean of eight boxes each, less the camera's mean; the same steps twice
    a second.
    """
    inputs = read_inputs(Scene.load(scene), SceneVideoProcessor(out, None, silent))
    rng = np.random.default_rng(seed)
    seen = inputs.observations
    cameras = build_tracklets(inputs.rig, seen, seen.clocks, Scene.load(scene).scale.person_height_m, rng)
    found = AppearanceAffinity.of(cameras, rng)
    if found is None:
        return None
    matched = right = 0
    for a, b in combinations(range(len(cameras)), 2):
        first, second = found.cameras[a], found.cameras[b]
        if first is None or second is None:
            continue
        one, two = (_people(truth[cameras[c].name], looked.boxes) for c, looked in ((a, first), (b, second)))
        pairs = match_boxes(first, second)
        who, whom = one[pairs.row_a], two[pairs.row_b]
        known = (who != UNKNOWN) & (whom != UNKNOWN)
        matched, right = matched + int(known.sum()), right + int((known & (who == whom)).sum())
    useful = sum(pair.usefulness is not None and pair.usefulness.weight > 0 for pair in found.pairs.values())
    return LooksScore(matched, right, useful, len(found.pairs))


def _people(truth: Boxes, boxes: Boxes) -> NDArray[np.int64]:
    """(N,) the true identity of each found box; -1 where it shows nobody for sure."""
    order = np.argsort(boxes.frame, kind="stable")
    true, _, rows, columns = _on_truth(truth, boxes.take(order))
    people = np.full(len(boxes), UNKNOWN)
    people[order[columns]] = true.identity[rows]
    return people


def _on_truth(truth: Boxes, found: Boxes) -> tuple[Boxes, Boxes, NDArray[np.int64], NDArray[np.int64]]:
    """Both sorted by frame, and which rows of them stand for each other."""
    true, found = (boxes.take(np.argsort(boxes.frame, kind="stable")) for boxes in (truth, found))
    return true, found, *paired(true, found, OVERLAP)


CROWD, CROWD_SECONDS, CROWD_FPS = 20, 20.0, 1.0
"""A second apart everybody has turned or taken a step, so that every picture is worth its rendering."""
HALVES = ("first", "second")
TEAM, TEAM_PRESET, HALF_SECONDS, TEAM_FPS = 8, "terrace", 40.0, 5.0


def crowd(scenes: Path, preset: str, seed: int, clothes: str) -> Path:
    """Folder of a rendered crowd, with its videos and the true boxes."""
    options = ["--preset", preset, "--seed", str(seed), "--people", str(CROWD), "--seconds", f"{CROWD_SECONDS:g}"]
    options += ["--fps", f"{CROWD_FPS:g}", "--video", "--clothes", clothes]
    folder = scenes / f"crowd-{clothes}-{preset}-{seed}-{render_key(*options)}"
    if not (folder / "scene.toml").is_file():
        passerby("simulate", *options, "-o", str(folder), environment=ONE_THREAD)
    return folder


def team(scenes: Path, seed: int) -> Path:
    """Folder of a team in one vest, filmed once: videos and true boxes in `first` and `second`, lenses and true rig beside."""
    options = SimulationOptions(TEAM_PRESET, seed, people=TEAM, seconds=2 * HALF_SECONDS, fps=TEAM_FPS)
    video = RenderOptions(clothes="alike")
    folder = scenes / f"team-{seed}-{render_key(str(options), str(video))}"
    if folder.is_dir():
        return folder
    simulated = simulate(options)
    scenes.mkdir(parents=True, exist_ok=True)
    workshop = Path(tempfile.mkdtemp(dir=scenes, prefix=f".{folder.name}."))
    try:
        new = workshop / "new"
        write_scene(simulated, new)
        half = round(HALF_SECONDS * TEAM_FPS)
        for name, boxes in simulated.truth.items():
            for part, begin in zip(HALVES, (0, half), strict=True):
                write_boxes(new / part / "truth" / f"{name}.txt", _shifted(boxes, begin, half))
        with ProcessPoolExecutor(WORKERS) as pool:
            jobs = [(camera_job(simulated, name, video), new, half) for name in simulated.rig.names]
            for _ in pool.map(_film, jobs):
                pass
        new.rename(folder)
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    return folder


def _shifted(boxes: Boxes, begin: int, length: int) -> Boxes:
    """The boxes of one half, its frames counted from 1."""
    part = boxes.take((boxes.frame > begin) & (boxes.frame <= begin + length))
    return replace(part, frame=part.frame - begin)


def _film(job: tuple[CameraJob, Path, int]) -> None:
    """One camera's recording, cut in two."""
    camera, folder, half = job
    film = pictures(camera)
    for part in HALVES:
        path = folder / part / "videos" / f"{camera.camera.name}.mp4"
        path.parent.mkdir(parents=True, exist_ok=True)
        with VideoWriter(path, camera.camera.lens.size, camera.fps) as video:
            for picture in islice(film, half):
                video.write(picture)


RETAIL = "person-reid-retail-0248"
STRIPES = "stripes"
MODES = ("appearance", "combined")
TINY_RATE = 1e-9  # a learning rate at which an epoch changes no weight to speak of


@dataclass(frozen=True)
class Trained:
    """One `passerby reid train` and its export."""

    folder: Path
    network: Path  # the ONNX file
    people: int
    pictures: int
    epochs: int
    seconds: float  # wall time of the whole command: start, reading and validation included
    loss: float
    exported: Mapping[str, Any]  # `reid export --json`

    @property
    def per_second(self) -> float:
        """Pictures learnt from in a second."""
        return self.pictures * self.epochs / self.seconds


@dataclass(frozen=True)
class Half:
    """One half of a team's recording, by one network."""

    retrieval: Mapping[str, Mapping[str, float]]  # plain and centred -> rank_1 and so on, on the true boxes
    appearance: LooksScore | None
    calibrated: Mapping[str, Calibrated]  # by mode of association
    agreement: Mapping[str, IdentityAgreement]


@dataclass(frozen=True)
class Tuned:
    """One `passerby reid finetune`."""

    labels: Mapping[str, Any]  # what it says of the pictures that it took as labels
    seconds: float


@dataclass(frozen=True)
class Team:
    """A team in one vest, before and after the network was adapted to it."""

    seed: int
    before: Mapping[str, Half]  # by half
    after: Mapping[str, Half]  # as before, where the calibration was sure of too few people
    tuned: Tuned


def train(data: Sequence[Path], into: Path, options: Mapping[str, Any]) -> Trained:
    """The small recipe with some options changed, on the processor; then the ONNX file, compared on the same pictures."""
    into.mkdir(parents=True, exist_ok=True)
    config = into / "options.toml"
    config.write_text(tomli_w.dumps(dict(options)))
    sets, folder, network = [str(path) for path in data], into / "run", into / "net.onnx"
    arguments = ["--recipe", "small", "--config", str(config), "--device", "cpu", "--json", "-o", str(folder)]
    run = passerby("reid", "train", *sets, *arguments)
    told = json.loads(run.output)
    compared = [part for path in sets for part in ("--data", path)]
    exported = json.loads(passerby("reid", "export", str(folder), "-o", str(network), *compared, "--json").output)
    return Trained(folder, network, told["people"], told["pictures"], told["options"]["epochs"], run.seconds,
                   told["last"]["loss"], exported)  # fmt: skip


def untrained(data: Path, into: Path) -> Trained:
    """Random weights; only the means and variances that normalise are those of the pictures."""
    return train([data], into, {"epochs": 1, "learning_rate": TINY_RATE, "warm_up_epochs": 0.0})


def evaluate(network: str | Path, data: Sequence[Path], cache: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Data set -> plain and centred -> shares, by `passerby reid evaluate`."""
    models = models_folder()
    environment = ONE_THREAD | ({"PASSERBY_MODELS": str(models)} if models else {})
    arguments = [str(network), *map(str, data), "--cache", str(cache), "--json"]
    sets: dict[str, dict[str, dict[str, float]]] = json.loads(
        passerby("reid", "evaluate", *arguments, environment=environment).output
    )["sets"]
    return sets


def speed(network: Path, data: Path) -> dict[str, float]:
    """Milliseconds a crop on one core: see `reid_speed`."""
    program = Path(__file__).with_name("reid_speed.py")
    told: dict[str, float] = json.loads(run_program([str(program), str(network), str(data)], ONE_THREAD).output)
    return told


def adapted(scenes: Path, seed: int, start: Trained, into: Path, epochs: int | None = None) -> Team:
    """A team calibrated with a network, the network adapted to the first half of its recording, all measured again.

    The second half is calibrated by itself: nothing of it was learnt from.
    """
    folder = team(scenes, seed)
    before = {part: _half(folder, part, start.network, into / f"{part}-before") for part in HALVES}
    out, target = into / "first-before" / "combined", into / "tuned"
    more = [] if epochs is None else ["--epochs", str(epochs)]
    run = passerby("reid", "finetune", str(out), "--weights", str(start.folder), "-o", str(target), "--device", "cpu",
                   "--json", *more, environment=ONE_THREAD)  # fmt: skip
    if not (target / "calibration.json").is_file():
        return Team(seed, before, before, Tuned({}, run.seconds))
    again = judge(target, folder / "truth.toml", run, ONE_THREAD)
    after = {}
    for part in HALVES:
        kept = into / f"{part}-before" / "combined" / "perception"
        done = {"combined": (target, again)} if part == HALVES[0] else {}
        after[part] = _half(folder, part, target / "net.onnx", into / f"{part}-after", kept, done)
    return Team(seed, before, after, Tuned(json.loads(run.output)["labels"], run.seconds))


def _half(
    folder: Path, part: str, network: Path, into: Path, kept: Path | None = None,
    done: Mapping[str, tuple[Path, Calibrated]] | None = None,
) -> Half:  # fmt: skip
    """One half of a recording by one network, in both modes; combined first, whose boxes serve the other mode too."""
    truth = true_boxes(folder / part)
    outs = {mode: place for mode, (place, _) in (done or {}).items()}
    runs = {mode: run for mode, (_, run) in (done or {}).items()}
    for mode in reversed(MODES):
        if mode in runs:
            continue
        outs[mode] = into / mode
        source = kept if mode == "combined" else outs["combined"] / "perception"
        if source is not None and not outs[mode].exists():
            shutil.copytree(source, outs[mode] / "perception")
        scene = write(into / f"{mode}.toml", _scene(folder, part, network, mode))
        runs[mode] = calibrated(scene, folder / "truth.toml", outs[mode])
    agreement = {mode: identities(outs[mode], truth) for mode in MODES}
    looked = appearance(into / f"{MODES[0]}.toml", outs[MODES[0]], truth)
    (retrieval,) = evaluate(network, [folder / part], folder / "crops").values()
    return Half(retrieval, looked, runs, agreement)


def _scene(folder: Path, part: str, network: Path, mode: str) -> dict[str, Any]:
    """The scene file of one half: people are found by background subtraction and described by a network."""
    content = absolute(folder / "scene.toml")
    videos = folder / part / "videos"
    return content | {
        "scene": {"name": f"{folder.name}-{part}"},
        "cameras": {
            name: {"intrinsics": str(folder / "intrinsics.toml"), "video": str((videos / f"{name}.mp4").resolve())}
            for name in read_rig(folder / "truth.toml").names
        },
        "perception": {"detector": "background", "embedder": str(network.resolve())},
        "association": {"mode": mode},
    }


def real_crops() -> Path | None:
    """The folder of real crops, or None where it is not at hand."""
    place = Path(os.environ.get("PASSERBY_DATA") or ROOT.parent / "shared" / "data") / "reid_crops"
    return place.resolve() if (place / "train").is_dir() else None
