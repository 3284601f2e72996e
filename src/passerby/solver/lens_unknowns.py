"""Lenses that are refined: their unknowns, how pixels follow them, and rays made anew where they have moved.

The unknowns of a camera, in this order: "focal", the logarithm of the factor on both focal lengths; "principal_point", its two
coordinates' changes in pixels. Distortions stay as stated: they are shares of the focal length, so that they grow with it.

The adjustment works on rays that were made with a lens. Where that lens is moved by a little, each point's pixel moves by
`columns @ change`, which is added to its residual; where it was moved far, rays are made anew with the lens found. Rounds of
both end at the optimum of poses and lenses together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Rig
from passerby.geometry.reprojection import PointObservations
from passerby.solver.people_state import UprightObservations

LensPart = Literal["focal", "principal_point"]
LENS_PARTS: tuple[LensPart, ...] = get_args(LensPart)

FOCAL_CORE = 0.005
"""Half of the stated focal lengths are right within this share; the others, from data sheets or of zooms that were moved, may
be off by anything: a Cauchy distribution. A normal one of 10 % leaves them all to people, whose boxes tell them to 1 to 5 %."""
PRINCIPAL_POINT_CORE = 0.0025
"""The same of the principal point, as a share of the picture's width."""
NORMAL_HALF = 0.6745
"""Half of normal deviates lie within so many standard deviations: a stated `focal_sd` becomes the scale of a Cauchy
distribution that has as much of itself there, since who guesses a sigma may be wrong about it."""
FAR_FOCAL, FAR_PRINCIPAL_POINT = 0.10, 0.02
"""What a lens that was never calibrated is off by, one sigma: the same shares."""

# Rays are made anew until the lenses move by no more than this: what the linear columns leave over is half of its square.
SETTLED_FOCAL, SETTLED_PX = 1e-3, 0.5


