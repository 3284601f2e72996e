"""SuperPoint (DeTone, Malisiewicz, Rabinovich, CVPRW 2018) with brute force, and with LightGlue (Lindenberger, Sarlin,
Pollefeys, ICCV 2023), by `transformers`.

LightGlue stands where the paper has SuperGlue: it is its authors' successor to it. The weights of SuperPoint are Magic Leap's,
for research that is not commercial: they are not part of this package, and are used only where the user has got them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from baselines.matching import MAX_FEATURES, BruteForce, Features, Matcher, Matches, Picture, Unavailable, grey

WEIGHTS = "PASSERBY_BASELINES"  # environment variable: a folder of networks as `transformers` saves them, one folder each
SOURCE, GLUE_SOURCE = "magic-leap-community/superpoint", "ETH-CVG/lightglue_superpoint"  # names on the hub


def open_matcher(weights: Path | None = None) -> Matcher:
    """With brute force. Raises `Unavailable` where PyTorch, `transformers` or the weights are missing."""
    network = load("SuperPointForKeypointDetection", SOURCE, "superpoint", weights)
    return BruteForce(lambda picture: describe(network, picture), None)


def open_glue(weights: Path | None = None) -> Matcher:
    """With LightGlue. Raises `Unavailable` as `open_matcher` does."""
    network = load("LightGlueForKeypointMatching", GLUE_SOURCE, "superpoint-lightglue", weights)
    return lambda a, b: _matched(network, a, b)


def load(kind: str, source: str, folder_name: str, weights: Path | None) -> Any:
    """A network of `transformers` in evaluation mode: from the user's folder `weights`, or `$PASSERBY_BASELINES`, else this
    computer's cache, else the hub. Raises `Unavailable` where a package is missing or the weights are nowhere to be had.
    """
    try:
        import transformers

        from passerby.training.network import UNAVAILABLE, had
    except ImportError as error:
        raise Unavailable(f"the package {error.name} is not installed: pip install 'passerby[baselines]'") from None
    named = weights or (Path(os.environ[WEIGHTS]) if os.environ.get(WEIGHTS) else None)
    own = named / folder_name if named is not None else None
    try:
        network = had(getattr(transformers, kind).from_pretrained, str(own) if own and own.is_dir() else source)
    except UNAVAILABLE as error:
        why = " ".join(str(error).split())[:160]
        raise Unavailable(
            f"the weights of {source} cannot be had ({why}): go online, or give a folder with {folder_name}/ in ${WEIGHTS}"
        ) from None
    return network.eval()


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
