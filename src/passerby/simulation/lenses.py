"""Simulated cameras: their lenses, and their poses around an area."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Pose, Rig

TYPICAL, VARIED, SHARED = "typical", "varied", "shared"
LENSES = (TYPICAL, VARIED, SHARED)
"""typical: fields of view of 60 to 75 degrees, mild barrel distortion. varied: focal lengths of half to two image widths,
barrel to slight pincushion distortion. shared: one lens like those of `varied` for all cameras of an area, as with cameras of
one model; each camera has its own principal point."""
FIELD_OF_VIEW_DEG = (60.0, 75.0)
"""Range of the horizontal field of view, drawn per camera: that of common surveillance lenses."""
BARREL = (-0.15, -0.05)
"""Range of the first radial coefficient of a typical lens, drawn per camera."""
CENTRE_SHARE = 0.01
"""Largest offset of the principal point from the image centre along x and along y, as a share of the image width."""
WIDTHS = (0.5, 2.0)
"""Range of the focal length of a varied lens, in image widths, drawn log-uniformly."""
VARIED_K1 = (-0.30, 0.05)
"""Range of the first radial coefficient of a varied lens, its only distortion coefficient."""
LARGEST_BARREL = 0.14
"""Maximum of -k1 times the squared distance of the farthest image corner, in focal lengths. Above 4 / 27 the image radius
r (1 + k1 r^2) never reaches that corner: no ray would lead to its pixels."""
AIM_HEIGHT_M = 0.8
"""Height of the point near the middle of the area that a camera looks at: hips in the middle of the picture, feet in view."""


def draw_lenses(kind: str, picture: tuple[int, int], rng: np.random.Generator) -> Callable[[np.random.Generator], Lens]:
    """Return a function that draws the lens of a camera of an area from the camera's own generator.

    Args:
        kind: one of `LENSES`.
        picture: (width, height), pixels.
        rng: the area's generator, from which a shared lens is drawn.
    """
    if kind == TYPICAL:
        return lambda own: _make_typical_lens(picture, own)
    if kind == VARIED:
        return lambda own: _vary_lens(picture, _focal(picture, own), own)
    focal = _focal(picture, rng)
    # The largest possible distance between a corner and a principal point limits the distortion for all cameras.
    corner = np.array(picture) * 0.5 + CENTRE_SHARE * picture[0]
    k1 = _draw_k1(float(corner @ corner) / focal**2, rng)
    return lambda own: _pinhole(picture, focal, _centre(picture, own), k1)


def fold_radius(lens: Lens) -> float:
    """Compute the radius, in focal lengths, from which the image of a pinhole lens folds back.

    Beyond it, points farther from the optical axis appear nearer to the principal point. Infinite if the lens has no fold, and
    for a fisheye. The radial coefficients k1, k2 and k3 are used.
    """
    if lens.fisheye or not lens.distortions.any():
        return float("inf")
    k1, k2, _, _, k3 = (*lens.distortions[:5], 0.0)[:5]
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])  # of the slope of r + k1 r^3 + k2 r^5 + k3 r^7, in r^2
    real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
    return float(np.sqrt(real.min())) if len(real) else float("inf")


def before_fold(lens: Lens, points: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return whether points (..., 3), camera frame, in front of the camera, are inside the fold radius of the lens, (...)."""
    fold = fold_radius(lens)
    if not np.isfinite(fold):
        return np.ones(points.shape[:-1], dtype=np.bool_)
    return np.asarray(np.hypot(points[..., 0], points[..., 1]) < fold * points[..., 2])


def _make_typical_lens(picture: tuple[int, int], rng: np.random.Generator) -> Lens:
    """Draw a pinhole lens with mild barrel distortion whose image radius grows everywhere (no fold outside the picture)."""
    focal = 0.5 * picture[0] / np.tan(np.radians(rng.uniform(*FIELD_OF_VIEW_DEG)) / 2)
    centre = _centre(picture, rng)
    k1 = rng.uniform(*BARREL)
    # d/dr (r + k1 r^3 + k2 r^5) has no root when 20 k2 > 9 k1^2.
    return _pinhole(picture, focal, centre, k1, 0.6 * k1 * k1)


