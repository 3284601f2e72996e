"""Networks trained, evaluated, exported and adapted by the `passerby` command, and what came of it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from command import ONE_THREAD, Calibrated, judge, passerby, run_program
from datasets import ROOT, models_folder
from metrics.identities import IdentityAgreement
from passerby.interchange.rig_toml import read_rig
from perception_runs import absolute, calibrated, write
from reid_scenes import HALVES, team
from reid_scores import LooksScore, appearance, identities, true_boxes

RETAIL = "person-reid-retail-0248"
STRIPES = "stripes"
MODES = ("appearance", "combined")
TINY_RATE = 1e-9
"""A learning rate at which an epoch changes no weight to speak of."""


@dataclass(frozen=True)
class Trained:
    """One `passerby reid train` and its export."""

    folder: Path
    network: Path
    """The ONNX file."""
    people: int
    pictures: int
    epochs: int
    seconds: float
    """Wall time of the whole command: start, reading and validation included."""
    loss: float
    exported: Mapping[str, Any]
    """`reid export --json`."""

    @property
    def per_second(self) -> float:
        """Pictures learnt from in a second."""
        return self.pictures * self.epochs / self.seconds


@dataclass(frozen=True)
class Half:
    """One half of a team's recording, by one network."""

    retrieval: Mapping[str, Mapping[str, float]]
    """plain and centred -> rank_1 and so on, on the true boxes."""
    appearance: LooksScore | None
    calibrated: Mapping[str, Calibrated]
    """By mode of association."""
    agreement: Mapping[str, IdentityAgreement]


@dataclass(frozen=True)
class Tuned:
    """One `passerby reid finetune`."""

    labels: Mapping[str, Any]
    """What it says of the pictures that it took as labels."""
    seconds: float


@dataclass(frozen=True)
class Team:
    """A team in one vest, before and after the network was adapted to it."""

    seed: int
    before: Mapping[str, Half]
    """By half."""
    after: Mapping[str, Half]
    """As before, where the calibration was sure of too few people."""
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
