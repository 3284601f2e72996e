"""What the drawings of a rig are made of: what cameras look at, how sure their places are, where people were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.report.fitted import Fitted, FittedTrajectories
from passerby.report.through_lens import spacing_of

MOST_LINES = 24
"""Of the ground's grid, in one direction."""
PAD_SHARE, PAD_M = 0.06, 1.0
"""What is drawn reaches so much of its extent, and so many metres, beyond people and cameras."""
BORDER_SAMPLES = 8
"""Of each side of a picture: lenses bend its border."""
STEEPEST = 0.25
"""A frustum is flat in front where its rays lie so much along the optical axis; other rays end at a distance."""
FRUSTUM_SHARE, WEDGE_SHARE = 0.16, 0.45
"""Of the usual distance from a camera to the people: how deep frusta and how long wedges are drawn."""
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
LARGEST_ELLIPSE = 0.06
"""Half an axis of the largest ellipse, as a share of what is drawn: they are magnified until then."""
CELLS, SMALLEST_CELL_M = 60, 0.3
"""Of a map of where people were, in one direction."""


@dataclass(frozen=True, eq=False)
class Stage:
    """What is drawn of the world, metres."""

    low: Floats
    """(3,)"""
    high: Floats
    """(3,)"""
    middle: Floats
    """(3,) of where the people were."""
    reach: float
    """Usual distance from a camera to there."""

    @property
    def spacing(self) -> float:
        """Between the lines of the ground's grid."""
        return spacing_of(float((self.high - self.low)[:2].max()), MOST_LINES)


def stage_of(rig: Rig, fit: Fitted) -> Stage:
    """People, cameras with poses and the origin, with some room."""
    centres = np.array([camera.centre for camera in rig.posed()]).reshape(-1, 3)
    places = np.column_stack([fit.ways.xy, np.zeros(len(fit.ways))])
    if not len(centres) and not len(places):
        return Stage(np.array([-5.0, -5.0, 0.0]), np.array([5.0, 5.0, 3.0]), np.zeros(3), 5.0)
    middle = np.median(places, axis=0) if len(places) else centres.mean(axis=0) * (1, 1, 0)
    walked = np.quantile(places, (0.005, 0.995), axis=0) if len(places) else middle[None]
    every = np.concatenate([centres, walked])
    low, high = every.min(axis=0), every.max(axis=0)
    pad = PAD_M + PAD_SHARE * float((high - low)[:2].max())
    low, high = low - (pad, pad, 0.0), high + (pad, pad, 0.5)
    low[2], high[2] = min(low[2], 0.0), max(high[2], 2.5)
    distance = np.linalg.norm(centres - middle, axis=1)
    return Stage(low, high, middle, float(np.median(distance)) if len(distance) else 5.0)


