"""Drawing of a rig as lines and faces, for formats that show it: frusta of the cameras, a grid on the ground, trajectories.

Frusta are drawn through each camera's own lens at the picture's border, so a distorted picture has a curved border. A drawing
is not a calibration: it cannot be read back.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.colours import camera_colour, person_colour
from passerby.core.lens_figures import SIDE_SAMPLES, frustum_rim
from passerby.core.trajectories import Trajectories

Colour = tuple[int, int, int]

GROUND_COLOUR: Colour = (128, 128, 128)
SHARE_OF_DISTANCE, SHORTEST_M, LONGEST_M = 0.15, 0.2, 2.0
"""Depth of frusta as a share of the median distance to the nearest other camera, so that neighbours do not overlap. The limits
keep it visible in a hall and smaller than a room."""
MOST_LINES = 40
"""Largest number of spacings of the grid in each direction."""
FARTHEST_M = 30.0
"""Largest distance along a camera's axis at which it is assumed to see the ground."""
MARGIN_M = 1.0


@dataclass(frozen=True, eq=False)
class Frustum:
    """The field of view of a camera as a pyramid in its own frame: OpenCV's axes, metres, tip at the origin."""

    camera: Camera
    pose: Pose
    colour: Colour
    rim: Floats
    """(K, 3) the picture's border, clockwise from the top left corner, as seen in the picture."""
    top: Floats
    """(3, 3) a triangle above the picture, which shows the picture's upward direction."""

    @property
    def points(self) -> Floats:
        """(1 + K + 3, 3) vertices: tip, rim, triangle; camera frame."""
        return np.vstack([np.zeros((1, 3)), self.rim, self.top])

    @property
    def faces(self) -> Ints:
        """(K + 1, 3) triangles as indices into `points`: the pyramid's sides and the triangle above the picture."""
        rim = 1 + np.arange(len(self.rim))
        sides = np.column_stack([np.zeros_like(rim), np.roll(rim, -1), rim])
        return np.vstack([sides, 1 + len(rim) + np.arange(3)])

    @property
    def edges(self) -> Ints:
        """(E, 2) lines as indices into `points`: the corners' rays, the border, the triangle."""
        k = len(self.rim)
        rim = 1 + np.arange(k)
        rays = np.column_stack([np.zeros(4, dtype=np.int64), rim[:: k // 4]])
        top = 1 + k + np.array([[0, 1], [1, 2], [2, 0]])
        return np.vstack([rays, np.column_stack([rim, np.roll(rim, -1)]), top])

    @property
    def world(self) -> Floats:
        """(1 + K + 3, 3) `points` in the world frame."""
        return np.asarray(self.points @ self.pose.R_cw + self.pose.centre)


@dataclass(frozen=True, eq=False)
class Way:
    """The trajectory of one person, with its stretches."""

    identity: int
    colour: Colour
    xyz: Floats
    """(N, 3) positions, world, metres: x and y on the ground, z the height of the body's middle."""
    time_s: Floats
    """(N,) the rig's time, seconds."""
    sigma_m: Floats
    """(N,) one sigma of the position on the ground, metres; NaN where it is unknown."""
    cameras: Ints
    """(N,) number of cameras that saw the person; 0 for a position between others."""
    parts: tuple[slice, ...]
    """The rows of each stretch without long gaps."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A drawing of a rig. World z up, ground at z = 0, metres."""

    frusta: tuple[Frustum, ...]
    ground: Floats
    """(L, 2, 3) ends of the grid's lines."""
    spacing_m: float
    """Distance between the grid's lines."""
    ways: tuple[Way, ...]


def draw(rig: Rig, trajectories: Trajectories | None = None) -> Drawing:
    """Draw a rig, and people's trajectories. Cameras without a pose are left out; the index in the rig sets the colour."""
    depth = _depth(rig)
    frusta = tuple(
        _frustum(camera, camera.pose, hex_colour(camera_colour(index)), depth)
        for index, camera in enumerate(rig)
        if camera.pose is not None
    )
    ways = () if trajectories is None else ways_of(trajectories)
    ground, spacing = _grid(frusta, ways)
    return Drawing(frusta, ground, spacing, ways)


def ways_of(found: Trajectories) -> tuple[Way, ...]:
    """Split trajectories into one trajectory for each person, in the order of the identities."""
    order = np.lexsort((found.frame, found.part, found.identity))
    identities, starts = np.unique(found.identity[order], return_index=True)
    ways = []
    for identity, rows in zip(identities.tolist(), np.split(order, starts[1:]), strict=True):
        cuts = [0, *(np.flatnonzero(np.diff(found.part[rows])) + 1).tolist(), len(rows)]
        parts = tuple(slice(a, b) for a, b in pairwise(cuts))
        colour = hex_colour(person_colour(identity))
        ways.append(Way(identity, colour, found.xyz[rows], found.time_s[rows], found.sigma_m[rows], found.cameras[rows], parts))
    return tuple(ways)


def hex_colour(text: str) -> Colour:
    """Convert `#rrggbb` to three numbers from 0 to 255."""
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


def _depth(rig: Rig) -> float:
    """Compute the depth of the frusta, metres."""
    centres = np.array([camera.centre for camera in rig if camera.pose is not None]).reshape(-1, 3)
    if len(centres) < 2:
        return 1.0
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(np.clip(SHARE_OF_DISTANCE * np.median(apart.min(axis=1)), SHORTEST_M, LONGEST_M))


def _frustum(camera: Camera, pose: Pose, colour: Colour, depth: float) -> Frustum:
    lens = camera.lens
    # A picture without distortion has straight sides, and only needs its corners.
    per_side = SIDE_SAMPLES if lens.fisheye or lens.distortions.any() else 1
    rim = frustum_rim(lens, depth, per_side)
    rim = np.where(np.isnan(rim), [0.0, 0.0, depth], rim)
    left, right = rim[0], rim[per_side]
    across = right - left
    middle = (left + right) / 2
    top = np.array([middle - 0.25 * across, middle + 0.25 * across, middle - [0.0, 0.35 * np.linalg.norm(across), 0.0]])
    return Frustum(camera, pose, colour, rim, top)


def _grid(frusta: tuple[Frustum, ...], ways: tuple[Way, ...]) -> tuple[Floats, float]:
    """Compute the lines (L, 2, 3) of a grid on the ground, and their distance. It covers cameras, their targets and people."""
    places = [np.array([frustum.pose.centre[:2], _find_ground_target(frustum)]) for frustum in frusta]
    places += [way.xyz[:, :2] for way in ways]
    low = np.vstack(places).min(axis=0) - MARGIN_M
    high = np.vstack(places).max(axis=0) + MARGIN_M
    widest = float((high - low).max())
    spacing = next(
        step * 10.0**power for power in range(12) for step in (1.0, 2.0, 5.0) if widest / (step * 10.0**power) < MOST_LINES
    )
    first, last = np.floor(low / spacing) * spacing, np.ceil(high / spacing) * spacing
    lines = []
    for axis in (0, 1):
        for place in np.arange(first[axis], last[axis] + spacing / 2, spacing):
            line = np.zeros((2, 3))
            line[:, axis] = place
            line[:, 1 - axis] = first[1 - axis], last[1 - axis]
            lines.append(line)
    return np.array(lines), spacing


def _find_ground_target(frustum: Frustum) -> Floats:
    """Compute the point (2,) where the camera's axis meets the ground, or the point at `FARTHEST_M` if that is nearer."""
    centre, axis = frustum.pose.centre, frustum.pose.R_cw[2]
    reach = -centre[2] / axis[2] if axis[2] * centre[2] < 0 else FARTHEST_M
    return np.asarray(centre[:2] + min(reach, FARTHEST_M) * axis[:2])
