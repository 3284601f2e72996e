"""Where a lens has its rays: what lenses are compared by, and fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens

GRID = (41, 31)
"""Points across and down at which lenses are compared, the picture's border included."""
WIDEST_PINHOLE_DEG = 80.0
"""Rays farther off the axis than this are left out where a pinhole model is fitted: it has none beyond 90 degrees, and those
just below would bend the fit for all others."""
AROUND = 1440
"""Directions about the axis in which the picture's border is looked for: 1 pixel of a large picture apart."""

FEWEST_RAYS = 10
"""Of the grid, for a lens that turns over within its picture to be one that is worth its last rays."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Where a lens has N rays: what another lens is compared with."""

    bearings: Floats
    """(N, 3) directions, camera frame."""
    pixels: Floats
    """(N, 2)"""
    size: tuple[int, int]
    """(width, height), pixels."""
    rim: tuple[Floats, Floats] = (np.zeros((0, 3)), np.zeros((0, 2)))
    """The same of rays just as far off the axis as a pinhole model is held to: there it is worst, and the others miss it."""

    @classmethod
    def of(cls, lens: Lens) -> Rays:
        """The rays of a grid over the picture, but for pixels that the lens itself has none for."""
        grid = picture_grid(lens.size)
        bearings = lens.bearings(grid)
        known = np.isfinite(bearings).all(axis=1)
        rim, seen = _rim(lens.project_rays, lens.size)
        own = _own(lens, rim, seen)
        bearings, pixels = bearings[known], grid[known]
        if FEWEST_RAYS <= len(bearings) < len(grid):
            last = _last_rays(lens)
            bearings, pixels = np.vstack([bearings, last]), np.vstack([pixels, lens.project_rays(last)])
        return cls(bearings, pixels, lens.size, (rim[own], seen[own]))

    @classmethod
    def of_projection(cls, project: Callable[[Floats], Floats], size: tuple[int, int], widest_deg: float = 100.0) -> Rays:
        """Rays of a lens that is known as a function alone, from (N, 3) directions to (N, 2) pixels, NaN where it has none."""
        around = 2 * np.pi * np.arange(AROUND) / AROUND
        inner, outer = np.zeros(AROUND), np.full(AROUND, math.radians(widest_deg))
        for _ in range(40):  # where each direction leaves the picture
            middle = (inner + outer) / 2
            with np.errstate(all="ignore"):
                within = _inside(project(_cone(middle, around)), size)
            inner, outer = np.where(within, middle, inner), np.where(within, outer, middle)
        share, turn = np.linspace(0.0, 1.0, 41), np.arange(0, AROUND, AROUND // 72)
        bearings = np.vstack(
            [_cone(np.outer(share, inner[turn]).ravel(), np.tile(around[turn], len(share))), _cone(inner, around)]
        )
        with np.errstate(all="ignore"):
            pixels = project(bearings)
        known = _inside(pixels, size)
        return cls(bearings[known], pixels[known], size, _rim(project, size))

    @cached_property
    def narrow(self) -> Rays:
        """Those that a pinhole can have."""
        keep = self.bearings[:, 2] >= math.cos(math.radians(WIDEST_PINHOLE_DEG))
        return replace(self, bearings=self.bearings[keep], pixels=self.pixels[keep])

    def largest_error(self, lens: Lens) -> float:
        """By how many pixels a lens has one of the rays elsewhere, at most."""
        pairs = [(self.bearings, self.pixels)] + ([] if lens.fisheye else [self.rim])
        errors = np.concatenate([np.linalg.norm(lens.project_rays(rays) - pixels, axis=1) for rays, pixels in pairs])
        return float(np.max(errors, initial=0.0)) if np.isfinite(errors).all() else math.inf


def _own(lens: Lens, rays: Floats, pixels: Floats) -> NDArray[np.bool_]:
    """(N,) whether rays are those of their pixels: a lens may fold what lies far outside of its picture into it."""
    with np.errstate(invalid="ignore"):
        return np.asarray((lens.bearings(pixels) * rays).sum(axis=1) > 1 - 1e-9)


def _last_rays(lens: Lens) -> Floats:
    """(N, 3) the last rays of a lens that turns over within its picture, in each direction: there another lens differs most."""
    around = 2 * np.pi * np.arange(0, AROUND, 4) / AROUND
    inner, outer = np.zeros(len(around)), np.full(len(around), math.radians(100.0))
    for _ in range(30):
        middle = (inner + outer) / 2
        rays = _cone(middle, around)
        pixels = lens.project_rays(rays)
        within = _inside(pixels, lens.size)
        within[within] = _own(lens, rays[within], pixels[within])
        inner, outer = np.where(within, middle, inner), np.where(within, outer, middle)
    return _cone(inner, around)[inner > 0]


def _inside(pixels: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(N,) whether pixels are in the picture."""
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= -0.5) & (pixels <= np.array(size) - 0.5)).all(axis=1))


def _cone(angle: Floats, around: Floats) -> Floats:
    """(N, 3) directions at an angle from the axis, turned about it; radians."""
    return np.column_stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)])


def _rim(project: Callable[[Floats], Floats], size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Rays `WIDEST_PINHOLE_DEG` off the axis that are in the picture, (N, 3), and their pixels, (N, 2)."""
    bearings = _cone(np.full(360, math.radians(WIDEST_PINHOLE_DEG)), np.radians(np.arange(360.0)))
    with np.errstate(all="ignore"):
        pixels = project(bearings)
    inside = _inside(pixels, size)
    return bearings[inside], pixels[inside]


def picture_grid(size: tuple[int, int]) -> Floats:
    """(N, 2) pixels evenly over a picture, its border included."""
    across, down = (np.linspace(-0.5, length - 0.5, n) for length, n in zip(size, GRID, strict=True))
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
