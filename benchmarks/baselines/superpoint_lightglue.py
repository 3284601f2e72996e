"""SuperPoint and LightGlue (Lindenberger, Sarlin, Pollefeys, ICCV 2023), by `transformers`.

It stands where the paper has SuperGlue, whose weights are for research that is not commercial; LightGlue is its authors'
successor to it. SuperPoint's own weights, which come with it, are bound in the same way: see `superpoint`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from baselines.hub import load
from baselines.matching import Matcher, Matches, Picture
from baselines.superpoint import tensor

SOURCE = "ETH-CVG/lightglue_superpoint"


def open_matcher(weights: Path | None = None) -> Matcher:
    """Raises `Unavailable` where PyTorch, `transformers` or the weights are missing."""
    network = load("LightGlueForKeypointMatching", SOURCE, "superpoint-lightglue", weights)

    def match(a: Picture, b: Picture) -> Matches:
        return _matched(network, a, b)

    return match


def _matched(network: Any, a: Picture, b: Picture) -> Matches:
    import torch

    # The network takes both pictures in one tensor: the smaller is filled up with black, and places stay where they are.
    height, width = (max(sizes) for sizes in zip(a.shape[:2], b.shape[:2], strict=True))
    both = torch.zeros((1, 2, 3, height, width))
    for index, picture in enumerate((a, b)):
        both[0, index, :, : picture.shape[0], : picture.shape[1]] = tensor(picture)
    with torch.inference_mode():
        seen = network(both)
    there = seen.mask[0].bool().numpy()
    to, score = seen.matches[0, 0].numpy(), seen.matching_scores[0, 0].numpy()
    rows = np.flatnonzero(there[0] & (to >= 0) & (to < there[1].sum()) & (score > 0))
    xy = seen.keypoints[0].numpy().astype(np.float64) * (width, height)
    return Matches(xy[0, rows], xy[1, to[rows]], score[rows].astype(np.float64))
