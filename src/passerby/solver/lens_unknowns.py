"""Refinement of lenses: their unknowns, the derivatives of pixels, and the rays computed again with changed lenses.

The unknowns of a camera, in this order: "focal", the logarithm of the factor on both focal lengths; "principal_point", its two
coordinates' changes in pixels; "distortion", the change of the first coefficient, which is radial in all models. Distortions
are shares of the focal length, so that they grow with it. The distortion is an unknown only together with all other parts, and
only for lenses that were never calibrated (`Lens.uncalibrated`); calibrated lenses are held then.

Residuals of an adjustment with refined lenses are exact: a point is projected with the current lens, and compared with its
pixel. Residuals that are linearised at the ray of that pixel, as with known lenses, have the noise in the ray as well. Its
square biases what only the borders of images determine: focal lengths and principal points. The residual of a point that is far
from its pixel stays linear. Rays are also used to find the sightings that agree, and for initial values. They are computed
again with the refined lens, in rounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Rig
from passerby.core.lens import INTRINSICS
from passerby.geometry.triangulation import PointObservations
from passerby.people.sightings import Sightings

LensPart = Literal["focal", "principal_point", "distortion"]
LENS_PARTS: tuple[LensPart, ...] = get_args(LensPart)
_SIZES: Mapping[LensPart, int] = MappingProxyType({"focal": 1, "principal_point": 2, "distortion": 1})

FOCAL_CORE = 0.005
"""Scale of a Cauchy distribution of stated focal lengths, as a share: half of them are right within it. The others, from data
sheets or of zooms that were moved, may have any error. With a normal prior of 10 %, all would be left to people, whose boxes
determine them to 1 to 5 %."""
PRINCIPAL_POINT_CORE = 0.0025
"""The same for the principal point, as a share of the image's width."""
NORMAL_HALF = 0.6745
"""Number of standard deviations within which half of normal deviates lie. A stated `focal_sd` times this is the scale of a
Cauchy distribution, which has half of its probability there too; a guessed sigma may itself be wrong."""
FAR_FOCAL, FAR_PRINCIPAL_POINT, FAR_DISTORTION = 0.10, 0.04, 0.15
"""One sigma of the errors of a lens that was never calibrated: the same shares, and the first distortion coefficient. It limits
the tails of the priors of stated lenses. Principal points of calibrated cameras lie 2 to 10 % of the width from the image
centre in public data sets, those of phones and fixed cameras 0.5 to 2 %."""
FAR_SIGMAS = 3.0
"""Limit in these sigmas: a stated lens that changed by more is that of another camera, or absorbs another error."""

UNKNOWN_PRINCIPAL_POINT, UNKNOWN_DISTORTION = 0.02, 0.15
"""Standard deviations of the normal priors of lenses that were never calibrated: of the principal point from the image centre,
as a share of the width, and of the first distortion coefficient from 0. Calibrations of phones and of fixed cameras state
principal points 0.5 to 2 % of the width from the centre, those of older industrial cameras more."""
HELD = 1e-5
"""Standard deviations that hold calibrated lenses in a rig with lenses that were never calibrated: shares of the focal length
and of the width, and the coefficient."""

# Rays are computed again until the lenses change by no more than this: agreement of sightings is judged by rays.
SETTLED_FOCAL, SETTLED_PX, SETTLED_DISTORTION = 3e-3, 3.0, 4e-3

NEAR = 0.1
"""Largest residual, as a share of the focal length, that is computed exactly: a point farther off is an outlier, or the rig is
an initial one. The polynomial of a lens is not valid far outside the image."""


