"""Geometry of a rig's drawings: views of cameras, uncertainty of their positions, positions of people.

The module also makes the texts about cameras in these drawings.
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
"""Most spacings of the ground's grid in one direction."""
PAD_SHARE, PAD_M = 0.06, 1.0
"""Margin of the drawn region beyond people and cameras: this share of its extent plus this length."""
FRUSTUM_SHARE, WEDGE_SHARE = 0.16, 0.45
"""Depth of drawn frusta and length of drawn wedges, as shares of the median distance from a camera to the people."""
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
LARGEST_ELLIPSE = 0.06
"""Longest semi-axis of a magnified ellipse, as a share of the drawn extent; it limits the magnification."""
CELLS, SMALLEST_CELL_M = 60, 0.3
"""Number of cells of a map of people's positions in one direction, and the smallest size of a cell."""
ENTITY = re.compile(r"&(?=#?\w+;)")


@dataclass(frozen=True, eq=False)
class Stage:
    """The region of the world that is drawn, metres."""

    low: Floats
    """(3,) lowest corner."""
    high: Floats
    """(3,) highest corner."""
    middle: Floats
    """(3,) median position of the people on the ground; without people, mean position of the cameras."""
    reach: float
    """Median distance from a camera to `middle`."""

    @property
    def extent(self) -> float:
        """The longer side of the ground."""
        return float((self.high - self.low)[:2].max())

    @property
    def spacing(self) -> float:
        """Distance between the lines of the ground's grid."""
        return spacing_of(self.extent, MOST_LINES)


def stage_of(rig: Rig, xy: Floats) -> Stage:
    """Return the region around the cameras with poses and the positions of people (N, 2), metres, with a margin."""
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
    """Return the border (N, 3) of the picture at a depth before the camera, world, metres: finite points of `frustum_rim`."""
    assert camera.pose is not None
    rim = frustum_rim(camera.lens, depth)
    return np.asarray(camera.centre + rim[np.isfinite(rim).all(axis=1)] @ camera.pose.R_cw)


def wedge(camera: Camera, length: float) -> Floats:
    """Return the border (N, 2) of the ground that a camera sees within `length` of it, metres; convex and closed.

    The result is only the camera's position if its lens model cannot be inverted at any pixel of the border.
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
    # OpenCV returns no hull for identical points.
    hull = cv2.convexHull(np.concatenate([np.zeros((1, 2)), seen]).astype(np.float32))
    outline = np.zeros((1, 2)) if hull is None else hull[:, 0].astype(np.float64)
    return np.asarray(camera.centre[:2] + np.concatenate([outline, outline[:1]]))


def ground_covariance(camera: Camera) -> tuple[Floats, bool] | None:
    """Return the covariance (2, 2) of a camera's horizontal position, square metres, and whether its directions are known.

    If only the sigma of the whole position is known, it is divided equally among x, y and z. None if no sigma is known.
    """
    if camera.sigma is None or not np.isfinite(camera.sigma.position_m):
        return None
    if camera.sigma.covariance is None or not np.isfinite(camera.sigma.covariance).all():
        return np.eye(2) * camera.sigma.position_m**2 / 3, False
    return np.array(camera.sigma.covariance)[:2, :2], True


def semi_axes(covariance: Floats) -> tuple[Floats, Floats]:
    """Return the one-sigma semi-axes of an ellipse (2,), metres, the longer first, and their directions (2, 2), one per row."""
    values, vectors = np.linalg.eigh(covariance)
    return np.sqrt(np.maximum(values[::-1], 0.0)), np.asarray(vectors[:, ::-1].T)


def ellipse(centre: Floats, covariance: Floats, factor: float, points: int = 48) -> Floats:
    """Return the closed outline (N, 2) of an ellipse at `factor` sigmas."""
    lengths, directions = semi_axes(covariance)
    angle = np.linspace(0.0, 2 * np.pi, points + 1)
    return np.asarray(centre + factor * np.column_stack([np.cos(angle), np.sin(angle)]) * lengths @ directions)


@dataclass(frozen=True, eq=False)
class SigmaEllipses:
    """Ellipses of the uncertainty of the cameras' horizontal positions, as drawn."""

    outlines: tuple[Floats, ...]
    """(K, 2) closed outlines, metres, one for each camera whose sigma is known."""
    factor: int
    """Magnification of the ellipses."""
    directed: bool
    """Whether the directions are known for all cameras; otherwise some outlines are circles."""

    @property
    def times(self) -> str:
        """Words for a legend about the magnification; empty for true size."""
        return f", drawn {self.factor} times as large" if self.factor > 1 else ""


