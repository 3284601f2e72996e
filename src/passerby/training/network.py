"""The re-identification network: backbones by name, pooling, neck, classifier, and the losses of its training.

Identity loss: cross entropy over the training people, with label smoothing (Szegedy et al., CVPR 2016). Triplet loss:
max(0, margin + |f - f_positive| - |f - f_negative|), mean over the pictures of a batch, with the hardest positive and the
hardest negative of each (Hermans, Beyer, Leibe, *In Defense of the Triplet Loss for Person Re-Identification*, 2017).
Xu et al., CVPR 2021, section 3.1, use both.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import torch
from huggingface_hub import get_hf_file_metadata, hf_hub_url
from pytorch_metric_learning.distances import LpDistance
from pytorch_metric_learning.losses import TripletMarginLoss
from pytorch_metric_learning.miners import BatchHardMiner
from pytorch_metric_learning.reducers import MeanReducer
from torch import Tensor, nn
from torch.nn import functional
from transformers import AutoConfig, AutoModel, PretrainedConfig, ResNetConfig

from passerby.common.errors import InputError
from passerby.perception.fetching import offline
from passerby.training.options import TrainOptions

BASIC, BOTTLENECK = "basic", "bottleneck"
RESNETS: dict[str, tuple[str, tuple[int, ...], int, int]] = {
    "small": (BASIC, (1, 1, 1, 1), 32, 32),
    "resnet-18": (BASIC, (2, 2, 2, 2), 64, 64),
    "resnet-26": (BOTTLENECK, (2, 2, 2, 2), 64, 256),
    "resnet-34": (BASIC, (3, 4, 6, 3), 64, 64),
    "resnet-50": (BOTTLENECK, (3, 4, 6, 3), 64, 256),
    "resnet-101": (BOTTLENECK, (3, 4, 23, 3), 64, 256),
    "resnet-152": (BOTTLENECK, (3, 8, 36, 3), 64, 256),
}
"""Kind of layers, their numbers in the four stages, channels of the stem and of the first stage; each further stage doubles
them."""
UNPUBLISHED = ("small",)
PUBLISHER = "microsoft"
HUB_TIMEOUT_S = 3.0


@dataclass(frozen=True, eq=False)
class Answers:
    """Output of the network for N pictures."""

    pooled: Tensor
    """(N, C) features that the triplet loss compares."""
    embedding: Tensor
    """(N, C) features for retrieval: those of the neck, or the pooled ones without a neck."""
    logits: Tensor
    """(N, P) logits of the training people."""


class ReidNetwork(nn.Module):
    """The network from pictures (N, 3, H, W), RGB normalised as ImageNet's, to `Answers`."""

    def __init__(self, backbone: Backbone, people: int, options: TrainOptions) -> None:
        super().__init__()
        self.backbone = backbone.network
        self.channels = backbone.channels
        self.power = nn.Parameter(torch.tensor(3.0)) if options.pooling == "gem" else None
        # Luo et al. 2019: the shift is fixed at 0; the classifier's boundaries then pass through the origin, as with cosines.
        self.neck: nn.Module = nn.BatchNorm1d(backbone.channels) if options.neck else nn.Identity()
        if isinstance(self.neck, nn.BatchNorm1d):
            self.neck.bias.requires_grad_(False)
        self.classifier = nn.Linear(backbone.channels, people, bias=False)
        nn.init.normal_(self.classifier.weight, std=0.001)

    def forward(self, pictures: Tensor) -> Answers:
        """Compute the `Answers` to pictures (N, 3, H, W)."""
        pooled = self.pooled(pictures)
        embedding = self.neck(pooled)
        return Answers(pooled, embedding, self.classifier(embedding))

    def pooled(self, pictures: Tensor) -> Tensor:
        """Compute the mean (N, C) of the last feature map, plain or generalised: (mean x^p)^(1/p) with a trained p."""
        features = feature_map(self.backbone(pictures))
        if self.power is None:
            return features.mean(dim=(2, 3))
        return features.clamp(min=1e-6).pow(self.power).mean(dim=(2, 3)).pow(1.0 / self.power)

    def embed(self, pictures: Tensor) -> Tensor:
        """Compute only the embeddings (N, C), of any length."""
        found: Tensor = self.neck(self.pooled(pictures))
        return found


@dataclass(frozen=True, eq=False)
class Loss:
    """The loss of one batch, and its parts without weights."""

    total: Tensor
    identity: Tensor
    triplet: Tensor