@dataclass(frozen=True)
class LensUnknowns:
    """Which parts of the lenses are unknown."""

    parts: tuple[LensPart, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(part for part in LENS_PARTS if part in self.parts))

    @property
    def size(self) -> int:
        """L, the number of a camera's unknowns."""
        return sum(2 if part == "principal_point" else 1 for part in self.parts)

    def columns_of(self, part: LensPart) -> slice:
        """Where the unknowns of a part stand; empty where it is not refined."""
        if part not in self.parts:
            return slice(0, 0)
        first = 1 if part == "principal_point" and "focal" in self.parts else 0
        return slice(first, first + (2 if part == "principal_point" else 1))

    def core(self, rig: Rig) -> Floats:
        """(C, L) half of the stated values are right within so much: the scales of Cauchy distributions."""
        return self._shares(rig, [_stated(camera.lens, FOCAL_CORE) for camera in rig], PRINCIPAL_POINT_CORE)

    def first_core(self, rig: Rig) -> Floats:
        """(C, L) the same for first rounds, which let every focal length go where people want it: from there a wrong one stays
        and a right one comes back, whereas a wrong one that begins at what is stated may stick to it.
        """
        return self._shares(rig, [max(FAR_FOCAL, _stated(camera.lens, 0.0)) for camera in rig], PRINCIPAL_POINT_CORE)

    def uncalibrated_sd(self, rig: Rig) -> Floats:
        """(C, L) what lenses that were never calibrated are off by, one sigma."""
        return self._shares(rig, [max(FAR_FOCAL, camera.lens.focal_sd or 0.0) for camera in rig], FAR_PRINCIPAL_POINT)

    def _shares(self, rig: Rig, focal: Sequence[float], principal_point: float) -> Floats:
        """(C, L) a share of the focal length, as a logarithm, and a share of the picture's width in pixels."""
        out = np.zeros((len(rig), self.size))
        out[:, self.columns_of("focal")] = np.array(focal)[:, None]
        width = np.array([camera.lens.size[0] for camera in rig], dtype=np.float64)
        out[:, self.columns_of("principal_point")] = principal_point * width[:, None]
        return out

    def moved(self, lens: Lens, change: Floats) -> Lens:
        """The lens after a change (L,) of its unknowns."""
        matrix = np.array(lens.matrix)
        matrix[:2, :2] *= np.exp(np.sum(change[self.columns_of("focal")]))
        if "principal_point" in self.parts:
            matrix[:2, 2] += change[self.columns_of("principal_point")]
        return replace(lens, matrix=matrix)

    def rig(self, rig: Rig, change: Floats) -> Rig:
        """The rig with every lens moved by its row of (C, L)."""
        if not self.parts:
            return rig
        cameras = (replace(camera, lens=self.moved(camera.lens, row)) for camera, row in zip(rig, change, strict=True))
        return replace(rig, cameras=tuple(cameras))

    def by_pixel(self, lens: Lens, pixels: Floats) -> Floats:
        """(M, 2, L) how the pixels (M, 2) of fixed rays move with the unknowns: exact for every lens with a linear matrix."""
        out = np.zeros((len(pixels), 2, self.size))
        out[:, :, self.columns_of("focal")] = (pixels - lens.matrix[:2, 2])[:, :, None]
        if "principal_point" in self.parts:
            out[:, :, self.columns_of("principal_point")] = np.eye(2)
        return out

    def settled(self, change: Floats) -> bool:
        """Whether lenses that moved by (C, L) since the rays were made need no others."""
        focal, point = change[:, self.columns_of("focal")], change[:, self.columns_of("principal_point")]
        return bool((np.abs(focal) < SETTLED_FOCAL).all() and (np.abs(point) < SETTLED_PX).all())

    def sightings(self, s: UprightObservations, rig: Rig, change: Floats) -> UprightObservations:
        """Sightings with the rays and derivatives of the lenses that `change` (C, L) makes of the stated ones in `rig`.

        Sightings that hold no pixels yet are taken to be made with these very lenses. One that the new lens cannot have seen
        keeps its rays, and its residual follows the lens by the derivatives alone.
        """
        if not self.parts:
            return s
        lenses = [camera.lens for camera in self.rig(rig, change)]
        if s.pixels is None:
            ends = np.stack([_pixels(lenses, s.camera, s.top), _pixels(lenses, s.camera, s.bottom)], axis=1)
            s = replace(s, pixels=ends, lens_at=change[s.camera])
        assert s.pixels is not None
        assert s.lens_at is not None
        top, top_tangent = _rays(lenses, s.camera, s.pixels[:, 0])
        bottom, bottom_tangent = _rays(lenses, s.camera, s.pixels[:, 1])
        good = np.isfinite(np.concatenate([top, bottom], axis=1)).all(axis=1)
        return replace(
            s, top=_where(good, top, s.top), bottom=_where(good, bottom, s.bottom),
            top_tangent=_where(good, top_tangent, s.top_tangent),
            bottom_tangent=_where(good, bottom_tangent, s.bottom_tangent),
            lens_at=_where(good, change[s.camera], s.lens_at), by_lens=self._by_pixels(lenses, s.camera, s.pixels),
        )  # fmt: skip

    def points(self, o: PointObservations, rig: Rig, change: Floats) -> PointObservations:
        """The same of sightings of points."""
        if not self.parts:
            return o
        lenses = [camera.lens for camera in self.rig(rig, change)]
        if o.pixels is None:
            pixels = _pixels(lenses, o.camera, o.bearing)
            o = replace(o, pixels=pixels, lens_at=change[o.camera])
        assert o.pixels is not None
        assert o.lens_at is not None
        bearing, tangent = _rays(lenses, o.camera, o.pixels)
        good = np.isfinite(bearing).all(axis=1)
        return replace(
            o, bearing=_where(good, bearing, o.bearing), tangent=_where(good, tangent, o.tangent),
            lens_at=_where(good, change[o.camera], o.lens_at),
            by_lens=self._by_pixels(lenses, o.camera, o.pixels[:, None])[:, 0],
        )  # fmt: skip

    def _by_pixels(self, lenses: Sequence[Lens], camera: Ints, pixels: Floats) -> Floats:
        """(M, E, 2, L) derivatives of E pixels a row, (M, E, 2)."""
        out = np.zeros((*pixels.shape, self.size))
        for c, lens in enumerate(lenses):
            own = camera == c
            out[own] = self.by_pixel(lens, pixels[own].reshape(-1, 2)).reshape(*pixels[own].shape, self.size)
        return out


def _stated(lens: Lens, otherwise: float) -> float:
    """Half of the focal lengths with the lens's stated standard deviation are right within this share."""
    return otherwise if lens.focal_sd is None else NORMAL_HALF * lens.focal_sd


def _pixels(lenses: Sequence[Lens], camera: Ints, rays: Floats) -> Floats:
    """(M, 2) where the lenses of (M,) cameras show rays (M, 3)."""
    out = np.zeros((len(rays), 2))
    for c, lens in enumerate(lenses):
        out[camera == c] = lens.project_rays(rays[camera == c])
    return out


def _rays(lenses: Sequence[Lens], camera: Ints, pixels: Floats) -> tuple[Floats, Floats]:
    """Rays (M, 3) and tangents (M, 2, 3) of pixels (M, 2); NaN where a lens cannot have seen them."""
    rays, tangents = np.zeros((len(pixels), 3)), np.zeros((len(pixels), 2, 3))
    for c, lens in enumerate(lenses):
        own = camera == c
        rays[own] = lens.bearings(pixels[own])
        tangents[own] = lens.tangents(rays[own])
    return rays, tangents


def _where(good: Any, new: Floats, old: Floats) -> Floats:
    """The new rows where they are good, the old ones elsewhere."""
    return np.asarray(np.where(good.reshape(-1, *[1] * (new.ndim - 1)), new, old))
