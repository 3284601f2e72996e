"""Simulated cameras: their lenses, and where they stand and look around an area."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Pose, Rig

TYPICAL, VARIED, SHARED = "typical", "varied", "shared"
LENSES = (TYPICAL, VARIED, SHARED)
"""typical: fields of view of 60 to 75 degrees, mild barrel distortion. varied: focal lengths of half to two image widths,
barrel to slight pincushion distortion. shared: one lens like those of `varied` for all cameras of an area, as where one model
was bought; its principal point is each camera's own."""
FIELD_OF_VIEW_DEG = (60.0, 75.0)
"""Horizontal, drawn per camera: the range of common surveillance lenses."""
BARREL = (-0.15, -0.05)
"""First radial coefficient of a typical lens, drawn per camera."""
CENTRE_SHARE = 0.01
"""The principal point is up to this share of the image width off the image centre, along x and y."""
WIDTHS = (0.5, 2.0)
"""Focal length of a varied lens in image widths, drawn log-uniformly."""
VARIED_K1 = (-0.30, 0.05)
"""First radial coefficient of a varied lens; it is the only one."""
LARGEST_BARREL = 0.14
"""-k1 times the squared distance of the farthest image corner, in focal lengths, is no more than this. Above 4 / 27 the image
radius r (1 + k1 r^2) never reaches that corner: no ray would lead to its pixels."""
AIM_HEIGHT_M = 0.8
"""Cameras look at this height over a point near the middle of the area: hips in the picture's middle, feet in view."""


def draw_lenses(kind: str, picture: tuple[int, int], rng: np.random.Generator) -> Callable[[np.random.Generator], Lens]:
    """What draws the lens of each camera of an area from that camera's generator.

    Args:
        kind: one of `LENSES`.
        picture: (width, height), pixels.
        rng: the area's generator, of which a shared lens is drawn.
    """
    if kind == TYPICAL:
        return lambda own: _make_typical_lens(picture, own)
    if kind == VARIED:
        return lambda own: _vary_lens(picture, _focal(picture, own), own)
    focal = _focal(picture, rng)
    # The corner that is farthest from any principal point that can be drawn bounds the distortion of all.
    corner = np.array(picture) * 0.5 + CENTRE_SHARE * picture[0]
    k1 = _draw_k1(float(corner @ corner) / focal**2, rng)
    return lambda own: _pinhole(picture, focal, _centre(picture, own), k1)


def fold_radius(lens: Lens) -> float:
    """Distance from the optical axis, in focal lengths, from which on a pinhole lens shows what is farther out nearer in.

    Infinite where it does so nowhere, and for a fisheye. Up to three radial coefficients count.
    """
    if lens.fisheye or not lens.distortions.any():
        return float("inf")
    k1, k2, _, _, k3 = (*lens.distortions[:5], 0.0)[:5]
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])  # of the slope of r + k1 r^3 + k2 r^5 + k3 r^7, in r^2
    real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
    return float(np.sqrt(real.min())) if len(real) else float("inf")


def before_fold(lens: Lens, points: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(...) which points (..., 3) of the camera frame, in front of the camera, the lens shows where they are."""
    fold = fold_radius(lens)
    if not np.isfinite(fold):
        return np.ones(points.shape[:-1], dtype=np.bool_)
    return np.asarray(np.hypot(points[..., 0], points[..., 1]) < fold * points[..., 2])


def _make_typical_lens(picture: tuple[int, int], rng: np.random.Generator) -> Lens:
    """A pinhole lens with mild barrel distortion that grows with the radius everywhere (no fold outside the picture)."""
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
    """Within `VARIED_K1`, so that the image has a ray at every pixel. `corner`: squared distance in focal lengths."""
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
    """Cameras named C1, C2, ... (from `first` on) around a rectangle centred on the origin, looking in.

    Four stand at the corners; any other number is spread evenly along the perimeter from the first corner. Position, aim,
    field of view and roll (2 degrees either way) are jittered by `rng`.

    Args:
        n_cameras: how many.
        area_m: extent along x and y, metres.
        standoff_m: distance of the cameras from the area along x and y, metres.
        height_m: height of the cameras over the ground z = 0, metres (jittered by up to 5 cm).
        picture: (width, height), pixels.
        rng: each camera uses its own child of it, so that the first cameras stay when more are asked for at the same places.
        first: number of the first camera's name.
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
    """(3, 3) world-to-camera rotation of a camera at `centre` that looks at `aim`, then is rolled by `roll` radians."""
    forward = (aim - centre) / np.linalg.norm(aim - centre)
    right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
    right = right / np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward])
    c, s = np.cos(roll), np.sin(roll)
    return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level)
