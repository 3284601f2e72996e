"""Trainings that a user starts: from data sets to a folder with the network and its record.

A network can be adapted to one scene without labels: it is trained on people with significant identities, then the rig is
solved again. Xu et al., CVPR 2021, section 3.1, fine-tune on a scene's own people if clothes are similar, with manual labels.
Here the labels come from the rig, which was calibrated without them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from passerby._version import __version__
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.common.errors import InputError
from passerby.common.parallel import open_local_processes
from passerby.common.progress import Progress, silent
from passerby.core.observations import Vectors
from passerby.evaluation.retrieval import RetrievalScore
from passerby.interchange.storage.atomic import cannot_write
from passerby.scene.scene import Scene
from passerby.training.checkpoints import Checkpoint, load_checkpoint
from passerby.training.crops import CropSet, DataSet, mix_sets
from passerby.training.curves import EpochRecord, TrainingLog, write_curves
from passerby.training.embedding import leave_one_out, score_crops
from passerby.training.export import ExportReport, export_network
from passerby.training.network import ReidNetwork
from passerby.training.options import TrainOptions, train_options
from passerby.training.pictures import decode_pictures, embed_all
from passerby.training.scene_people import ScenePeople, scene_people
from passerby.training.training import Trained, train

CURVES = "curves.html"
FEW_PEOPLE = 20
"""With fewer people no person is held out, because all are needed for the training."""
COMPARED_PICTURES = 1000
"""Maximum number of real pictures on which an exported network is compared with PyTorch."""
RUN, NETWORK, CROPS, PERCEPTION = "run", "net.onnx", "crops", "perception"


@dataclass(frozen=True, eq=False)
class Course:
    """The pictures of a training and of its validation."""

    learnt: CropSet
    query: CropSet
    gallery: CropSet
    """Pictures that `query` searches; empty if held-out people search each other."""
    validated_on: str
    """Description of the validation."""


def course(sets: Sequence[DataSet], options: TrainOptions) -> Course:
    """Split the sets into training and validation: their own query and gallery, or otherwise some held-out people.

    Raises `InputError` if no set has people for the training.
    """
    learnt = mix_sets([one.train for one in sets])
    if not len(learnt):
        raise InputError(f"{', '.join(one.name for one in sets)}: no person to learn from: give data with a training part")
    query, gallery = mix_sets([one.query for one in sets]), mix_sets([one.gallery for one in sets])
    if len(query):
        return Course(learnt, query, gallery, f"{len(query)} images searched among {len(gallery)}")
    held = round(options.hold_out * len(learnt.people))
    if len(learnt.people) < FEW_PEOPLE or held < 2:
        return Course(learnt, CropSet(), CropSet(), "no person: there are too few people to hold some out")
    chosen = np.zeros(len(learnt.people), dtype=np.bool_)
    chosen[np.random.default_rng((options.seed, len(learnt.people))).permutation(len(learnt.people))[:held]] = True
    return Course(learnt.of_people(~chosen), learnt.of_people(chosen), CropSet(), f"{held} people who are held out")


def train_run(
    sets: Sequence[DataSet],
    options: TrainOptions,
    folder: Path,
    *,
    device: str = "auto",
    tell: Progress = silent,
    record: Callable[[EpochRecord], None] | None = None,
) -> Trained:
    """Train on data sets, and write `run.toml`, `checkpoint.pt`, `log.csv` and `curves.html` into a folder.

    A training that was stopped continues in its folder. Raises `InputError` as `training.train`.
    """
    split = course(sets, options)
    log = TrainingLog(folder)

    def keep(row: EpochRecord) -> None:
        log.append(row)
        if row.rank_1 is not None or row.epoch == options.epochs:
            write_curves(log, folder / CURVES)
        if record is not None:
            record(row)

    def validate(network: ReidNetwork) -> tuple[float, float]:
        score = _score(split, partial(embed_all, network, options=options))
        return score.rank_1, score.mean_average_precision

    origin = {"data": ", ".join(one.name for one in sets), "people": str(len(split.learnt.people)),
              "pictures": str(len(split.learnt)), "passerby": __version__}  # fmt: skip
    validates = validate if len(split.query) else None
    trained = train(split.learnt, options, folder, origin=origin, validate=validates, device=device, tell=tell, record=keep,
                    resumed=log.truncate_after)  # fmt: skip
    rows = log.rows()
    return replace(trained, validated_on=split.validated_on, last=rows[-1] if rows else None)


def _score(split: Course, embed: Callable[[CropSet], Vectors]) -> RetrievalScore:
    if len(split.gallery):
        return score_crops(split.query, split.gallery, embed(split.query), embed(split.gallery))
    return leave_one_out(split.query, embed(split.query))


def fine_tuning(start: Checkpoint, folder: Path) -> TrainOptions:
    """Return options to fine-tune a trained network in `folder`: its own, with fewer epochs and a smaller learning rate."""
    own = start.options
    return replace(own, epochs=40, learning_rate=0.3 * own.learning_rate, warm_up_epochs=2.0, schedule="cosine",
                   weights=str(folder))  # fmt: skip


def export_run(run: Path, path: Path, sets: Sequence[DataSet] = ()) -> ExportReport:
    """Write the network of a training to an ONNX file, compared with PyTorch on up to 1000 pictures of data sets.

    Raises `InputError` as `load_checkpoint` and `export_network`.
    """
    checkpoint = load_checkpoint(run)
    crops = mix_sets([part for one in sets for part in (one.query, one.gallery, one.train)])
    rows = np.unique(np.linspace(0, max(len(crops) - 1, 0), min(len(crops), COMPARED_PICTURES)).astype(np.int64))
    pictures = decode_pictures(crops.take(rows)) if len(crops) else None
    origin = {**checkpoint.origin, "backbone": checkpoint.options.backbone, "epochs": str(checkpoint.epoch)}
    return export_network(checkpoint.restored().eval(), checkpoint.options, path, pictures=pictures, origin=origin)


def run_embedder(run: Path) -> tuple[Callable[[CropSet], Vectors], Checkpoint]:
    """Return a function that embeds pictures with the network of a training, and its checkpoint.

    Raises `InputError` as `load_checkpoint`.
    """
    checkpoint = load_checkpoint(run)
    return partial(embed_all, checkpoint.restored().eval(), options=checkpoint.options), checkpoint


@dataclass(frozen=True, eq=False)
class FineTuned:
    """A network adapted to a scene, and the calibration with it."""

    folder: Path
    people: ScenePeople
    trained: Trained
    exported: ExportReport
    calibration: Calibration

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values for JSON."""
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
        """Return lines about the labels and the training for the user."""
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
        target: gets `run/`, `net.onnx`, and the new calibration; earlier results from the videos are used again.
        weights: the run that gives the first weights; None: a small network with random weights.
        scene: the scene file; None: the one that the calibration names.
        config: TOML file of training options.
        epochs: number of epochs; None: as in the options.
        seed: seed of the training and the calibration.
        device: auto or cpu.
        tell: called with the stages.
        record: called after each epoch.

    Raises:
        InputError: missing or damaged files, a run of another architecture.
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
    calibration = _calibrate_again(people.scene, target, seed, tell)
    calibration.write(target)
    return FineTuned(target, people, trained, exported, calibration)


