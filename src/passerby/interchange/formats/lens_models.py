"""Conversion of lenses to the models of other formats: exact if a model holds the lens, else the nearest lens, with its error.

The test is numerical: the parts that the model lacks are left out, and the projections of both lenses are compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import FISHEYE_DISTORTION_LENGTHS, PINHOLE_DISTORTION_LENGTHS, Camera, Lens
from passerby.interchange.formats.format import Losses

EXACT_PX = 1e-7
"""Two lenses are equal if they differ by at most this over the whole picture: a tenth of the tolerance in tests of formats."""
MOST_STEPS = 50
"""Largest number of steps of a fit. Most need under 20. If terms of the rational model cancel each other, hundreds of steps
bring no improvement."""
GRID = (41, 31)
"""Points across and down at which lenses are compared, including the picture's border."""
WIDEST_PINHOLE_DEG = 80.0
"""Largest angle to the axis of rays to which a pinhole model is fitted. A pinhole has no rays beyond 90 degrees, and rays just
below would distort the fit for all others."""
AROUND = 1440
"""Number of directions about the axis in which the picture's border is searched: 1 pixel of a large picture apart."""
FEWEST_RAYS = 10
"""Least number of valid rays of the grid for which the last rays of a lens that turns over within its picture are added."""


@dataclass(frozen=True)
class LensModel:
    """A lens model of another format, in terms of OpenCV's."""

    name: str
    """Name of the model in messages."""
    coefficients: tuple[int, ...]
    """Indices of OpenCV's coefficients that the model has: of a pinhole k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty, of a
    fisheye k1 k2 k3 k4."""
    fisheye: bool = False
    skew: bool = False
    one_focal: bool = False
    """Whether both focal lengths are equal."""
    centred: bool = False
    """Whether the principal point is the centre of the picture, (width - 1) / 2 and (height - 1) / 2."""


PINHOLE = LensModel("a pinhole without distortion", ())
PINHOLE_SKEWED = replace(PINHOLE, name="a pinhole with skew", skew=True)
RADTAN_4 = LensModel("k1, k2, p1, p2", (0, 1, 2, 3))
RADTAN_5 = LensModel("k1, k2, p1, p2, k3", (0, 1, 2, 3, 4))
RATIONAL_8 = LensModel("OpenCV's rational model", tuple(range(8)))
PRISM_12 = LensModel("OpenCV's thin prism model", tuple(range(12)))
TILTED_14 = LensModel("OpenCV's tilted model", tuple(range(14)))
FISHEYE = LensModel("OpenCV's fisheye", (0, 1, 2, 3), fisheye=True)
FISHEYE_SKEWED = replace(FISHEYE, skew=True)
OPENCV = (TILTED_14, FISHEYE)
"""The models of OpenCV's functions. None of these functions uses a skew in the camera matrix."""


def express_lens(camera: Camera, models: Sequence[LensModel], losses: Losses, place: str = "") -> tuple[Lens, LensModel]:
    """Express a camera's lens in the first model that holds it, else in the model with the least error, which is a loss.

    Args:
        camera: camera with the lens.
        models: the models, simplest first.
        losses: receives the error in pixels of a lens that is fitted.
        place: text behind the model's name in the message, as in " (FULL_OPENCV)".

    Returns:
        The lens, without the parts that the model lacks, and the model.
    """
    for model in models:
        lens = reduce_to_model(camera.lens, model)
        if lens is not None:
            return lens, model
    rays = Rays.of(camera.lens)
    lens, model = find_nearest_lens(rays, models, camera.lens, f"camera {camera.name}")
    losses.add(
        f"camera {camera.name}: its lens ({describe(camera.lens)}) is fitted by {model.name}{place}, {how_far(rays, lens)}"
    )
    return lens, model


def reduce_to_model(lens: Lens, model: LensModel) -> Lens | None:
    """Return the lens without the parts that the model lacks, or None if its projection differs."""
    if lens.fisheye != model.fisheye:  # even a fisheye without distortion is not a pinhole
        return None
    candidate, rays = _drop_unsupported(lens, model), Rays.of(lens)
    return candidate if len(rays.pixels) and rays.largest_error(candidate) <= EXACT_PX else None


def find_nearest_lens(rays: Rays, models: Iterable[LensModel], start: Lens, place: str) -> tuple[Lens, LensModel]:
    """Fit several models to rays and their pixels by least squares over the picture. Return the best lens, and its model.

    Raises `InputError`, which begins with `place`, where no model can be fitted.
    """
    fits = [(lens, model) for model in models if (lens := fit_lens_model(rays, model, start)) is not None]
    if not fits:
        raise InputError(f"{place}: its lens ({describe(start)}) cannot even be fitted: choose another format")
    return min(fits, key=lambda fit: _rank_fit(rays, fit[0]))


