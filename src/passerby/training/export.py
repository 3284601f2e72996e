"""Export of a trained network to one ONNX file for the perception stage; it is compared with PyTorch before it is written."""

from __future__ import annotations

import copy
import hashlib
import logging
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from onnx import GraphProto, ModelProto
from torch import Tensor, nn

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.observations import Vectors
from passerby.interchange.storage.atomic import write_bytes
from passerby.perception.crop_network import is_recognisable, stretch_crop
from passerby.perception.networks import IMAGENET, PREFIX, read_own_network
from passerby.perception.pictures import Picture
from passerby.perception.reid import BATCH, ReidEmbedder
from passerby.training.network import ReidNetwork
from passerby.training.options import TrainOptions
from passerby.training.pictures import make_batch, normalise_pictures

ORIGIN = "trained."
"""Prefix of the metadata about the source of a network; only people read them."""

# Sums of float32 in another order: 8e-7 measured on a trained `small`. A larger difference than this is a wrong export.
MAX_DIFFERENCE = 1e-3
# Cosine distances that differ by less are a tie: only rounding determines their order.
TIE = 1e-5
# Maximum size of protobuf, and so of one ONNX file, bytes.
LARGEST_FILE = 2**31 - 1
# One full batch and one that is not full.
RANDOM_PICTURES = BATCH + 3
SEED = 0

View = tuple[Picture, Floats]
"""A picture and (N, 4) boxes in it."""


@dataclass(frozen=True)
class ExportAgreement:
    """Differences between two runs of a network on the same N pictures, in unit vectors."""

    pictures: int
    largest_difference: float
    """Largest difference of any number of any vector."""
    worst_cosine: float
    """Smallest cosine between a picture's two vectors."""
    largest_swap: float
    """For pairs of pictures that ONNX Runtime ranks in the other order: the largest difference of their cosine distances to a
    third picture in PyTorch; 0 if all rankings are the same."""

    @property
    def same_ranking(self) -> bool:
        """Whether each picture ranks the others in the same order, except for ties (`TIE`)."""
        return self.largest_swap <= TIE

    def to_dict(self) -> dict[str, Any]:
        """Return the differences as plain values."""
        return {**asdict(self), "same_ranking": self.same_ranking}


@dataclass(frozen=True)
class ExportReport:
    """The written file, and its agreement with PyTorch."""

    path: Path
    bytes: int
    sha256: str
    """Digest of the file, hexadecimal."""
    opset: int
    """Version of ONNX's operators."""
    dimensions: int
    """Length of a vector."""
    random: ExportAgreement
    """Agreement on pictures of noise."""
    real: ExportAgreement | None
    """Agreement on the given pictures; None if there were none."""
    too_small: int = 0
    """Number of given pictures that were left out because they are too small for any embedder."""

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {
            "path": str(self.path),
            "bytes": self.bytes,
            "sha256": self.sha256,
            "opset": self.opset,
            "dimensions": self.dimensions,
            "random": self.random.to_dict(),
            "real": None if self.real is None else self.real.to_dict(),
            "too_small": self.too_small,
        }


class _Embedding(nn.Module):
    """The exported part of the network, from pictures to embeddings, without the classifier."""

    def __init__(self, network: ReidNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, pictures: Tensor) -> Tensor:
        """Compute embeddings (N, C) of pictures (N, 3, H, W)."""
        return self.network.embed(pictures)


