"""Trainings as a user starts them: data sets in, a folder with the network and its record out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from passerby._version import __version__
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.core.observations import Vectors
from passerby.evaluation.retrieval import RetrievalScore
from passerby.training.checkpoints import Checkpoint, load_checkpoint
from passerby.training.crops import CropSet, DataSet, mix_sets
from passerby.training.curves import EpochRecord, TrainingLog, write_curves
from passerby.training.embedding import leave_one_out, score_crops
from passerby.training.export import ExportReport, export_network
from passerby.training.network import ReidNetwork
from passerby.training.options import TrainOptions
from passerby.training.pictures import decoded_pictures, embed_all
from passerby.training.training import Trained, train

CURVES = "curves.html"
FEW_PEOPLE = 20
"""With fewer no person is held out: every one is needed to learn from."""
COMPARED_PICTURES = 1000
"""Real pictures on which an exported network is compared with PyTorch."""


@dataclass(frozen=True, eq=False)
class Course:
    """What is learnt from, and what validates."""

    learnt: CropSet
    query: CropSet
    gallery: CropSet
    """With `query`; empty where held-out people search each other."""
    validated_on: str
    """In words."""


def course(sets: Sequence[DataSet], options: TrainOptions) -> Course:
    """Split what is there: the sets' own query and gallery validate, else some people are held out.

    Raises `InputError` where no set has anybody to learn from.
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
    """Train on data sets into a folder: `run.toml`, `checkpoint.pt`, `log.csv`, `curves.html`. Stopped, it goes on there.

    Raises `InputError` as `training.train`.
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
    """Options that take a trained network, in `folder`, a little further: its own, fewer epochs, a gentler learning rate."""
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
    pictures = decoded_pictures(crops.take(rows)) if len(crops) else None
    origin = {**checkpoint.origin, "backbone": checkpoint.options.backbone, "epochs": str(checkpoint.epoch)}
    return export_network(checkpoint.restored().eval(), checkpoint.options, path, pictures=pictures, origin=origin)


def run_embedder(run: Path) -> tuple[Callable[[CropSet], Vectors], Checkpoint]:
    """The network of a training as it embeds pictures by PyTorch. Raises `InputError` as `load_checkpoint`."""
    checkpoint = load_checkpoint(run)
    return partial(embed_all, checkpoint.restored().eval(), options=checkpoint.options), checkpoint