def fit_lens_model(rays: Rays, model: LensModel, start: Lens) -> Lens | None:
    """Fit the lens of a model to rays and their pixels by least squares. Return None if the fit fails.

    Args:
        rays: rays to reproduce; a pinhole model uses those within `WIDEST_PINHOLE_DEG` of the axis.
        model: the model.
        start: initial focal lengths and principal point; also the initial distortion if it is of the same kind.
    """
    used = rays if model.fisheye else rays.narrow
    first = _drop_unsupported(start if start.fisheye == model.fisheye else _drop_distortion(start, model.fisheye), model)
    numbers = _numbers(first, model)
    if 2 * len(used.pixels) < numbers.size:
        return None
    scale = np.where(np.arange(numbers.size) < numbers.size - len(model.coefficients), max(rays.size), 1.0)

    def miss(scaled: Floats) -> Floats:
        off = _lens(first, model, scaled * scale).project_rays(used.bearings) - used.pixels
        return np.asarray(np.nan_to_num(off, nan=1e4, posinf=1e4, neginf=-1e4).ravel(), dtype=np.float64)

    def slopes(scaled: Floats) -> Floats:
        return _slopes(_lens(first, model, scaled * scale), model, used.bearings) * scale

    try:
        found = least_squares(
            miss, numbers / scale, jac="2-point" if model.fisheye else slopes, x_scale="jac", max_nfev=MOST_STEPS
        )
        lens = _lens(first, model, found.x * scale)
    except (InputError, np.linalg.LinAlgError):
        return None
    if _has_pole(lens, used):
        return fit_lens_model(
            rays, replace(model, coefficients=tuple(k for k in model.coefficients if k not in _DENOMINATOR)), start
        )
    return lens


_DENOMINATOR = (5, 6, 7)
"""k4, k5 and k6 of the rational model."""


def _has_pole(lens: Lens, rays: Rays) -> bool:
    """Check whether the rational model divides by zero among the rays, or just beyond.

    Terms that nearly cancel have such a pole in a ring that may be too narrow for any grid. The largest error on the grid would
    be too small then.
    """
    if lens.fisheye or lens.distortions.size < 8 or not lens.distortions[list(_DENOMINATOR)].any():
        return False
    squares = ((rays.bearings[:, :2] / rays.bearings[:, 2:]) ** 2).sum(axis=1)
    roots = np.roots([*lens.distortions[7:4:-1], 1.0])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return bool(((real > 0) & (real < 1.1 * squares.max())).any())


def _slopes(lens: Lens, model: LensModel, bearings: Floats) -> Floats:
    """Compute the derivatives (2 N, P) of a pinhole's pixels with respect to the P parameters of `_numbers`.

    They are OpenCV's own except for skew, and twenty times faster than finite differences.
    """
    coefficients = np.concatenate([lens.distortions, np.zeros(14)])[:14]
    _, found = cv2.projectPoints(bearings[:, None], np.zeros(3), np.zeros(3), np.array(lens.matrix), coefficients)
    focal = found[:, 6:7] + found[:, 7:8] if model.one_focal else found[:, 6:8]
    centre = found[:, :0] if model.centred else found[:, 8:10]
    bending = found[:, [10 + k for k in model.coefficients]]
    if not model.skew:
        return np.hstack([focal, centre, bending])
    by_skew = np.zeros((len(found), 1))
    by_skew[::2, 0] = found[1::2, 7]
    bending[::2] += lens.matrix[0, 1] / lens.matrix[1, 1] * bending[1::2]
    return np.hstack([focal, centre, by_skew, bending])


def how_far(rays: Rays, lens: Lens) -> str:
    """Return a text for messages that states the largest error of a fitted lens, rounded up so that it is an upper bound."""
    if lens.fisheye:
        return f"up to {_round_up(rays.largest_error(lens))} px off"
    said = f"up to {_round_up(rays.narrow.largest_error(lens))} px off"
    beyond = math.ceil(100 * (1 - len(rays.narrow.pixels) / max(len(rays.pixels), 1)))
    return said + (
        f"; {beyond} % of the image, {WIDEST_PINHOLE_DEG:g} degrees and more off the axis, not at all" if beyond else ""
    )


def describe(lens: Lens) -> str:
    """Describe a lens in a few words."""
    used = int(np.max(np.flatnonzero(lens.distortions), initial=-1)) + 1
    skew = ", skewed" if lens.matrix[0, 1] else ""
    kind = "fisheye" if lens.fisheye else "pinhole"
    return f"{kind}, {used} distortion coefficient{'s' if used != 1 else ''}{skew}" if used else f"{kind}, no distortion{skew}"


