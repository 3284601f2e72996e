"""What the drawings of a rig are made of: views of cameras, uncertainty of their positions, places of people.

What the drawings of a rig say of its cameras.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.lens_figures import border_rays, frustum_rim
from passerby.report.fitted import FittedTrajectories
from passerby.report.sheet import clip_text
from passerby.report.through_lens import spacing_of

MOST_LINES = 24
"""Of the ground's grid, in one direction."""
PAD_SHARE, PAD_M = 0.06, 1.0
"""What is drawn reaches so much of its extent, and so many metres, beyond people and cameras."""
FRUSTUM_SHARE, WEDGE_SHARE = 0.16, 0.45
"""Of the usual distance from a camera to the people: how deep frusta and how long wedges are drawn."""
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
LARGEST_ELLIPSE = 0.06
"""Half an axis of the largest ellipse, as a share of what is drawn: they are magnified until then."""
CELLS, SMALLEST_CELL_M = 60, 0.3
"""Of a map of where people were, in one direction."""
ENTITY = re.compile(r"&(?=#?\w+;)")


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
    def extent(self) -> float:
        """The longer side of the ground."""
        return float((self.high - self.low)[:2].max())

    @property
    def spacing(self) -> float:
        """Between the lines of the ground's grid."""
        return spacing_of(self.extent, MOST_LINES)


def stage_of(rig: Rig, xy: Floats) -> Stage:
    """Cameras with poses and the places of people (N, 2), metres, with some room."""
    centres = np.array([camera.centre for camera in rig.posed()]).reshape(-1, 3)
    places = np.column_stack([xy, np.zeros(len(xy))])
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


def frustum(camera: Camera, depth: float) -> Floats:
    """(N, 3) the border of the picture held before the camera, world, metres; as of `frustum_rim`, without what is unknown."""
    assert camera.pose is not None
    rim = frustum_rim(camera.lens, depth)
    return np.asarray(camera.centre + rim[np.isfinite(rim).all(axis=1)] @ camera.pose.R_cw)


def wedge(camera: Camera, length: float) -> Floats:
    """(N, 2) border of the ground that a camera sees within `length` of it, from the camera on, metres; convex, closed.

    The camera's place alone where its lens model cannot be inverted anywhere.
    """
    assert camera.pose is not None
    rays = border_rays(camera.lens)
    rays = rays[np.isfinite(rays).all(axis=1)] @ camera.pose.R_cw
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


@dataclass(frozen=True, eq=False)
class SigmaEllipses:
    """The uncertainty of the cameras' places on the ground, as it is drawn."""

    outlines: tuple[Floats, ...]
    """(K, 2) closed, metres, of each camera whose sigma is known."""
    factor: int
    """So many times as large as they are."""
    directed: bool
    """Whether all directions are known; else some are circles."""

    @property
    def times(self) -> str:
        """What a legend says of the size; nothing where it is true."""
        return f", drawn {self.factor} times as large" if self.factor > 1 else ""


def sigma_ellipses(rig: Rig, extent_m: float) -> SigmaEllipses:
    """One-sigma ellipses of a rig's cameras, so large that they are seen in a drawing of so many metres."""
    known = [(camera, found) for camera in rig.posed() if (found := ground_covariance(camera)) is not None]
    longest = max((float(semi_axes(covariance)[0][0]) for _, (covariance, _) in known), default=0.0)
    factor = magnification(longest, extent_m)
    outlines = tuple(ellipse(camera.centre[:2], covariance, factor) for camera, (covariance, _) in known)
    return SigmaEllipses(outlines, factor, all(directed for _, (_, directed) in known))


def magnification(longest_m: float, extent_m: float) -> int:
    """By how much ellipses are drawn larger, for the longest semi-axis in a drawing of so many metres."""
    fitting = [factor for factor in MAGNIFICATIONS if factor * longest_m <= LARGEST_ELLIPSE * extent_m]
    return fitting[-1] if fitting and longest_m > 0 else 1


def density(places: Floats, low: Floats, high: Floats, cells: int = CELLS) -> tuple[Floats, Floats, Floats]:
    """How often people were where: (X,) and (Y,) middles of cells, and (Y, X) shares of all places."""
    cell = max(float((high - low).max()) / cells, SMALLEST_CELL_M)
    edges = [np.arange(np.floor(low[k] / cell), np.ceil(high[k] / cell) + 1) * cell for k in range(2)]
    count = np.histogram2d(places[:, 0], places[:, 1], bins=edges)[0].T
    return (edges[0][:-1] + cell / 2), (edges[1][:-1] + cell / 2), count / max(len(places), 1)


def thin_parts(ways: FittedTrajectories, most: int) -> list[Ints]:
    """Rows of each stretch of the ways, every n-th, and its ends, so that about `most` places are left."""
    if not len(ways):
        return []
    every = max(1, -(-len(ways) // most))
    parts = np.split(np.arange(len(ways)), np.flatnonzero(np.diff(ways.part)) + 1)
    return [np.union1d(rows[::every], rows[[0, -1]]) for rows in parts]


def join_stretches(parts: Sequence[Floats], digits: int = 2) -> list[list[float | None]]:
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


def escape_name(name: str) -> str:
    """A name as plotly may show it anywhere: it reads tags and entities in some of its texts, and not in others."""
    return ENTITY.sub("& ", clip_text(name).replace("<", "‹").replace(">", "›"))


def unregistered(rig: Rig) -> list[str]:
    """Names of the cameras without a pose."""
    return [escape_name(camera.name) for camera in rig if camera.pose is None]


def find_posed_cameras(rig: Rig) -> list[tuple[int, Camera]]:
    """The cameras with poses and their places in the rig."""
    return [(place, camera) for place, camera in enumerate(rig) if camera.pose is not None]


def hover_words(camera: Camera) -> str:
    """What hovering over a camera tells."""
    x, y, z = (round(float(value), 2) + 0.0 for value in camera.centre)
    lines = [f"camera {escape_name(camera.name)}", f"x {x:.2f}, y {y:.2f} m", f"height {z:.2f} m"]
    if camera.sigma is not None and np.isfinite(camera.sigma.position_m):
        lines.append(f"± {1000 * camera.sigma.position_m:.0f} mm, ± {camera.sigma.orientation_deg:.2f}°")
    return "<br>".join(lines)


def faint(colour: str, opacity: float) -> str:
    """`#rrggbb` with an opacity."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"