class ReidLoss(nn.Module):
    """The weighted sum of identity and triplet loss."""

    unknown: Tensor | None

    def __init__(self, options: TrainOptions, apart: Tensor | None = None) -> None:
        """Set up. `apart`: (P, P) whether two people are known to be different; None: all are.

        For a person, the classes of people who may be the same person are left out of the identity loss.
        """
        super().__init__()
        self._weights = options.identity_weight, options.triplet_weight
        self._smoothing = options.label_smoothing
        distance = LpDistance(normalize_embeddings=False, p=2)
        self._miner = BatchHardMiner(distance=distance)
        self._triplet = TripletMarginLoss(margin=options.margin, distance=distance, reducer=MeanReducer())
        unknown = None if apart is None else ~(apart | torch.eye(len(apart), dtype=torch.bool))
        self.register_buffer("unknown", unknown, persistent=False)

    def forward(self, answers: Answers, person: Tensor) -> Loss:
        """Compute the loss of N answers to pictures of the people (N,)."""
        identity = identity_loss(answers.logits, person, self._smoothing, self.unknown)
        pooled = answers.pooled.float()
        triplet: Tensor = self._triplet(pooled, person, self._miner(pooled, person))
        by_identity, by_triplet = self._weights
        return Loss(by_identity * identity + by_triplet * triplet, identity, triplet)


def identity_loss(logits: Tensor, person: Tensor, smoothing: float, unknown: Tensor | None = None) -> Tensor:
    """Compute the cross entropy with label smoothing over the person and all people who are known to be different.

    Args:
        logits: (N, P) logits.
        person: (N,) rows of the P people.
        smoothing: share of the target that is spread evenly over all classes that are used.
        unknown: (P, P) whether two may be the same person under two names: such a class is left out of the sum.
    """
    if unknown is None:
        return functional.cross_entropy(logits.float(), person, label_smoothing=smoothing)
    out = unknown[person]
    log_share = logits.float().masked_fill(out, -torch.inf).log_softmax(dim=1)
    own = log_share.gather(1, person[:, None]).squeeze(1)
    counted = (~out).sum(dim=1)
    spread = log_share.masked_fill(out, 0.0).sum(dim=1) / counted
    return -((1.0 - smoothing) * own + smoothing * spread).mean()


@dataclass(frozen=True, eq=False)
class Backbone:
    """A network from pictures (N, 3, H, W) to a feature map, and the source of its weights."""

    network: nn.Module
    channels: int
    published: bool
    """Whether it has published weights, not random ones."""
    note: str
    """Note for the user about the weights."""


def open_backbone(name: str, size: tuple[int, int], weights: str = "auto", last_stride: int = 1) -> Backbone:
    """Open a backbone by its name.

    Args:
        name: one of `RESNETS`; or a model of `transformers`: its type (convnextv2), its name on the hub (owner/name) or a
            folder that holds one.
        size: height and width of the pictures, pixels.
        weights: auto, published or random. `auto` uses published weights if they are on this computer or can be fetched.
        last_stride: stride of a ResNet's last stage; 1 instead of 2 doubles the resolution.

    Raises `InputError` for a name that does not exist, for required published weights that are not available, and for a
    network that gives no feature map for such pictures.
    """
    network, published, note = _make_network(name, weights)
    if last_stride == 1:
        _keep_resolution(network, name)
    return Backbone(network, _channels(network, name, size), published, note)


def make_kept_backbone(name: str, configuration: dict[str, Any], size: tuple[int, int], last_stride: int) -> Backbone:
    """Make the backbone of a checkpoint by its stored architecture; its weights still have to be loaded."""
    known = dict(configuration)
    with _silence_warnings():
        config = AutoConfig.for_model(known.pop("model_type"), **known)
        network: nn.Module = AutoModel.from_config(config)  # type: ignore[no-untyped-call]
    if last_stride == 1:
        _keep_resolution(network, name)
    return Backbone(network, _channels(network, name, size), False, f"{name}: as in the checkpoint")