def _rank_fit(rays: Rays, lens: Lens) -> tuple[bool, float]:
    """Return the rank of a fit, smaller is better: whether the lens lacks some rays, then its largest error in pixels."""
    used = rays if lens.fisheye else rays.narrow
    return len(used.pixels) < len(rays.pixels), used.largest_error(lens)


def _round_up(pixels: float) -> str:
    """Format pixels with two significant digits, rounded up. The grid misses the largest error by less than a hundredth."""
    value = max(1.01 * pixels, 1e-9)
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{float(f'{math.ceil(value / unit) * unit:.2g}'):g}"


def _drop_distortion(lens: Lens, fisheye: bool) -> Lens:
    return Lens(lens.size, lens.matrix, np.zeros(0), fisheye)


def _drop_unsupported(lens: Lens, model: LensModel) -> Lens:
    """Return a lens without the parts that the model lacks."""
    coefficients = np.zeros(4 if model.fisheye else 14)
    coefficients[: lens.distortions.size] = lens.distortions
    keep = list(model.coefficients)
    matrix = np.array(lens.matrix)
    if not model.skew:
        matrix[0, 1] = 0.0
    if model.one_focal:
        matrix[0, 0] = matrix[1, 1] = math.sqrt(matrix[0, 0] * matrix[1, 1])
    if model.centred:
        matrix[:2, 2] = (np.array(lens.size) - 1) / 2
    left = np.zeros_like(coefficients)
    left[keep] = coefficients[keep]
    return Lens(lens.size, matrix, trim_coefficients(left, model.fisheye), model.fisheye)


def trim_coefficients(coefficients: Floats, fisheye: bool, fewest: int = 0) -> Floats:
    """Remove trailing zeros of coefficients. Return a number that OpenCV accepts (0, 4, 5, 8, 12, 14), at least `fewest`."""
    needed = max(int(np.max(np.flatnonzero(coefficients), initial=-1)) + 1, fewest)
    lengths = FISHEYE_DISTORTION_LENGTHS if fisheye else PINHOLE_DISTORTION_LENGTHS
    length = next(length for length in lengths if length >= needed)
    return np.concatenate([coefficients, np.zeros(14)])[:length]


def _numbers(lens: Lens, model: LensModel) -> Floats:
    """Return the free parameters (P,) of a lens in a model: focal lengths, principal point, skew, coefficients."""
    matrix = lens.matrix
    focal = [matrix[0, 0]] if model.one_focal else [matrix[0, 0], matrix[1, 1]]
    centre = [] if model.centred else [matrix[0, 2], matrix[1, 2]]
    skew = [matrix[0, 1]] if model.skew else []
    coefficients = np.concatenate([lens.distortions, np.zeros(14)])[list(model.coefficients)]
    return np.array([*focal, *centre, *skew, *coefficients])


def _lens(like: Lens, model: LensModel, numbers: Floats) -> Lens:
    """Make a lens from its free parameters, the inverse of `_numbers`; other values are those of `like`."""
    values = iter(numbers.tolist())
    matrix = np.array(like.matrix)
    matrix[0, 0] = next(values)
    matrix[1, 1] = matrix[0, 0] if model.one_focal else next(values)
    if not model.centred:
        matrix[:2, 2] = next(values), next(values)
    if model.skew:
        matrix[0, 1] = next(values)
    coefficients = np.zeros(4 if model.fisheye else 14)
    coefficients[list(model.coefficients)] = list(values)
    return Lens(like.size, matrix, trim_coefficients(coefficients, model.fisheye), model.fisheye)


