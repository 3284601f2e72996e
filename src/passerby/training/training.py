"""The training of a network: epochs, learning rate, checkpoints, validation. A stopped training continues from its checkpoint.

An epoch depends only on the options, the epoch's number, and the state after the epoch before. Therefore a training that was
killed and continued gives the same result as one that was not, bit for bit on the processor.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from accelerate import Accelerator
from torch import Tensor, nn
from torch.optim import AdamW, Optimizer
from torch.utils.data import DataLoader, Dataset

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.text_formats import to_toml
from passerby.training.checkpoints import CHECKPOINT, Checkpoint, load_checkpoint, save_checkpoint
from passerby.training.crops import CropSet
from passerby.training.curves import EpochRecord
from passerby.training.network import Loss, ReidLoss, ReidNetwork, open_backbone
from passerby.training.options import TrainOptions
from passerby.training.pictures import BatchSampler, Draw, augment, load_picture, normalise_pictures

RUN_FILE = "run.toml"
DECAY_EXEMPT = ("bias", "power")
"""Endings of the names of parameters without weight decay, which would only distort them. Parameters of one dimension, such as
those of normalisations, have none either."""
KEPT_WEIGHTS = ("auto", "published", "random")

Validate = Callable[[ReidNetwork], tuple[float, float]]
"""Function that scores a network: rank-1 and mAP."""


@dataclass(frozen=True, eq=False)
class Trained:
    """A finished training."""

    folder: Path
    network: ReidNetwork
    options: TrainOptions
    origin: Mapping[str, str]
    note: str
    """The weights with which it began."""
    resumed_after: int
    """Number of epochs that an earlier run had finished."""
    validated_on: str = "nobody"
    last: EpochRecord | None = None
    """Record of the last epoch."""


class _Pictures(Dataset[tuple[Tensor, int]]):
    """The pictures of a set, with a different variation for each draw."""

    def __init__(self, crops: CropSet, options: TrainOptions) -> None:
        self._crops, self._options = crops, options

    def __getitem__(self, draw: Draw) -> tuple[Tensor, int]:
        row, epoch, place = draw
        picture = load_picture(self._crops.paths[row], (self._options.width, self._options.height))
        rng = np.random.default_rng((self._options.seed, epoch, place))
        return torch.from_numpy(augment(picture, self._options, rng)), int(self._crops.person[row])


def train(
    crops: CropSet,
    options: TrainOptions,
    folder: Path,
    *,
    origin: Mapping[str, str],
    validate: Validate | None = None,
    device: str = "auto",
    tell: Progress = silent,
    record: Callable[[EpochRecord], None] | None = None,
    resumed: Callable[[int], None] | None = None,
) -> Trained:
    """Train a network, or continue a training that was stopped.

    Args:
        crops: training pictures; each person has two or more.
        options: options of the training.
        folder: folder of `run.toml` and of `checkpoint.pt`, the state after the last whole epoch.
        origin: source of the network, for the checkpoint.
        validate: scores the network every `options.validate_every` epochs, and after the last one.
        device: auto (a graphics card if there is one) or cpu.
        tell: called with the batches.
        record: called after each epoch.
        resumed: called, before the first epoch, with the number of epochs that an earlier run has finished.

    Raises:
        InputError: too few people; a checkpoint of another training in the folder; weights of another backbone; a loss that is
            not a number (the checkpoint of the last whole epoch stays).
    """
    _check(crops, options)
    before = _read_earlier(folder, crops, options)
    with _deterministic():
        training = _Training(crops, options, folder, {**origin, "began_with": options.weights}, before, device)
        if resumed is not None:
            resumed(training.done)
        for epoch in range(training.done, options.epochs):
            row = training.epoch(epoch, tell)
            last = epoch + 1 == options.epochs
            if validate is not None and (last or (epoch + 1) % options.validate_every == 0):
                training.network.eval()
                rank_1, mean_precision = validate(training.network)
                row = replace(row, rank_1=rank_1, map=mean_precision)
            if record is not None and training.leads:
                record(row)
            training.keep(epoch + 1)
    network = training.network.cpu().eval()
    return Trained(folder, network, options, training.origin, training.note, training.done)


def _check(crops: CropSet, options: TrainOptions) -> None:
    """Raise `InputError` if the crops are not sufficient for a training."""
    counts = np.bincount(crops.person[crops.person >= 0], minlength=len(crops.people)) if len(crops) else np.zeros(0, int)
    if (crops.person < 0).any() or (counts == 1).any():
        raise InputError("training: an image of no person, or a person with one image only: leave them out")
    if (counts > 1).sum() < 2:
        raise InputError(
            f"training: {int((counts > 1).sum())} people with two images or more: at least two are needed, and hundreds for a "
            f"useful network"
        )
    if options.workers < 0:
        raise InputError(f"workers = {options.workers}: give 0 or more")


def _read_earlier(folder: Path, crops: CropSet, options: TrainOptions) -> Checkpoint | None:
    """Read the state of an earlier run, None if there is none. Raises `InputError` if it was another training."""
    if not (folder / CHECKPOINT).is_file():
        return None
    found = load_checkpoint(folder)
    known, wanted = found.options.to_dict(), options.to_dict()
    for key in wanted:
        if known[key] != wanted[key] and key != "workers":
            raise InputError(
                f"{folder / CHECKPOINT}: an earlier training had {key} = {known[key]!r}, this one has {wanted[key]!r}: give "
                "another folder, or delete this one to begin again"
            )
    if found.data != data_key(crops):
        raise InputError(
            f"{folder / CHECKPOINT}: an earlier training was on other images: give another folder, or delete this one to "
            "begin again"
        )
    return found


def data_key(crops: CropSet) -> str:
    """Return a digest of the training data: people, cameras, and names and sizes of the files, without their folders."""
    digest = hashlib.blake2b(digest_size=16)
    for path, person, camera in zip(crops.paths, crops.person.tolist(), crops.camera.tolist(), strict=True):
        digest.update(f"{crops.people[person]}\n{crops.cameras[camera]}\n{path.name}\n{path.stat().st_size}\n".encode())
    if crops.apart is not None:
        digest.update(np.packbits(crops.apart).tobytes())
    return digest.hexdigest()


class _Training:
    """The state of a training between two epochs."""

    def __init__(
        self, crops: CropSet, options: TrainOptions, folder: Path, origin: Mapping[str, str], before: Checkpoint | None,
        device: str,
    ) -> None:  # fmt: skip
        self._options, self._folder, self._crops = options, folder, crops
        self._data = data_key(crops)
        self.done = before.epoch if before else 0
        network, self.note, self.origin = _begin_training(crops, options, origin, before)
        self._accelerator = Accelerator(cpu=device == "cpu", mixed_precision=options.precision)
        self.leads = self._accelerator.is_main_process
        network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        optimizer = AdamW(_parameters(network, options), lr=options.learning_rate, fused=True)
        self._sampler = BatchSampler(crops, options.people_per_batch, options.pictures_per_person, options.seed)
        loader = DataLoader(_Pictures(crops, options), batch_sampler=self._sampler, num_workers=options.workers)
        self._model, self._optimizer, self._loader = self._accelerator.prepare(network, optimizer, loader)
        if before is not None:
            self._optimizer.load_state_dict(before.optimizer)
        apart = None if crops.apart is None else torch.from_numpy(np.asarray(crops.apart))
        self._loss = ReidLoss(options, apart).to(self._accelerator.device)
        if before is None and self.leads:
            write_text(folder / RUN_FILE, to_toml({"options": options.to_dict(), "origin": dict(self.origin)}))

    @property
    def network(self) -> ReidNetwork:
        """The network itself, without the wrapper for several devices."""
        unwrapped: ReidNetwork = self._accelerator.unwrap_model(self._model)
        return unwrapped

    def epoch(self, epoch: int, tell: Progress) -> EpochRecord:
        """Train for one epoch. Raises `InputError` if a loss, or a weight after the last step, is not a finite number."""
        self._sampler.epoch = epoch
        torch.manual_seed(int(np.random.SeedSequence((self._options.seed, epoch)).generate_state(1)[0]))
        self._model.train()
        batches = len(self._loader)
        sums, rate = np.zeros(3), 0.0
        for batch, (pictures, person) in enumerate(self._loader):
            step = epoch * batches + batch
            rate = learning_rate(self._options, step, batches)
            for group in self._optimizer.param_groups:
                group["lr"] = rate
            self._optimizer.zero_grad(set_to_none=True)
            with self._accelerator.autocast():
                answers = self._model(normalise_pictures(pictures))
            loss: Loss = self._loss(answers, person)
            values = torch.stack([loss.total, loss.identity, loss.triplet]).detach().double().cpu().numpy()
            if not np.isfinite(values).all():
                raise self._describe_break(epoch, batch, f"the loss is {values[0]}")
            self._accelerator.backward(loss.total)
            self._optimizer.step()
            sums += values
            tell("training", step + 1, batches * self._options.epochs)
        if not all(bool(value.isfinite().all()) for value in self.network.state_dict().values()):
            raise self._describe_break(epoch, batches - 1, "the weights are not numbers")
        mean = (sums / batches).tolist()
        return EpochRecord(epoch + 1, (epoch + 1) * batches, rate, *mean)

    def keep(self, epoch: int) -> None:
        """Keep the state after an epoch."""
        if self.leads:
            optimizer: Any = self._optimizer
            kept: Optimizer = getattr(optimizer, "optimizer", optimizer)
            save_checkpoint(self._folder / CHECKPOINT, self.network, kept, epoch, self._options, self._data, self.origin)

    def _describe_break(self, epoch: int, batch: int, what: str) -> InputError:
        good = f"{CHECKPOINT} has the network after epoch {epoch}" if epoch else "nothing was stored, it was the first epoch"
        return InputError(
            f"{self._folder}: {what} in epoch {epoch + 1}, batch {batch + 1}: {good}: lower learning_rate "
            f"({self._options.learning_rate:g}) or lengthen warm_up_epochs ({self._options.warm_up_epochs:g})"
            + (f", or give precision = no instead of {self._options.precision}" if self._options.precision != "no" else "")
        )


def _begin_training(
    crops: CropSet, options: TrainOptions, origin: Mapping[str, str], before: Checkpoint | None
) -> tuple[ReidNetwork, str, dict[str, str]]:
    """Return the network of the start or of the checkpoint, a note about its weights, and its source."""
    if before is not None:
        return before.restored(), f"continues after epoch {before.epoch} of {options.epochs}", dict(before.origin)
    torch.manual_seed(options.seed)
    size = options.height, options.width
    if options.weights in KEPT_WEIGHTS:
        backbone = open_backbone(options.backbone, size, options.weights, options.last_stride)
        return ReidNetwork(backbone, len(crops.people), options), backbone.note, {**origin, "began_with": backbone.note}
    start = load_checkpoint(Path(options.weights))
    backbone = open_backbone(options.backbone, size, "random", options.last_stride)
    network = ReidNetwork(backbone, len(crops.people), options)
    start.load_into(network, options.backbone)
    note = (
        f"{options.backbone}: starts with {start.path}, after {start.epoch} epochs on {start.origin.get('data', 'other data')}"
    )
    return network, note, {**origin, "began_with": f"{start.origin.get('data', 'other data')}, {start.epoch} epochs"}


def _parameters(network: nn.Module, options: TrainOptions) -> list[dict[str, Any]]:
    """Return the trained parameters in two groups: with weight decay, and without."""
    learnt = [(name, value) for name, value in network.named_parameters() if value.requires_grad]
    exempt = [value.ndim <= 1 or name.endswith(DECAY_EXEMPT) for name, value in learnt]
    return [
        {"params": [v for (_, v), out in zip(learnt, exempt, strict=True) if not out], "weight_decay": options.weight_decay},
        {"params": [v for (_, v), out in zip(learnt, exempt, strict=True) if out], "weight_decay": 0.0},
    ]


def learning_rate(options: TrainOptions, step: int, batches: int) -> float:
    """Return the learning rate of a step, from 0: a linear warm-up, then constant or half a cosine down to a thousandth."""
    warm, total = options.warm_up_epochs * batches, options.epochs * batches
    if step < warm:
        return options.learning_rate * (step + 1) / warm
    if options.schedule == "constant":
        return options.learning_rate
    return options.learning_rate * max(0.5 * (1.0 + math.cos(math.pi * (step - warm) / max(total - warm, 1.0))), 1e-3)


@contextmanager
def _deterministic() -> Iterator[None]:
    """Let torch use algorithms that give the same bits each time, if it has them, for the context."""
    before, only_warned = torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()
    torch.use_deterministic_algorithms(True, warn_only=True)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before, warn_only=only_warned)
