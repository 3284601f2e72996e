"""A rig as Passerby wrote it, and where its cameras have points: what a check is given. Needs numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats


@dataclass(frozen=True, eq=False)
class Case:
    """C cameras and N points."""

    names: tuple[str, ...]  # (C,) in the rig's order
    world: Floats  # (N, 3) metres, z up
    pixels: Floats  # (C, N, 2) where each camera has each point, as OpenCV counts; NaN outside of its picture
    target: Path  # what Passerby wrote
    back: Path  # where the tool may write what it has read

    @classmethod
    def read(cls, folder: Path) -> Case:
        """The case in a folder."""
        with np.load(folder / "points.npz") as points:
            names = tuple(str(name) for name in points["names"])
            return cls(names, points["world"], points["pixels"], *_places(folder, str(points["target"])))

    def write(self, folder: Path) -> None:
        """Write everything but what the format itself writes."""
        np.savez(
            folder / "points.npz", names=np.array(self.names), world=self.world, pixels=self.pixels, target=self.target.name
        )

    def seen(self, camera: int) -> Floats:
        """(K, 3) the points in a camera's picture."""
        return np.asarray(self.world[np.isfinite(self.pixels[camera]).all(axis=1)])

    def largest(self, projected: Sequence[Floats]) -> float:
        """By how many pixels projections of `seen` differ at most; a camera each, in the rig's order."""
        assert len(projected) == len(self.names), f"{len(projected)} cameras instead of {len(self.names)}"
        worst = 0.0
        for truth, found in zip(self.pixels, projected, strict=True):
            true = truth[np.isfinite(truth).all(axis=1)]
            assert len(true), "no point to compare"
            worst = max(worst, float(np.linalg.norm(np.reshape(found, true.shape) - true, axis=1).max()))
        return worst


def _places(folder: Path, target: str) -> tuple[Path, Path]:
    return folder / "written" / target, folder / "back" / target
