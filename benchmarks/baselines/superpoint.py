"""SuperPoint (DeTone, Malisiewicz, Rabinovich, CVPRW 2018) and brute force, by `transformers`.

The weights are Magic Leap's, for research that is not commercial: they are not part of this package, and are used only where
the user has got them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from baselines.hub import load
from baselines.matching import MAX_FEATURES, BruteForce, Features, Matcher, Picture, grey

SOURCE = "magic-leap-community/superpoint"


def open_matcher(weights: Path | None = None) -> Matcher:
    """Raises `Unavailable` where PyTorch, `transformers` or the weights are missing."""
    network = load("SuperPointForKeypointDetection", SOURCE, "superpoint", weights)
    return BruteForce(lambda picture: describe(network, picture), None)


def describe(network: Any, picture: Picture) -> Features:
    """The strongest features of a picture."""
    import torch

    with torch.inference_mode():
        seen = network(tensor(picture)[None])
    there = seen.mask[0].bool()
    xy, score, descriptor = (values[0][there].numpy() for values in (seen.keypoints, seen.scores, seen.descriptors))
    best = np.argsort(-score, kind="stable")[:MAX_FEATURES]
    height, width = picture.shape[:2]
    return Features(xy[best].astype(np.float64) * (width, height), descriptor[best])


def tensor(picture: Picture) -> Any:
    """(3, H, W) grey levels from 0 to 1; the picture's own size, so that places are exact."""
    import torch

    return torch.from_numpy(np.repeat(grey(picture)[None].astype(np.float32) / 255, 3, axis=0))