def border_rays(camera: Camera, samples: int = BORDER_SAMPLES) -> Floats:
    """(4 K, 3) unit rays of the picture's border, world frame, clockwise from the first pixel's corner.

    Where the lens model cannot be inverted, as in the black corners of a fisheye's picture, the ray of the point nearest to the
    border that can; NaN where there is none.
    """
    assert camera.pose is not None
    width, height = camera.lens.size
    share = np.arange(samples) / samples
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    on_border = np.concatenate(
        [a + share[:, None] * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    middle = (camera.lens.matrix[:2, 2] + 0.5) / (width, height)
    middle = np.clip(middle, 0.05, 0.95)
    rays = np.full((len(on_border), 3), np.nan)
    for inward in np.linspace(1.0, 0.05, 39):
        rows = np.flatnonzero(np.isnan(rays[:, 0]))
        if not len(rows):
            break
        pixels = (middle + inward * (on_border[rows] - middle)) * (width, height) - 0.5
        rays[rows] = camera.lens.bearings(pixels)
    return np.asarray(rays @ camera.pose.R_cw)


def frustum(camera: Camera, depth: float) -> Floats:
    """(4 K, 3) the border of the picture held before the camera, metres: flat, `depth` in front; wider lenses' bent back."""
    assert camera.pose is not None
    rays = border_rays(camera)
    rays = rays[np.isfinite(rays).all(axis=1)]
    along = rays @ camera.pose.R_cw[2]
    return np.asarray(camera.centre + depth * rays / np.maximum(along, STEEPEST)[:, None])


def wedge(camera: Camera, length: float) -> Floats:
    """(N, 2) border of the ground that a camera sees within `length` of it, from the camera on, metres; convex, closed.

    The camera's place alone where its lens model cannot be inverted anywhere.
    """
    rays = border_rays(camera)
    rays = rays[np.isfinite(rays).all(axis=1)]
    if not len(rays):
        return np.asarray(camera.centre[None, :2])
    level = np.linalg.norm(rays[:, :2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_ground = np.where(rays[:, 2] < 0, max(camera.centre[2], 0.0) * level / -rays[:, 2], np.inf)
    reach = np.clip(np.nan_to_num(to_ground, nan=length, posinf=length), 0.0, length)
    seen = reach[:, None] * rays[:, :2] / np.maximum(level, 1e-9)[:, None]
    # OpenCV knows no hull of points that are all one.
    hull = cv2.convexHull(np.concatenate([np.zeros((1, 2)), seen]).astype(np.float32))
    outline = np.zeros((1, 2)) if hull is None else hull[:, 0].astype(np.float64)
    return np.asarray(camera.centre[:2] + np.concatenate([outline, outline[:1]]))


def ground_covariance(camera: Camera) -> tuple[Floats, bool] | None:
    """(2, 2) covariance of a camera's place over the ground, square metres, and whether its directions are known.

    Where only the sigma of the place as a whole is known, it is shared out evenly. None where nothing is known.
    """
    if camera.sigma is None or not np.isfinite(camera.sigma.position_m):
        return None
    if camera.sigma.covariance is None or not np.isfinite(camera.sigma.covariance).all():
        return np.eye(2) * camera.sigma.position_m**2 / 3, False
    return np.array(camera.sigma.covariance)[:2, :2], True


def semi_axes(covariance: Floats) -> tuple[Floats, Floats]:
    """One-sigma semi-axes of an ellipse (2,), metres, the longer first, and their directions, (2, 2), one a row."""
    values, vectors = np.linalg.eigh(covariance)
    return np.sqrt(np.maximum(values[::-1], 0.0)), np.asarray(vectors[:, ::-1].T)


def ellipse(centre: Floats, covariance: Floats, factor: float, points: int = 48) -> Floats:
    """(N, 2) outline at `factor` sigmas, closed."""
    lengths, directions = semi_axes(covariance)
    angle = np.linspace(0.0, 2 * np.pi, points + 1)
    return np.asarray(centre + factor * np.column_stack([np.cos(angle), np.sin(angle)]) * lengths @ directions)


def magnification(longest_m: float, extent_m: float) -> int:
    """By how much ellipses are drawn larger, for the longest semi-axis in a drawing of so many metres."""
    fitting = [factor for factor in MAGNIFICATIONS if factor * longest_m <= LARGEST_ELLIPSE * extent_m]
    return fitting[-1] if fitting and longest_m > 0 else 1


def density(places: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats, Floats]:
    """How often people were where: (X,) and (Y,) middles of cells, and (Y, X) shares of all places."""
    cell = max(float((high - low).max()) / CELLS, SMALLEST_CELL_M)
    edges = [np.arange(np.floor(low[k] / cell), np.ceil(high[k] / cell) + 1) * cell for k in range(2)]
    count = np.histogram2d(places[:, 0], places[:, 1], bins=edges)[0].T
    return (edges[0][:-1] + cell / 2), (edges[1][:-1] + cell / 2), count / max(len(places), 1)


def thinned_parts(ways: FittedTrajectories, most: int) -> list[Ints]:
    """Rows of each stretch of the ways, every n-th, and its ends, so that about `most` places are left."""
    if not len(ways):
        return []
    every = max(1, -(-len(ways) // most))
    parts = np.split(np.arange(len(ways)), np.flatnonzero(np.diff(ways.part)) + 1)
    return [np.union1d(rows[::every], rows[[0, -1]]) for rows in parts]


def joined(parts: Sequence[Floats], digits: int = 2) -> list[list[float | None]]:
    """Columns of stretches of points (K, D), one after the other with a gap between, rounded."""
    if not len(parts):
        return []
    columns: list[list[float | None]] = [[] for _ in range(parts[0].shape[1])]
    for number, part in enumerate(parts):
        for column, values in zip(columns, part.T.tolist(), strict=True):
            column += [None] if number else []
            # Adding zero turns -0.0 into 0.0.
            column += [round(value, digits) + 0.0 for value in values]
    return columns
