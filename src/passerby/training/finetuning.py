"""A network adapted to one scene without labels: people whom the calibration confirms teach it, then all is solved again.

Xu et al., CVPR 2021, section 3.1, fine-tune on a scene's own people where clothes are alike, with labels made by hand. Here the
rig that was found without them makes the labels.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from passerby.calibration.calibration import Calibration
from passerby.calibration.pipeline import calibrate
from passerby.common.errors import InputError
from passerby.common.parallel import local_processes
from passerby.common.progress import Progress, silent
from passerby.interchange.storage.atomic import cannot_write
from passerby.scene.scene import Scene
from passerby.training.checkpoints import load_checkpoint
from passerby.training.crops import DataSet
from passerby.training.curves import EpochRecord
from passerby.training.export import ExportReport
from passerby.training.options import TrainOptions, train_options
from passerby.training.runs import export_run, fine_tuning, train_run
from passerby.training.scene_people import ScenePeople, scene_people
from passerby.training.training import Trained

RUN, NETWORK, CROPS, PERCEPTION = "run", "net.onnx", "crops", "perception"


@dataclass(frozen=True, eq=False)
class FineTuned:
    """A network adapted to a scene, and the calibration by it."""

    folder: Path
    people: ScenePeople
    trained: Trained
    exported: ExportReport
    calibration: Calibration

    def to_dict(self) -> dict[str, Any]:
        """As plain values for JSON."""
        return {
            "folder": str(self.folder),
            "labels": self.people.figures,
            "notes": self.people.notes,
            "began_with": self.trained.note,
            "last": vars(self.trained.last) if self.trained.last else None,
            "exported": self.exported.to_dict(),
            "calibration": self.calibration.to_dict(),
        }

    def lines(self) -> list[str]:
        """What to tell of the labels and the training."""
        return [
            f"{len(self.people.crops)} images of {len(self.people.crops.people)} people that the calibration identifies "
            f"reliably",
            *self.people.notes,
            self.trained.note,
        ]


def finetune_scene(
    out: Path,
    target: Path,
    *,
    weights: Path | None = None,
    scene: Path | None = None,
    config: Path | None = None,
    epochs: int | None = None,
    seed: int = 0,
    device: str = "auto",
    tell: Progress = silent,
    record: Callable[[EpochRecord], None] | None = None,
) -> FineTuned:
    """Adapt a network to a calibrated scene, then associate and solve again.

    Args:
        out: output folder of a calibration of videos.
        target: gets `run/`, `net.onnx`, and the new calibration; what was found in the videos before is taken over.
        weights: the run to begin with; None: a small network, from random weights.
        scene: the scene file; None: the one that the calibration names.
        config: TOML file of training options.
        epochs: of the training; None: as the options say.
        seed: of the training and the calibration.
        device: auto or cpu.
        tell: called with the stages.
        record: called for every epoch.

    Raises:
        InputError: files that are missing or damaged, a run of another architecture.
        EvidenceError: the calibration was refused, or confirms too few people.
    """
    if target.resolve() == out.resolve():
        raise InputError(f"{target}: is the calibration to learn from, and would be overwritten: give another folder")
    options = _options(weights, config, epochs, seed)
    people = scene_people(out, target / CROPS, scene=scene, tell=tell)
    sets = [DataSet(people.scene.name, train=people.crops)]
    trained = train_run(sets, options, target / RUN, device=device, tell=tell, record=record)
    tell("exporting")
    exported = export_run(target / RUN, target / NETWORK, sets)
    _take_over(out / PERCEPTION, target / PERCEPTION)
    calibration = _again(people.scene, target, seed, tell)
    calibration.write(target)
    return FineTuned(target, people, trained, exported, calibration)


def _options(weights: Path | None, config: Path | None, epochs: int | None, seed: int) -> TrainOptions:
    """Those of the network that it begins with, gentler; or the small recipe's. No person is held out: people are few."""
    chosen: dict[str, Any] = {"epochs": epochs, "seed": seed, "hold_out": 0.0}
    if weights is None:
        return train_options("small", config, **chosen)
    return train_options("small", config, start=fine_tuning(load_checkpoint(weights), weights), **chosen)


def _again(scene: Scene, target: Path, seed: int, tell: Progress) -> Calibration:
    """The scene calibrated with the new network."""
    table = scene.perception.model_copy(update={"embedder": str((target / NETWORK).resolve())})
    changed = scene.with_perception(table)
    with local_processes(changed.size_bytes, len(changed.cameras), changed.n_videos) as executor:
        return calibrate(changed, seed=seed, progress=tell, executor=executor, keep=target)


def _take_over(kept: Path, target: Path) -> None:
    """What was found in the videos before need not be found again. Raises `InputError` where it cannot be written."""
    if not kept.is_dir() or target.exists():
        return
    try:
        shutil.copytree(kept, target, copy_function=_linked)
    except OSError as error:
        raise cannot_write(target, error) from error


def _linked(source: str, target: str) -> None:
    """The same file under another name where the file system can, else a copy; files are only ever replaced, not changed."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