def _options(weights: Path | None, config: Path | None, epochs: int | None, seed: int) -> TrainOptions:
    """Return the options: by `fine_tuning` if `weights` is given, otherwise the small recipe. No person is held out."""
    chosen: dict[str, Any] = {"epochs": epochs, "seed": seed, "hold_out": 0.0}
    if weights is None:
        return train_options("small", config, **chosen)
    return train_options("small", config, start=fine_tuning(load_checkpoint(weights), weights), **chosen)


def _calibrate_again(scene: Scene, target: Path, seed: int, tell: Progress) -> Calibration:
    """Calibrate the scene with the new network."""
    table = scene.perception.model_copy(update={"embedder": str((target / NETWORK).resolve())})
    changed = scene.with_perception(table)
    with open_local_processes(changed.size_bytes, len(changed.cameras), changed.n_videos) as executor:
        return calibrate(changed, seed=seed, progress=tell, executor=executor, keep=target)


def _take_over(kept: Path, target: Path) -> None:
    """Link or copy the earlier results from the videos to `target`. Raises `InputError` if they cannot be written."""
    if not kept.is_dir() or target.exists():
        return
    try:
        shutil.copytree(kept, target, copy_function=_link_file)
    except OSError as error:
        raise cannot_write(target, error) from error


def _link_file(source: str, target: str) -> None:
    """Make a hard link if the file system can, otherwise a copy. A link is safe: files are replaced, but never changed."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