def export_network(
    network: ReidNetwork,
    options: TrainOptions,
    path: Path,
    *,
    pictures: Sequence[Picture] | None = None,
    origin: Mapping[str, str] | None = None,
) -> ExportReport:
    """Write a network to one ONNX file: (N, 3, height, width) of float32, RGB as ImageNet's, to embeddings (N, C), for any N.

    The same network gives the same bytes. The metadata state its preprocessing. Before the file is written, it is opened and
    run as in the perception stage, and compared with PyTorch.

    Args:
        network: the trained network; it is not changed.
        options: options of its training.
        path: path of the ONNX file; it is written as a whole or not at all.
        pictures: real crops of people, BGR, of any sizes, for the comparison; None: only noise is compared.
        origin: further entries for the metadata, as `trained.KEY`.

    Raises `InputError` if the backbone cannot be exported, the network gives numbers that are not finite, the two runs differ
    by more than `MAX_DIFFERENCE`, or the file cannot be written; then nothing is written.
    """
    exported = copy.deepcopy(network).to("cpu", torch.float32).eval()
    given = [(picture, _make_full_box(picture)) for picture in pictures or ()]
    large = [view for view in given if is_recognisable(*view).all()]
    noise = _noise(options)
    size = (options.width, options.height)
    expected = [torch_vectors(exported, size, views) for views in (noise, large) if views]
    model = _convert_to_onnx(exported, options)
    _describe(model, {} if origin is None else origin)
    data: bytes = model.SerializeToString(deterministic=True)
    sha256 = hashlib.sha256(data).hexdigest()
    with tempfile.TemporaryDirectory(prefix="passerby-") as folder:
        trial = Path(folder) / path.name
        write_bytes(trial, data)
        embedder = ReidEmbedder(read_own_network(trial, "embedder", sha256))
        random = _compare_outputs(expected[0], embedder, noise, f"backbone {options.backbone}: on random images")
        real = (
            _compare_outputs(expected[1], embedder, large, f"backbone {options.backbone}: on the given images")
            if large
            else None
        )
    write_bytes(path, data)
    opset = max(entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx"))
    return ExportReport(path, len(data), sha256, opset, embedder.dimensions, random, real, len(given) - len(large))


def torch_vectors(network: ReidNetwork, size: tuple[int, int], views: Sequence[View]) -> Vectors:
    """Compute unit vectors (N, C) of all boxes by PyTorch, like `ReidEmbedder`; `size` is width and height of the input.

    The network must be in evaluation mode. Raises `InputError` if it gives numbers that are not finite.
    """
    device = next(network.parameters()).device
    crops = [stretch_crop(picture, box, size) for picture, boxes in views for box in boxes]
    parts = []
    with torch.inference_mode():
        for start in range(0, len(crops), BATCH):
            parts.append(
                network.embed(normalise_pictures(make_batch(crops[start : start + BATCH]).to(device))).double().cpu().numpy()
            )
    raw = np.concatenate(parts)
    if not np.isfinite(raw).all():
        raise InputError("the network gives numbers that are not finite: its training has failed; export an earlier checkpoint")
    length = np.linalg.norm(raw, axis=1, keepdims=True)
    return np.asarray(np.where(length > 0, raw / np.where(length > 0, length, 1.0), 0.0), dtype=np.float32)


def compare_outputs(reference: Vectors, found: Vectors) -> ExportAgreement:
    """Compare unit vectors (N, D) with the reference ones (N, D) of the same N pictures; N is at least 1."""
    a, b = reference.astype(np.float64), found.astype(np.float64)
    largest_swap = 0.0
    for row in range(len(a)):
        distance, order = 1.0 - a @ a[row], np.argsort(1.0 - b @ b[row], kind="stable")
        # In the order of `found`, a distance may be smaller than an earlier one: the difference measures the wrong order.
        ranked = distance[order]
        largest_swap = max(largest_swap, float((np.maximum.accumulate(ranked) - ranked).max()))
    cosine = float((a * b).sum(axis=1).min())
    return ExportAgreement(len(a), float(np.abs(a - b).max()), min(cosine, 1.0), largest_swap)


def _compare_outputs(expected: Vectors, embedder: ReidEmbedder, views: Sequence[View], place: str) -> ExportAgreement:
    """Compare the vectors of PyTorch with those of the file. Raises `InputError` if they differ by too much.

    `place` is the beginning of the message: the network and the pictures.
    """
    result = compare_outputs(expected, np.concatenate([embedder(picture, boxes) for picture, boxes in views]))
    if result.largest_difference > MAX_DIFFERENCE:
        raise InputError(
            f"{place}, the ONNX file gives other vectors than PyTorch: they differ by {result.largest_difference:.2g}, more "
            f"than {MAX_DIFFERENCE:g}: nothing was written; train with another backbone"
        )
    return result


def _make_full_box(picture: Picture) -> Floats:
    """Return the box (1, 4) of the whole picture."""
    height, width = picture.shape[:2]
    return np.array([[0.0, 0.0, width, height]])


def _noise(options: TrainOptions) -> list[View]:
    """Return one picture with `RANDOM_PICTURES` boxes side by side, of the input's size, with coloured patches and noise."""
    rng = np.random.default_rng(SEED)
    width, height = max(options.width, 8), max(options.height, 16)
    crops = []
    for _ in range(RANDOM_PICTURES):
        patches = cv2.resize(rng.uniform(0, 255, (6, 3, 3)), (width, height), interpolation=cv2.INTER_LINEAR)
        crops.append(np.clip(patches + rng.normal(0, 20, patches.shape), 0, 255).astype(np.uint8))
    boxes = np.array([[row * width, 0.0, width, height] for row in range(RANDOM_PICTURES)], dtype=np.float64)
    return [(np.concatenate(crops, axis=1), boxes)]


def _convert_to_onnx(network: ReidNetwork, options: TrainOptions) -> ModelProto:
    """Convert the network to ONNX, without information about this machine. Raises `InputError` if it cannot be exported."""
    size = 4 * sum(weights.numel() for weights in network.backbone.parameters())
    if size > LARGEST_FILE:
        raise InputError(
            f"backbone {options.backbone}: its weights take {size / 1e9:.1f} GB, one ONNX file holds "
            f"{LARGEST_FILE / 1e9:.1f} GB: train with a smaller backbone"
        )
    example = torch.zeros(2, 3, options.height, options.width)  # the exporter would treat a batch of 1 as a constant
    try:
        with _silence_exporter():
            program = torch.onnx.export(
                _Embedding(network).eval(),
                (example,),
                dynamo=True,
                dynamic_shapes=({0: torch.export.Dim("batch")},),
                input_names=["pictures"],
                output_names=["embedding"],
                verbose=False,
            )
            assert program is not None
            model: ModelProto = program.model_proto
    except Exception as error:  # many libraries, whose exceptions have no common base
        raise InputError(
            f"backbone {options.backbone}: cannot be exported to ONNX ({_reason(error)}): train with another backbone"
        ) from error
    _forget_machine(model.graph)
    for function in model.functions:
        del function.metadata_props[:]
        for node in function.node:
            node.ClearField("metadata_props")
            node.ClearField("doc_string")
    del model.metadata_props[:]
    return model


def _forget_machine(graph: GraphProto) -> None:
    """Remove PyTorch's notes from a graph: stack traces with the paths of this machine, names of modules."""
    graph.name = "passerby"
    for things in (graph.node, graph.input, graph.output, graph.value_info, graph.initializer):
        for thing in things:
            thing.ClearField("metadata_props")
            thing.ClearField("doc_string")
    graph.ClearField("metadata_props")
    graph.ClearField("doc_string")
    for node in graph.node:
        for attribute in node.attribute:
            for inner in (attribute.g, *attribute.graphs) if attribute.HasField("g") else attribute.graphs:
                _forget_machine(inner)


def _describe(model: ModelProto, origin: Mapping[str, str]) -> None:
    """Add the input conventions and the source to the metadata; `repr` of a float is read back as the same float."""
    told = {
        "role": "embedder",
        "output": "embedding",
        "colour": IMAGENET.colour,
        "scale": repr(IMAGENET.scale),
        "mean": " ".join(map(repr, IMAGENET.mean)),
        "std": " ".join(map(repr, IMAGENET.std)),
        "fit": IMAGENET.fit,
    }
    for key, value in told.items():
        model.metadata_props.add(key=f"{PREFIX}{key}", value=value)
    for key, value in sorted(origin.items()):
        model.metadata_props.add(key=f"{ORIGIN}{key}", value=value)


def _reason(error: BaseException) -> str:
    """Return the last part of PyTorch's message in one line, without colours, advice and stack traces."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    summary = text.rsplit("## Exception summary", 1)[-1].split("(Refer to the full stack trace", 1)[0]
    return " ".join(summary.split())[:200] or type(error).__name__


@contextmanager
def _silence_exporter() -> Iterator[None]:
    """Silence the exporter's warnings, which are for its developers, such as a missing torchvision; errors are still raised."""
    loggers = [logging.getLogger(name) for name in ("torch.onnx", "torch.onnx._internal.exporter._registration", "onnxscript")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