@dataclass(frozen=True)
class LensUnknowns:
    """The parts of the lenses that are unknown, and the layout of their unknowns."""

    parts: tuple[LensPart, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(part for part in LENS_PARTS if part in self.parts))

    @property
    def size(self) -> int:
        """L, the number of lens unknowns per camera."""
        return sum(_SIZES[part] for part in self.parts)

    def columns_of(self, part: LensPart) -> slice:
        """Return the columns of the unknowns of a part; empty where it is not refined."""
        if part not in self.parts:
            return slice(0, 0)
        first = sum(_SIZES[other] for other in self.parts[: self.parts.index(part)])
        return slice(first, first + _SIZES[part])

    def core(self, rig: Rig, free: Sequence[LensPart] = LENS_PARTS, *, near_start: bool = False) -> Floats:
        """Return the scales (C, L) of the Cauchy priors: half of the stated values are right within them. In a rig with lenses
        that were never calibrated, they are standard deviations. Parts that are not `free` are held. With `near_start`, focal
        lengths from a search stay near its result.
        """
        if near_start:
            rig = replace(rig, cameras=tuple(replace(one, lens=_near_start(one.lens)) for one in rig))
        out = self._scales(rig, [_stated(camera.lens, FOCAL_CORE) for camera in rig], PRINCIPAL_POINT_CORE)
        held = self._shares(rig, [HELD] * len(rig), HELD, HELD)
        for part in self.parts:
            if part not in free:
                out[:, self.columns_of(part)] = held[:, self.columns_of(part)]
        return out

    def first_core(self, rig: Rig) -> Floats:
        """Return the scales (C, L) for first rounds, in which all focal lengths follow the people. In later rounds, wrong ones
        stay there and right ones return to the stated value; a wrong one that starts at the stated value may stay at it.
        """
        return self._scales(rig, [max(FAR_FOCAL, _stated(camera.lens, 0.0)) for camera in rig], PRINCIPAL_POINT_CORE)

    def uncalibrated_sd(self, rig: Rig) -> Floats:
        """Return one sigma (C, L) of the errors of lenses that were never calibrated."""
        focal = [max(FAR_FOCAL, camera.lens.focal_sd or 0.0) for camera in rig]
        return self._shares(rig, focal, FAR_PRINCIPAL_POINT, FAR_DISTORTION)

    def _scales(self, rig: Rig, focal: Sequence[float], principal_point: float) -> Floats:
        """Return the scales (C, L) of stated lenses; with "distortion", sigmas of never calibrated lenses, others held."""
        out = self._shares(rig, focal, principal_point, UNKNOWN_DISTORTION)
        if "distortion" not in self.parts:
            return out
        unknown = np.array([camera.lens.uncalibrated for camera in rig])
        sd = [HELD if camera.lens.focal_sd is None else camera.lens.focal_sd for camera in rig]
        free = self._shares(rig, sd, UNKNOWN_PRINCIPAL_POINT, UNKNOWN_DISTORTION)
        return np.where(unknown[:, None], free, self._shares(rig, sd, HELD, HELD))

    def _shares(self, rig: Rig, focal: Sequence[float], principal_point: float, distortion: float) -> Floats:
        """Return (C, L): share of the focal length (a logarithm), share of the image's width in pixels, and coefficient."""
        out = np.zeros((len(rig), self.size))
        out[:, self.columns_of("focal")] = np.array(focal)[:, None]
        width = np.array([camera.lens.size[0] for camera in rig], dtype=np.float64)
        out[:, self.columns_of("principal_point")] = principal_point * width[:, None]
        out[:, self.columns_of("distortion")] = distortion
        return out

    def moved(self, lens: Lens, change: Floats) -> Lens:
        """Return the lens after a change (L,) of its unknowns."""
        matrix = np.array(lens.matrix)
        matrix[:2, :2] *= np.exp(np.sum(change[self.columns_of("focal")]))
        if "principal_point" in self.parts:
            matrix[:2, 2] += change[self.columns_of("principal_point")]
        if "distortion" not in self.parts:
            return replace(lens, matrix=matrix)
        distortions = np.zeros(max(len(lens.distortions), 4))
        distortions[: len(lens.distortions)] = lens.distortions
        distortions[0] += np.sum(change[self.columns_of("distortion")])
        return replace(lens, matrix=matrix, distortions=distortions)

    def rig(self, rig: Rig, change: Floats) -> Rig:
        """Return the rig with every lens changed by its row of `change` (C, L)."""
        if not self.parts:
            return rig
        cameras = (replace(camera, lens=self.moved(camera.lens, row)) for camera, row in zip(rig, change, strict=True))
        return replace(rig, cameras=tuple(cameras))

    def by_pixel(self, lens: Lens, pixels: Floats, rays: Floats | None = None) -> Floats:
        """Return the derivatives (M, 2, L) of the pixels (M, 2) of fixed rays by the unknowns: exact for every lens with a
        linear matrix; the distortion is linearised. `rays` (M, 3) are those of the pixels, computed when None.
        """
        out = np.zeros((len(pixels), 2, self.size))
        out[:, :, self.columns_of("focal")] = (pixels - lens.matrix[:2, 2])[:, :, None]
        if "principal_point" in self.parts:
            out[:, :, self.columns_of("principal_point")] = np.eye(2)
        if "distortion" in self.parts:
            rays = np.nan_to_num(lens.bearings(pixels) if rays is None else rays, nan=0.0)
            rays[~rays.any(axis=1)] = (0.0, 0.0, 1.0)
            out[:, :, self.columns_of("distortion")] = by_distortion(lens, rays)
        return out

    def settled(self, change: Floats) -> bool:
        """Return whether lenses that changed by `change` (C, L) since the rays were computed need no new rays."""
        limits: tuple[tuple[LensPart, float], ...] = (
            ("focal", SETTLED_FOCAL), ("principal_point", SETTLED_PX), ("distortion", SETTLED_DISTORTION)
        )  # fmt: skip
        return all(bool((np.abs(change[:, self.columns_of(part)]) < limit).all()) for part, limit in limits)

    def sightings(self, s: Sightings, rig: Rig, change: Floats) -> Sightings:
        """Return sightings with the rays and derivatives of the lenses in `rig` changed by `change` (C, L).

        The rays of sightings without pixels are taken to be of these same lenses. A sighting outside the range of the new lens
        keeps its rays; then its residual changes with the lens by the derivatives only.
        """
        if not self.parts:
            return s
        lenses = [camera.lens for camera in self.rig(rig, change)]
        if s.pixels is None:
            ends = np.stack([_pixels(lenses, s.camera, s.top), _pixels(lenses, s.camera, s.bottom)], axis=1)
            s = replace(s, pixels=ends, lens_at=change[s.camera])
        assert s.pixels is not None
        assert s.lens_at is not None
        rays, tangents, by_lens = self._unproject(lenses, s.camera, s.pixels)
        good = np.isfinite(rays).all(axis=(1, 2))
        return replace(
            s, top=_where(good, rays[:, 0], s.top), bottom=_where(good, rays[:, 1], s.bottom),
            top_tangent=_where(good, tangents[:, 0], s.top_tangent),
            bottom_tangent=_where(good, tangents[:, 1], s.bottom_tangent),
            lens_at=_where(good, change[s.camera], s.lens_at), by_lens=by_lens,
        )  # fmt: skip

    def points(self, o: PointObservations, rig: Rig, change: Floats) -> PointObservations:
        """Return sightings of points with the rays and derivatives of changed lenses, as `sightings`."""
        if not self.parts:
            return o
        lenses = [camera.lens for camera in self.rig(rig, change)]
        if o.pixels is None:
            pixels = _pixels(lenses, o.camera, o.bearing)
            o = replace(o, pixels=pixels, lens_at=change[o.camera])
        assert o.pixels is not None
        assert o.lens_at is not None
        rays, tangents, by_lens = self._unproject(lenses, o.camera, o.pixels[:, None])
        good = np.isfinite(rays).all(axis=(1, 2))
        return replace(
            o, bearing=_where(good, rays[:, 0], o.bearing), tangent=_where(good, tangents[:, 0], o.tangent),
            lens_at=_where(good, change[o.camera], o.lens_at), by_lens=by_lens[:, 0],
        )  # fmt: skip

    def _unproject(self, lenses: Sequence[Lens], camera: Ints, pixels: Floats) -> tuple[Floats, Floats, Floats]:
        """Compute rays and derivatives of E pixels a row, (M, E, 2); the rays of pixels outside a lens's range are NaN.

        Returns:
            (M, E, 3) rays, (M, E, 2, 3) tangents, and (M, E, 2, L) derivatives of the pixels by the lens.
        """
        shape = pixels.shape[:2]
        rays, tangents, by_lens = np.zeros((*shape, 3)), np.zeros((*shape, 2, 3)), np.zeros((*shape, 2, self.size))
        for c, lens in enumerate(lenses):
            own = camera == c
            at = pixels[own].reshape(-1, 2)
            seen, number = lens.bearings(at), pixels[own].shape[:2]
            rays[own], tangents[own] = seen.reshape(*number, 3), lens.tangents(seen).reshape(*number, 2, 3)
            by_lens[own] = self.by_pixel(lens, at, seen).reshape(*number, 2, self.size)
        return rays, tangents, by_lens