@dataclass(frozen=True, eq=False)
class Rays:
    """N rays of a lens and their pixels, with which another lens is compared."""

    bearings: Floats
    """(N, 3) directions, camera frame."""
    pixels: Floats
    """(N, 2) pixels of the rays."""
    size: tuple[int, int]
    """(width, height), pixels."""
    rim: tuple[Floats, Floats] = (np.zeros((0, 3)), np.zeros((0, 2)))
    """Directions and pixels of rays `WIDEST_PINHOLE_DEG` off the axis. There a pinhole model is worst; the grid may miss it."""

    @classmethod
    def of(cls, lens: Lens) -> Rays:
        """Compute the rays of a grid over the picture, except for pixels that have no ray in this lens."""
        grid = picture_grid(lens.size)
        bearings = lens.bearings(grid)
        known = np.isfinite(bearings).all(axis=1)
        rim, seen = _rim(lens.project_rays, lens.size)
        own = _find_own_rays(lens, rim, seen)
        bearings, pixels = bearings[known], grid[known]
        if FEWEST_RAYS <= len(bearings) < len(grid):
            last = _find_last_rays(lens)
            bearings, pixels = np.vstack([bearings, last]), np.vstack([pixels, lens.project_rays(last)])
        return cls(bearings, pixels, lens.size, (rim[own], seen[own]))

    @classmethod
    def of_projection(cls, project: Callable[[Floats], Floats], size: tuple[int, int], widest_deg: float = 100.0) -> Rays:
        """Compute the rays of a lens that is only known as a function: directions (N, 3) to pixels (N, 2), NaN for none."""
        around = 2 * np.pi * np.arange(AROUND) / AROUND
        inner, outer = np.zeros(AROUND), np.full(AROUND, math.radians(widest_deg))
        for _ in range(40):  # bisection of the angle at which each direction leaves the picture
            middle = (inner + outer) / 2
            with np.errstate(all="ignore"):
                within = _find_inside(project(_cone(middle, around)), size)
            inner, outer = np.where(within, middle, inner), np.where(within, outer, middle)
        share, turn = np.linspace(0.0, 1.0, 41), np.arange(0, AROUND, AROUND // 72)
        bearings = np.vstack(
            [_cone(np.outer(share, inner[turn]).ravel(), np.tile(around[turn], len(share))), _cone(inner, around)]
        )
        with np.errstate(all="ignore"):
            pixels = project(bearings)
        known = _find_inside(pixels, size)
        return cls(bearings[known], pixels[known], size, _rim(project, size))

    @cached_property
    def narrow(self) -> Rays:
        """The rays within `WIDEST_PINHOLE_DEG` of the axis, which a pinhole can represent."""
        keep = self.bearings[:, 2] >= math.cos(math.radians(WIDEST_PINHOLE_DEG))
        return replace(self, bearings=self.bearings[keep], pixels=self.pixels[keep])

    def largest_error(self, lens: Lens) -> float:
        """Return the largest distance in pixels between the projections of the rays by a lens and their pixels."""
        pairs = [(self.bearings, self.pixels)] + ([] if lens.fisheye else [self.rim])
        errors = np.concatenate([np.linalg.norm(lens.project_rays(rays) - pixels, axis=1) for rays, pixels in pairs])
        return float(np.max(errors, initial=0.0)) if np.isfinite(errors).all() else math.inf


def _find_own_rays(lens: Lens, rays: Floats, pixels: Floats) -> NDArray[np.bool_]:
    """Check whether rays (N, 3) are those of their pixels (N,): a lens may project rays far outside its picture into it."""
    with np.errstate(invalid="ignore"):
        return np.asarray((lens.bearings(pixels) * rays).sum(axis=1) > 1 - 1e-9)


def _find_last_rays(lens: Lens) -> Floats:
    """Find the last valid rays (N, 3) in each direction, of a lens that turns over within its picture.

    There another lens differs most.
    """
    around = 2 * np.pi * np.arange(0, AROUND, 4) / AROUND
    inner, outer = np.zeros(len(around)), np.full(len(around), math.radians(100.0))
    for _ in range(30):
        middle = (inner + outer) / 2
        rays = _cone(middle, around)
        pixels = lens.project_rays(rays)
        within = _find_inside(pixels, lens.size)
        within[within] = _find_own_rays(lens, rays[within], pixels[within])
        inner, outer = np.where(within, middle, inner), np.where(within, outer, middle)
    return _cone(inner, around)[inner > 0]


def _find_inside(pixels: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Check whether pixels are in the picture (N,)."""
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= -0.5) & (pixels <= np.array(size) - 0.5)).all(axis=1))


def _cone(angle: Floats, around: Floats) -> Floats:
    """Compute directions (N, 3) at an angle from the axis (N,), turned about it by `around` (N,), radians."""
    return np.column_stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)])


def _rim(project: Callable[[Floats], Floats], size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Compute the rays (N, 3) `WIDEST_PINHOLE_DEG` off the axis that are in the picture, and their pixels (N, 2)."""
    bearings = _cone(np.full(360, math.radians(WIDEST_PINHOLE_DEG)), np.radians(np.arange(360.0)))
    with np.errstate(all="ignore"):
        pixels = project(bearings)
    inside = _find_inside(pixels, size)
    return bearings[inside], pixels[inside]


def picture_grid(size: tuple[int, int]) -> Floats:
    """Compute an even grid of pixels (N, 2) over a picture, including its border."""
    across, down = (np.linspace(-0.5, length - 0.5, n) for length, n in zip(size, GRID, strict=True))
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
