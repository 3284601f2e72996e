"""Lines of the world as one camera's picture shows them: bent by the lens, cut off at the picture's border and the horizon.

A polynomial lens model folds: what lies far outside the view can project into the picture again. A point counts as visible only
where its pixel's own ray leads back to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera

Rays = Callable[[Ints, Floats], Floats]
"""From lines (E,) and shares of their lengths (E,) to directions (E, 3), camera frame."""

Seen = Callable[[Floats], tuple[Floats, Bools]]
"""From directions (N, 3) to pixels (N, 2), and (N,) whether they are in the picture."""

SAME_RAY = 1e-3
"""Sine of the angle between a point's direction and the ray of the pixel that it projects to: more is a fold of the lens."""
STEP = np.deg2rad(1.0)
"""Between samples of a line, as an angle at the camera: below 0.1 pixels from the true curve for the lenses of real rigs."""
STRAIGHT_PX = 0.1
"""Samples so near to the line between others are left out."""
STEEPEST = np.deg2rad(88.0)
"""Elevation at which plumb lines end: above and below the camera all of them meet."""
HALVINGS = 14
"""Of a step, to find where a line enters and leaves the picture: to a thousandth of a pixel."""


@dataclass(frozen=True)
class View:
    """A camera with a pose, and the border of its picture."""

    camera: Camera

    @property
    def low(self) -> Floats:
        """(2,) the outer corner of the first pixel."""
        return np.array([-0.5, -0.5])

    @property
    def high(self) -> Floats:
        """(2,) the outer corner of the last one."""
        return np.array(self.camera.lens.size) - 0.5

    def seen(self, rays: Floats) -> tuple[Floats, Bools]:
        """Directions (N, 3), camera frame, of any length, as pixels (N, 2), and (N,) whether they are in the picture."""
        pixels, inside = self._project_directly(rays)
        rows = np.flatnonzero(inside)
        if len(rows) and (self.camera.lens.fisheye or self.camera.lens.distortions.any()):
            back = self.camera.lens.bearings(pixels[rows])
            unit = rays[rows] / np.linalg.norm(rays[rows], axis=1, keepdims=True)
            with np.errstate(invalid="ignore"):
                same = np.linalg.norm(np.cross(back, unit), axis=1) < SAME_RAY
                inside[rows] = same & ((back * unit).sum(axis=1) > 0)
        return pixels, inside

    def _project_directly(self, rays: Floats) -> tuple[Floats, Bools]:
        """The same for a lens that does not fold: half of the time."""
        if self.camera.lens.fisheye:
            pixels = self.camera.lens.project_rays(rays)
        else:  # most lines all around are behind the camera
            pixels, ahead = np.full((len(rays), 2), np.nan), rays[:, 2] > 0
            pixels[ahead] = self.camera.lens.project_rays(rays[ahead])
        with np.errstate(invalid="ignore"):
            return pixels, np.asarray(((pixels >= self.low) & (pixels <= self.high)).all(axis=1))

    def points(self, points: Floats) -> tuple[Floats, Bools]:
        """World points (N, 3) as pixels (N, 2), and (N,) whether they are in the picture."""
        return self.seen(self.rays(points))

    def rays(self, points: Floats) -> Floats:
        """(N, 3) world points in the camera frame, metres."""
        pose = self.camera.pose
        assert pose is not None
        return np.asarray(points @ pose.R_cw.T + pose.t_cw)

    def segments(self, begin: Floats, end: Floats) -> list[list[Floats]]:
        """Straight lines of the world as they are seen.

        Args:
            begin: (L, 3) metres.
            end: (L, 3) other than the beginnings.

        Returns:
            Of each line its visible stretches, (K, 2) pixels each.
        """
        first, last = self.rays(begin), self.rays(end)
        along = last - first
        length2 = np.maximum((along**2).sum(axis=1), 1e-18)
        near = first - along * ((first * along).sum(axis=1) / length2)[:, None]
        unit, distance = along / np.sqrt(length2)[:, None], np.maximum(np.linalg.norm(near, axis=1), 1e-9)
        # At an even pace for the camera: the line's points are near + distance * tan(angle) * unit.
        low = np.arctan2((first * unit).sum(axis=1), distance)
        high = np.arctan2((last * unit).sum(axis=1), distance)
        steps = max(2, int(np.ceil((high - low).max(initial=0.0) / STEP)) + 1)
        share = np.linspace(0.0, 1.0, steps)

        def at(line: Ints, where: Floats) -> Floats:
            angle = low[line] + where * (high - low)[line]
            # The same direction as the point, finite where the line ends at infinity.
            return np.asarray(near[line] * np.cos(angle)[:, None] + (distance[line] * np.sin(angle))[:, None] * unit[line])

        return self._trace_lines(len(begin), share, at)

    def horizon(self) -> list[Floats]:
        """Visible stretches (K, 2) of the line where the ground's plane ends."""
        behind = self._heading() + np.pi
        share = np.linspace(0.0, 1.0, int(np.ceil(2 * np.pi / STEP)) + 1)

        def at(_: Ints, where: Floats) -> Floats:
            return self._directions(behind + 2 * np.pi * where, np.zeros(len(where)))

        return self._trace_lines(1, share, at)[0]

    def verticals(self, step: float) -> list[list[Floats]]:
        """Plumb lines all around the camera, as far as they are in the picture: any vertical edge lies along one, near or far.

        Args:
            step: between their headings, radians, a whole share of a turn; one is straight ahead.

        Returns:
            Of each line that is visible, by heading, its visible stretches, (K, 2) pixels each, from below upwards.
        """
        heading, share, at = self._plumb(step)
        return [stretches for stretches in self._trace_lines(len(heading), share, at) if stretches]

    def count_verticals(self, step: float) -> int:
        """How many plumb lines `verticals` finds."""
        heading, share, at = self._plumb(step)
        inside = self.seen(at(np.repeat(np.arange(len(heading)), len(share)), np.tile(share, len(heading))))[1]
        return int(np.count_nonzero(inside.reshape(len(heading), -1).any(axis=1)))

    def _plumb(self, step: float) -> tuple[Floats, Floats, Rays]:
        """Headings of plumb lines around the camera, the shares of their lengths that are sampled, and their directions."""
        count = round(2 * np.pi / step)
        heading = np.asarray(self._heading() - step * (np.arange(count) - count // 2), dtype=np.float64)
        share = np.linspace(0.0, 1.0, int(np.ceil(2 * STEEPEST / STEP)) + 1)

        def at(line: Ints, where: Floats) -> Floats:
            return self._directions(heading[line], np.asarray(STEEPEST * (2 * where - 1), dtype=np.float64))

        return heading, share, at

    def _heading(self) -> float:
        """Where the camera looks over the ground, radians from the world's x axis towards y."""
        pose = self.camera.pose
        assert pose is not None
        return float(np.arctan2(pose.R_cw[2, 1], pose.R_cw[2, 0]))

    def _directions(self, heading: Floats, elevation: Floats) -> Floats:
        """(N, 3) unit vectors in the camera frame of headings (N,) and elevations (N,) in the world, radians."""
        pose = self.camera.pose
        assert pose is not None
        level = np.cos(elevation)
        world = np.column_stack([level * np.cos(heading), level * np.sin(heading), np.sin(elevation)])
        return np.asarray(world @ pose.R_cw.T)

    def _trace_lines(self, n: int, share: Floats, at: Rays) -> list[list[Floats]]:
        """Visible stretches of `n` lines whose directions at shares of their lengths `at` tells."""
        line = np.repeat(np.arange(n), len(share))
        pixels, inside = self.seen(at(line, np.tile(share, n)))
        pixels, inside = pixels.reshape(n, len(share), 2), inside.reshape(n, len(share))
        row, column = np.nonzero(inside[:, 1:] != inside[:, :-1])
        enters = inside[row, column + 1]
        border = self._border(row, share[np.where(enters, column + 1, column)], share[np.where(enters, column, column + 1)], at)
        ends = {(int(r), int(c)): border[k] for k, (r, c) in enumerate(zip(row, column, strict=True))}
        return [_stretches(pixels[k], inside[k], k, ends) for k in range(n)]

    def _border(self, line: Ints, seen: Floats, unseen: Floats, at: Rays) -> Floats:
        """(E, 2) the last visible pixels of lines between a visible and an invisible share."""
        if not len(line):
            return np.zeros((0, 2))
        pixels, inside = self.seen(at(line, _bisect_visible(self._project_directly, line, seen, unseen, at)))
        rows = np.flatnonzero(~inside)
        if len(rows):  # the lens folds on the way: its rays have to be looked at
            pixels[rows] = self.seen(at(line[rows], _bisect_visible(self.seen, line[rows], seen[rows], unseen[rows], at)))[0]
        return pixels


def _bisect_visible(seen_at: Seen, line: Ints, seen: Floats, unseen: Floats, at: Rays) -> Floats:
    """(E,) the last visible shares of lines between a visible and an invisible share."""
    for _ in range(HALVINGS):
        middle = 0.5 * (seen + unseen)
        inside = seen_at(at(line, middle))[1]
        seen, unseen = np.where(inside, middle, seen), np.where(inside, unseen, middle)
    return seen


def _stretches(pixels: Floats, inside: Bools, line: int, ends: dict[tuple[int, int], Floats]) -> list[Floats]:
    """The runs of visible samples of one line, each to where it leaves the picture."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    out = []
    for first, after in zip(change[::2].tolist(), change[1::2].tolist(), strict=True):
        parts: list[Floats] = [pixels[first:after]]
        if (line, first - 1) in ends:
            parts.insert(0, ends[line, first - 1][None])
        if (line, after - 1) in ends:
            parts.append(ends[line, after - 1][None])
        stretch = simplify_polyline(np.concatenate(parts))
        if len(stretch) > 1:
            out.append(stretch)
    return out


def simplify_polyline(points: Floats, tolerance: float = STRAIGHT_PX) -> Floats:
    """A line of points (N, 2) without those that lie on the way between others (Douglas and Peucker 1973)."""
    keep = np.zeros(len(points), bool)
    keep[[0, -1]] = True
    waiting = [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        along = points[last] - points[first]
        away = points[first + 1 : last] - points[first]
        length = float(np.hypot(*along))
        miss = np.abs(along[0] * away[:, 1] - along[1] * away[:, 0]) / length if length > 0 else np.hypot(*away.T)
        worst = int(np.argmax(miss))
        if miss[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            waiting += [(first, middle), (middle, last)]
    return points[keep]


def spacing_of(extent_m: float, most: int = 24, choices: Sequence[float] = (1, 2, 5, 10, 20, 50, 100, 200, 500)) -> float:
    """Metres between the lines of a grid over so many metres, so that there are `most` lines or fewer."""
    return float(next((one for one in choices if extent_m / one <= most), choices[-1]))