def sigma_ellipses(rig: Rig, extent_m: float) -> SigmaEllipses:
    """Return the one-sigma ellipses of a rig's cameras, magnified for visibility in a drawing of `extent_m` metres."""
    known = [(camera, found) for camera in rig.posed() if (found := ground_covariance(camera)) is not None]
    longest = max((float(semi_axes(covariance)[0][0]) for _, (covariance, _) in known), default=0.0)
    factor = magnification(longest, extent_m)
    outlines = tuple(ellipse(camera.centre[:2], covariance, factor) for camera, (covariance, _) in known)
    return SigmaEllipses(outlines, factor, all(directed for _, (_, directed) in known))


def magnification(longest_m: float, extent_m: float) -> int:
    """Choose the magnification of ellipses from the longest semi-axis and the extent of the drawing."""
    fitting = [factor for factor in MAGNIFICATIONS if factor * longest_m <= LARGEST_ELLIPSE * extent_m]
    return fitting[-1] if fitting and longest_m > 0 else 1


def density(places: Floats, low: Floats, high: Floats, cells: int = CELLS) -> tuple[Floats, Floats, Floats]:
    """Compute the density of positions (N, 2): middles of cells (X,) and (Y,), and shares (Y, X) of all positions."""
    cell = max(float((high - low).max()) / cells, SMALLEST_CELL_M)
    edges = [np.arange(np.floor(low[k] / cell), np.ceil(high[k] / cell) + 1) * cell for k in range(2)]
    count = np.histogram2d(places[:, 0], places[:, 1], bins=edges)[0].T
    return (edges[0][:-1] + cell / 2), (edges[1][:-1] + cell / 2), count / max(len(places), 1)


def thin_parts(ways: FittedTrajectories, most: int) -> list[Ints]:
    """Return, for each stretch of the trajectories, every n-th row and its ends, so that about `most` positions remain."""
    if not len(ways):
        return []
    every = max(1, -(-len(ways) // most))
    parts = np.split(np.arange(len(ways)), np.flatnonzero(np.diff(ways.part)) + 1)
    return [np.union1d(rows[::every], rows[[0, -1]]) for rows in parts]


def join_stretches(parts: Sequence[Floats], digits: int = 2) -> list[list[float | None]]:
    """Join stretches of points (K, D) into D columns, with None as a gap between stretches, rounded."""
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
    """Change a name so that plotly shows it correctly in every text: only some of its texts interpret tags and entities."""
    return ENTITY.sub("& ", clip_text(name).replace("<", "‹").replace(">", "›"))


def unregistered(rig: Rig) -> list[str]:
    """Return the names of the cameras without a pose."""
    return [escape_name(camera.name) for camera in rig if camera.pose is None]


def find_posed_cameras(rig: Rig) -> list[tuple[int, Camera]]:
    """Return the cameras with poses, each after its position in the rig."""
    return [(place, camera) for place, camera in enumerate(rig) if camera.pose is not None]


def hover_words(camera: Camera) -> str:
    """Return the text that is shown when a pointer hovers over a camera."""
    x, y, z = (round(float(value), 2) + 0.0 for value in camera.centre)
    lines = [f"camera {escape_name(camera.name)}", f"x {x:.2f}, y {y:.2f} m", f"height {z:.2f} m"]
    if camera.sigma is not None and np.isfinite(camera.sigma.position_m):
        lines.append(f"± {1000 * camera.sigma.position_m:.0f} mm, ± {camera.sigma.orientation_deg:.2f}°")
    return "<br>".join(lines)


def faint(colour: str, opacity: float) -> str:
    """Return a colour `#rrggbb` with an opacity."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"
