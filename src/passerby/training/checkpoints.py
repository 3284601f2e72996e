"""The state of a training on disk: all data to continue, evaluate or export it, written as a whole or not at all."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from pydantic import TypeAdapter, ValidationError
from torch import Tensor, nn
from torch.optim import Optimizer

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import write_bytes
from passerby.interchange.storage.text_formats import check_version
from passerby.training.network import ReidNetwork, make_kept_backbone
from passerby.training.options import TrainOptions

CHECKPOINT = "checkpoint.pt"
FORMAT_NAME, FORMAT_VERSION = "passerby-reid-", 1
FORMAT = f"{FORMAT_NAME}{FORMAT_VERSION}"
PARTS = ("epoch", "options", "architecture", "people", "data", "origin", "network", "optimizer")
"""Keys of a checkpoint, besides the format."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """The stored state of a training."""

    path: Path
    epoch: int
    """Number of finished epochs."""
    options: TrainOptions
    architecture: Mapping[str, Any]
    """Configuration of the backbone, with the keys of `transformers`."""
    people: int
    """Number of training people."""
    data: str
    """Digest of the training data."""
    origin: Mapping[str, str]
    """Source of the network: names of the data sets, first weights."""
    network: Mapping[str, Tensor] = field(repr=False)
    optimizer: Mapping[str, Any] = field(repr=False)

    def restored(self) -> ReidNetwork:
        """Return the network with its weights, on the processor."""
        options = self.options
        size = options.height, options.width
        backbone = make_kept_backbone(options.backbone, dict(self.architecture), size, options.last_stride)
        network = ReidNetwork(backbone, self.people, options)
        try:
            network.load_state_dict(dict(self.network))
        except RuntimeError as error:
            raise InputError(
                f"{self.path}: its weights do not fit its own description of the network "
                f"({' '.join(str(error).split())[:160]}): is it damaged? Train again"
            ) from None
        return network

    def load_into(self, network: ReidNetwork, backbone: str) -> None:
        """Load these weights into a network, except for the classifier, which is for other people.

        Raises `InputError` if they are for another backbone, or for other options of the architecture.
        """
        if self.options.backbone != backbone:
            raise InputError(
                f"{self.path}: is of the backbone {self.options.backbone}, not {backbone}: give backbone = "
                f'"{self.options.backbone}", or other weights'
            )
        own = network.state_dict()
        given = {name: value for name, value in self.network.items() if not name.startswith("classifier.")}
        odd = sorted(
            {name for name in own if not name.startswith("classifier.")} ^ set(given)
            | {name for name in given if name in own and own[name].shape != given[name].shape}
        )
        if odd:
            raise InputError(f"{self.path}: does not fit the options neck and pooling, or the backbone {backbone}: {odd[0]}")
        network.load_state_dict({**own, **given})


def save_checkpoint(
    path: Path,
    network: ReidNetwork,
    optimizer: Optimizer,
    epoch: int,
    options: TrainOptions,
    data: str,
    origin: Mapping[str, str],
) -> None:
    """Write the state after an epoch. Raises `InputError` if the folder cannot be written."""
    state = {
        "format": FORMAT,
        "epoch": epoch,
        "options": options.to_dict(),
        "architecture": architecture_of(network.backbone),
        "people": network.classifier.out_features,
        "data": data,
        "origin": dict(origin),
        "network": network.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    content = io.BytesIO()
    torch.save(state, content)
    write_bytes(path, content.getvalue())


def architecture_of(backbone: nn.Module) -> dict[str, Any]:
    """Return the values of a `transformers` model's configuration that differ from its defaults, as plain values."""
    config: Any = backbone.config
    plain: dict[str, Any] = config.to_diff_dict()
    return {"model_type": config.model_type, **{key: value for key, value in plain.items() if _is_plain(value)}}


def _is_plain(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(map(_is_plain, value))
    return isinstance(value, (str, int, float, bool)) or value is None


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint; `path` is the file, or the folder of a training.

    Raises `InputError` if there is none, it is damaged, or the file is not a checkpoint.
    """
    file = path / CHECKPOINT if path.is_dir() else path
    if not file.is_file():
        raise InputError(f"{file}: no such file: the folder of a training, or its {CHECKPOINT}, is needed here")
    state = _read(file)
    stated = str(state.get("format")) if isinstance(state, dict) else ""
    if stated.startswith(FORMAT_NAME) and stated.removeprefix(FORMAT_NAME).isdecimal():
        check_version(file, {"format": int(stated.removeprefix(FORMAT_NAME))}, "format", FORMAT_VERSION)
    if stated != FORMAT:
        raise InputError(f"{file}: is not a checkpoint of passerby reid train ({FORMAT}): give one that is")
    lacking = [part for part in PARTS if part not in state]
    if lacking:
        raise InputError(f"{file}: lacks {', '.join(lacking)}: is it damaged? Train again, or give another")
    try:
        options = TypeAdapter(TrainOptions).validate_python(state["options"])
    except (ValidationError, InputError) as error:
        raise InputError(
            f"{file}: its options are not understood ({' '.join(str(error).split())[:120]}): train again"
        ) from None
    return Checkpoint(file, **{**{part: state[part] for part in PARTS}, "options": options})


def _read(file: Path) -> Any:
    """Read the content that torch stored in a file. Raises `InputError` if the file is damaged or not from torch."""
    try:
        with zipfile.ZipFile(file) as archive:
            damaged = archive.testzip()  # torch writes checksums, but does not check them when it reads
        if damaged is not None:
            raise zipfile.BadZipFile(f"{damaged} is damaged")
        return torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # unpickling raises many kinds of exceptions for other bytes
        raise InputError(
            f"{file}: is not a checkpoint that can be read ({' '.join(str(error).split())[:120]}): train again, or give another"
        ) from None
