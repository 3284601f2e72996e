"""The re-identification network: backbone, pooling, the neck between its losses, and a classifier of those it learns from."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from passerby.training.backbones import Backbone, feature_map
from passerby.training.options import TrainOptions


@dataclass(frozen=True, eq=False)
class Answers:
    """What the network says of N pictures."""

    pooled: Tensor
    """(N, C) what the triplet loss compares."""
    embedding: Tensor
    """(N, C) what people are found by: the neck's feature, or the pooled one without a neck."""
    logits: Tensor
    """(N, P) of the training people."""


class ReidNetwork(nn.Module):
    """Pictures (N, 3, H, W), RGB normalised as ImageNet's, to `Answers`."""

    def __init__(self, backbone: Backbone, people: int, options: TrainOptions) -> None:
        super().__init__()
        self.backbone = backbone.network
        self.channels = backbone.channels
        self.power = nn.Parameter(torch.tensor(3.0)) if options.pooling == "gem" else None
        # Luo et al. 2019: its shift is held at 0, so that the classifier's boundaries pass through the origin, as cosines do.
        self.neck: nn.Module = nn.BatchNorm1d(backbone.channels) if options.neck else nn.Identity()
        if isinstance(self.neck, nn.BatchNorm1d):
            self.neck.bias.requires_grad_(False)
        self.classifier = nn.Linear(backbone.channels, people, bias=False)
        nn.init.normal_(self.classifier.weight, std=0.001)

    def forward(self, pictures: Tensor) -> Answers:
        """`Answers` to pictures (N, 3, H, W)."""
        pooled = self.pooled(pictures)
        embedding = self.neck(pooled)
        return Answers(pooled, embedding, self.classifier(embedding))

    def pooled(self, pictures: Tensor) -> Tensor:
        """(N, C) the last feature map's mean over the picture, plain or generalised: (mean x^p)^(1/p) with p learnt."""
        features = feature_map(self.backbone(pictures))
        if self.power is None:
            return features.mean(dim=(2, 3))
        return features.clamp(min=1e-6).pow(self.power).mean(dim=(2, 3)).pow(1.0 / self.power)

    def embed(self, pictures: Tensor) -> Tensor:
        """(N, C) embeddings alone, of any length."""
        found: Tensor = self.neck(self.pooled(pictures))
        return found
