"""What the network learns by: who it is among the training people, and that a person is nearer to himself than to others.

Identity loss: cross entropy over the training people, with label smoothing (Szegedy et al., CVPR 2016). Triplet loss:
max(0, margin + |f - f_positive| - |f - f_negative|), mean over the pictures of a batch, with the hardest positive and the
hardest negative of each (Hermans, Beyer, Leibe, *In Defense of the Triplet Loss for Person Re-Identification*, 2017).
Together they are those of Xu et al., CVPR 2021, section 3.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from pytorch_metric_learning.distances import LpDistance
from pytorch_metric_learning.losses import TripletMarginLoss
from pytorch_metric_learning.miners import BatchHardMiner
from pytorch_metric_learning.reducers import MeanReducer
from torch import Tensor, nn
from torch.nn import functional

from passerby.training.network import Answers
from passerby.training.options import TrainOptions


@dataclass(frozen=True, eq=False)
class Loss:
    """The loss of one batch, and its parts before they are weighted."""

    total: Tensor
    identity: Tensor
    triplet: Tensor


class ReidLoss(nn.Module):
    """The weighted sum of identity and triplet loss."""

    unknown: Tensor | None

    def __init__(self, options: TrainOptions, apart: Tensor | None = None) -> None:
        """`apart`: (P, P) who are known to be two; None: all are. Who may be the same person is no wrong answer to the
        other.
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
        """The loss of N answers to pictures of the people (N,)."""
        identity = identity_loss(answers.logits, person, self._smoothing, self.unknown)
        pooled = answers.pooled.float()
        triplet: Tensor = self._triplet(pooled, person, self._miner(pooled, person))
        by_identity, by_triplet = self._weights
        return Loss(by_identity * identity + by_triplet * triplet, identity, triplet)


def identity_loss(logits: Tensor, person: Tensor, smoothing: float, unknown: Tensor | None = None) -> Tensor:
    """Cross entropy with label smoothing, over those who are known not to be the person, and the person.

    Args:
        logits: (N, P).
        person: (N,) rows of the P people.
        smoothing: share of the target that is spread evenly over all who count.
        unknown: (P, P) who may be the same person under another name: such a class is left out of the sum.
    """
    if unknown is None:
        return functional.cross_entropy(logits.float(), person, label_smoothing=smoothing)
    out = unknown[person]
    log_share = logits.float().masked_fill(out, -torch.inf).log_softmax(dim=1)
    own = log_share.gather(1, person[:, None]).squeeze(1)
    counted = (~out).sum(dim=1)
    spread = log_share.masked_fill(out, 0.0).sum(dim=1) / counted
    return -((1.0 - smoothing) * own + smoothing * spread).mean()
