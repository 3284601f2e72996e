"""How far estimated intrinsics lie from the true ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from passerby.core.cameras import Lens

GRID = (17, 13)
"""Points across and down the picture at which rays are compared."""
SAME_PX = 1e-3
"""Lenses whose rays differ by less are the same."""


@dataclass(frozen=True)
class LensError:
    """One camera's intrinsics against the true ones, which are for the same image size."""

    focal_percent: float
    """Estimated over true focal length, less 1, per cent; the geometric mean of both."""
    principal_point_px: float
    """Distance of the principal points."""
    ray_px: float | None
    """Mean over the picture of how far the estimated lens shows a true ray from its pixel; None where it shows none. A camera
    that is turned a little makes up for much of it.
    """

    @property
    def differs(self) -> bool:
        """Whether the two are different lenses."""
        return self.ray_px is None or self.ray_px > SAME_PX

    def to_dict(self) -> dict[str, float | None]:
        """As plain values for JSON."""
        return asdict(self)


def lens_error(estimate: Lens, truth: Lens) -> LensError | None:
    """The error of a lens; None where the two are for different image sizes."""
    if estimate.size != truth.size:
        return None
    width, height = truth.size
    across, down = np.meshgrid(*(np.linspace(0, size - 1, count) for size, count in zip((width, height), GRID, strict=True)))
    pixels = np.column_stack([across.ravel(), down.ravel()])
    rays = truth.bearings(pixels)
    seen = np.isfinite(rays).all(axis=1)
    miss = np.linalg.norm(estimate.project_rays(rays[seen]) - pixels[seen], axis=1)
    miss = miss[np.isfinite(miss)]
    return LensError(
        float(100 * (estimate.focal / truth.focal - 1)),
        float(np.linalg.norm(estimate.matrix[:2, 2] - truth.matrix[:2, 2])),
        float(miss.mean()) if len(miss) else None,
    )