@dataclass(frozen=True, eq=False)
class LensModel:
    """Refined lenses, for exact residuals."""

    unknowns: LensUnknowns
    stated: Rig
    """The stated lenses, to which changes are added."""

    def among(self, cameras: Sequence[int]) -> LensModel:
        """Return the model of some of the cameras."""
        return replace(self, stated=Rig(tuple(self.stated.cameras[c] for c in cameras)))

    def make_exact(
        self, change: Floats, camera: Ints, pixels: Floats, d: Floats, residual: Floats, by_d: Floats, by_lens: Floats
    ) -> None:  # fmt: skip
        """Replace residuals of points near their pixels, and their derivatives, by exact ones.

        Args:
            change: (C, L) changes of the unknowns.
            camera: (M,) camera of each point.
            pixels: (M, 2) observed pixels.
            d: (M, 3) the points in the cameras' frames.
            residual: (M, 2) predicted minus observed pixels, to first order.
            by_d: (M, 2, 3) derivative by the points.
            by_lens: (M, 2, L) derivative by the unknowns.
        """
        all_parts = LensUnknowns(LENS_PARTS)
        columns = np.concatenate([np.arange(INTRINSICS)[all_parts.columns_of(part)] for part in self.unknowns.parts])
        apart = np.linalg.norm(residual, axis=1)
        for c, own in enumerate(self.unknowns.rig(self.stated, change)):
            rows = np.flatnonzero((camera == c) & (apart < NEAR * own.lens.focal) & (own.lens.fisheye | (d[:, 2] > 0)))
            if len(rows):
                predicted, by_d[rows], by_intrinsics = own.lens.derivatives(d[rows])
                residual[rows] = predicted - pixels[rows]
                by_lens[rows] = by_intrinsics[:, :, columns]