def _make_network(name: str, weights: str) -> tuple[nn.Module, bool, str]:
    """Return the network, whether its weights are published ones, and a note about them."""
    source = _source(name)
    title = Path(name).name if source == name and Path(name).is_dir() else name
    if weights != "random" and source is not None:
        try:
            network = cast(nn.Module, had(AutoModel.from_pretrained, source))
            return network, True, f"{title}: starts with the weights of {title if source == name else source}"
        except UNAVAILABLE as error:
            if weights == "published":
                reason = " ".join(str(error).split())[:200]
                raise InputError(f"backbone {name}: the weights of {source} are not available: {reason}") from None
    if weights == "published" and source is None:
        raise InputError(f"backbone {name}: no published weights are known by this name: give weights = random, or another one")
    why = "" if weights == "random" else ": none are published" if source is None else f": those of {source} are not available"
    with _silence_warnings():
        made: nn.Module = AutoModel.from_config(_configuration(name))  # type: ignore[no-untyped-call]
    return made, False, f"{title}: starts with random weights{why}"


UNAVAILABLE = (OSError, ValueError, ImportError)
"""Exceptions of the library for a model that is missing, is unknown, or needs a package that is not installed."""


def had(load: Callable[..., Any], source: str) -> Any:
    """Load a model from this computer, or otherwise from the hub. Raises one of `UNAVAILABLE`.

    Without a network connection the library makes five attempts in 23 s; a single request beforehand fails at once.
    """
    with _silence_warnings():
        try:
            return load(source, local_files_only=True)
        except UNAVAILABLE:
            if Path(source).is_dir() or offline():
                raise
        try:
            get_hf_file_metadata(hf_hub_url(source, "config.json"), timeout=HUB_TIMEOUT_S)
        except Exception as error:  # exceptions of the HTTP library, which differ between versions
            raise OSError(f"the hub cannot be queried for {source}: {error}") from error
        return load(source)


def _source(name: str) -> str | None:
    """Return the source of published weights of a backbone: a folder, or a name on the hub; None: no known source."""
    if name in RESNETS:  # also if a folder, such as that of a run, has this name
        return None if name in UNPUBLISHED else f"{PUBLISHER}/{name}"
    if Path(name).is_dir():
        return name
    return name if name.count("/") == 1 else None


def _configuration(name: str) -> PretrainedConfig:
    """Return the architecture of a backbone. Raises `InputError` for one that does not exist or is not available."""
    if name in RESNETS:
        layer, depths, stem, first = RESNETS[name]
        return ResNetConfig(embedding_size=stem, hidden_sizes=[first * 2**k for k in range(4)], depths=list(depths),
                            layer_type=layer)  # fmt: skip
    try:
        if _source(name):
            return cast(PretrainedConfig, had(AutoConfig.from_pretrained, name))
        return AutoConfig.for_model(name)
    except UNAVAILABLE as error:
        raise InputError(
            f"backbone {name}: is not one of {', '.join(RESNETS)}, and transformers knows or finds no model of this name "
            f"({' '.join(str(error).split())[:120]})"
        ) from None


def _keep_resolution(network: nn.Module, name: str) -> None:
    """Set the stride of a ResNet's last stage to 1. Raises `InputError` for another network."""
    stages = getattr(getattr(network, "encoder", None), "stages", None)
    if getattr(getattr(network, "config", None), "model_type", None) != "resnet" or stages is None:
        raise InputError(f"backbone {name}: only a resnet has a last stride to set: give last_stride = 2")
    for layer in stages[-1].modules():
        if isinstance(layer, nn.Conv2d) and layer.stride == (2, 2):
            layer.stride = (1, 1)


def _channels(network: nn.Module, name: str, size: tuple[int, int]) -> int:
    """Return the number of features. Raises `InputError` if the network does not accept pictures of this size."""
    was = network.training
    network.eval()
    try:
        with torch.no_grad():
            features = feature_map(network(torch.zeros(1, 3, *size)))
    except Exception as error:  # networks raise various exceptions for pictures that they do not accept
        raise InputError(
            f"backbone {name}: does not turn an image of {size[1]}x{size[0]} pixels into features "
            f"({' '.join(str(error).split())[:160]}): give another backbone, or the size that it takes"
        ) from None
    finally:
        network.train(was)
    return int(features.shape[1])


def feature_map(answer: Any) -> Tensor:
    """Return the feature map (N, C, h, w) of a `transformers` model's output; tokens (N, T, C) become a map of width 1."""
    hidden: Tensor = answer.last_hidden_state
    return hidden if hidden.ndim == 4 else hidden.transpose(1, 2).unsqueeze(-1)


@contextlib.contextmanager
def _silence_warnings() -> Iterator[None]:
    """Silence the libraries' warnings; this package reports the important ones itself."""
    loggers = [logging.getLogger(name) for name in ("huggingface_hub", "transformers")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