def _vary_lens(picture: tuple[int, int], focal: float, rng: np.random.Generator) -> Lens:
    centre = _centre(picture, rng)
    corner = np.maximum(centre, np.array(picture) - centre) / focal
    return _pinhole(picture, focal, centre, _draw_k1(float(corner @ corner), rng))


def _focal(picture: tuple[int, int], rng: np.random.Generator) -> float:
    return float(picture[0] * np.exp(rng.uniform(*np.log(WIDTHS))))


def _draw_k1(corner: float, rng: np.random.Generator) -> float:
    """Draw k1 from `VARIED_K1` so that every pixel has a ray; `corner`: squared distance of the far corner in focal lengths."""
    lowest, highest = VARIED_K1
    return float(rng.uniform(max(lowest, -LARGEST_BARREL / corner), highest))


def _centre(picture: tuple[int, int], rng: np.random.Generator) -> Floats:
    width, height = picture
    off_x, off_y = rng.uniform(-CENTRE_SHARE, CENTRE_SHARE, 2) * width
    return np.array([width / 2 + off_x, height / 2 + off_y])


def _pinhole(picture: tuple[int, int], focal: float, centre: Floats, k1: float, k2: float = 0.0) -> Lens:
    matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    return Lens(picture, matrix, np.array([k1, k2, 0.0, 0.0]))


def place_cameras(
    n_cameras: int,
    area_m: tuple[float, float],
    standoff_m: float,
    height_m: float,
    picture: tuple[int, int],
    rng: np.random.Generator,
    first: int = 1,
    lenses: str = TYPICAL,
) -> Rig:
    """Place cameras named C1, C2, ... (from `first` on) around a rectangle centred on the origin; they look inwards.

    Four stand at the corners; any other number is spread evenly along the perimeter from the first corner. Position, aim,
    field of view and roll (2 degrees either way) are jittered by `rng`.

    Args:
        n_cameras: number of cameras.
        area_m: extent along x and y, metres.
        standoff_m: distance of the cameras from the area along x and y, metres.
        height_m: height of the cameras over the ground z = 0, metres (jittered by up to 5 cm).
        picture: (width, height), pixels.
        rng: each camera uses its own child of it; so its random numbers do not depend on the number of cameras.
        first: number in the name of the first camera.
        lenses: one of `lenses.LENSES`.
    """
    half = np.asarray(area_m) / 2 + standoff_m
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * half
    cameras = []
    children = rng.spawn(n_cameras)
    lens_of = draw_lenses(lenses, picture, rng)
    for index, child in enumerate(children):
        along = 4.0 * index / n_cameras
        side = int(along)
        ground = corners[side] + (along - side) * (corners[side + 1] - corners[side])
        ground = ground + child.uniform(-0.5, 0.5, 2) * min(1.0, standoff_m / 1.5)
        centre = np.array([*ground, height_m + child.uniform(-0.05, 0.05)])
        aim = np.array([*(child.uniform(-0.06, 0.06, 2) * area_m), AIM_HEIGHT_M])
        roll = np.radians(child.uniform(-2.0, 2.0))
        pose = Pose.from_centre(looking_at(centre, aim, roll), centre)
        cameras.append(Camera(f"C{first + index}", lens_of(child), pose))
    return Rig(tuple(cameras))


def looking_at(centre: Floats, aim: Floats, roll: float = 0.0) -> Floats:
    """Return the world-to-camera rotation (3, 3) of a camera at `centre` that looks at `aim` and has a roll, radians."""
    forward = (aim - centre) / np.linalg.norm(aim - centre)
    right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
    right = right / np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward])
    c, s = np.cos(roll), np.sin(roll)
    return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level)