def by_distortion(lens: Lens, rays: Floats) -> Floats:
    """Return the derivative (M, 2, 1) of the pixels of rays by the first coefficient, which is radial in all models."""
    return lens.by_intrinsics(rays)[:, :, 3:]


def _near_start(lens: Lens) -> Lens:
    """Return the lens with the sigma of the search for its focal length, if there was one and it is smaller."""
    return lens if lens.start_sd is None or lens.focal_sd is None else replace(lens, focal_sd=min(lens.start_sd, lens.focal_sd))


def _stated(lens: Lens, otherwise: float) -> float:
    """Return the share within which half of focal lengths with the lens's stated sigma are right; `otherwise` without one."""
    return otherwise if lens.focal_sd is None else NORMAL_HALF * lens.focal_sd


def _pixels(lenses: Sequence[Lens], camera: Ints, rays: Floats) -> Floats:
    """Return the pixels (M, 2) of rays (M, 3) in the lenses of cameras (M,)."""
    out = np.zeros((len(rays), 2))
    for c, lens in enumerate(lenses):
        out[camera == c] = lens.project_rays(rays[camera == c])
    return out


def _where(good: Any, new: Floats, old: Floats) -> Floats:
    """Return the new rows where they are good, the old ones elsewhere."""
    return np.asarray(np.where(good.reshape(-1, *[1] * (new.ndim - 1)), new, old))
