"""World lines projected into the picture of one camera: bent by the lens, clipped at the picture's border and at the horizon.

A polynomial lens model folds: a point far outside the view can project into the picture again. A point counts as visible only
if the ray of its pixel leads back to the point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera
from passerby.geometry.groups import find_runs

Rays = Callable[[Ints, Floats], Floats]
"""Function from line numbers (E,) and shares of the lines' lengths (E,) to directions (E, 3), camera frame."""

Seen = Callable[[Floats], tuple[Floats, Bools]]
"""Function from directions (N, 3), camera frame, to pixels (N, 2) and (N,) whether they are in the picture."""

SAME_RAY = 1e-3
"""Largest sine of the angle between a point's direction and the ray of its pixel. A larger angle shows a fold of the lens."""
STEP = np.deg2rad(1.0)
"""Angle at the camera between samples of a line: the error of the polyline is below 0.1 pixels for lenses of real rigs."""
STRAIGHT_PX = 0.1
"""Samples that are nearer than this to the line between other samples are left out, pixels."""
STEEPEST = np.deg2rad(88.0)
"""Elevation at which plumb lines end, up and down: all of them meet above and below the camera."""
HALVINGS = 14
"""Number of bisections of a step that locate a line's entry into and exit from the picture, to a thousandth of a pixel."""


@dataclass(frozen=True)
class View:
    """A camera with a pose, and the border of its picture."""

    camera: Camera

    @property
    def low(self) -> Floats:
        """(2,) outer corner of the first pixel."""
        return np.array([-0.5, -0.5])

    @property
    def high(self) -> Floats:
        """(2,) outer corner of the last pixel."""
        return np.array(self.camera.lens.size) - 0.5

    def seen(self, rays: Floats) -> tuple[Floats, Bools]:
        """Project directions (N, 3), camera frame, of any length, to pixels (N, 2); (N,) whether they are in the picture."""
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
        """Project as `seen` does, without the check for folds of the lens, in half of the time."""
        if self.camera.lens.fisheye:
            pixels = self.camera.lens.project_rays(rays)
        else:  # most plumb lines around the camera are behind it
            pixels, ahead = np.full((len(rays), 2), np.nan), rays[:, 2] > 0
            pixels[ahead] = self.camera.lens.project_rays(rays[ahead])
        with np.errstate(invalid="ignore"):
            return pixels, np.asarray(((pixels >= self.low) & (pixels <= self.high)).all(axis=1))

    def points(self, points: Floats) -> tuple[Floats, Bools]:
        """Project world points (N, 3) to pixels (N, 2); (N,) whether they are in the picture."""
        return self.seen(self.rays(points))

    def rays(self, points: Floats) -> Floats:
        """Transform world points (N, 3) into the camera frame, metres."""
        pose = self.camera.pose
        assert pose is not None
        return np.asarray(points @ pose.R_cw.T + pose.t_cw)

    def segments(self, begin: Floats, end: Floats) -> list[list[Floats]]:
        """Project straight line segments of the world.

        Args:
            begin: (L, 3) first end points, world, metres.
            end: (L, 3) second end points, different from the first.

        Returns:
            For each line its visible stretches, (K, 2) pixels each.
        """
        first, last = self.rays(begin), self.rays(end)
        along = last - first
        length2 = np.maximum((along**2).sum(axis=1), 1e-18)
        near = first - along * ((first * along).sum(axis=1) / length2)[:, None]
        unit, distance = along / np.sqrt(length2)[:, None], np.maximum(np.linalg.norm(near, axis=1), 1e-9)
        # Samples at equal angles as seen from the camera: the line's points are near + distance * tan(angle) * unit.
        low = np.arctan2((first * unit).sum(axis=1), distance)
        high = np.arctan2((last * unit).sum(axis=1), distance)
        steps = max(2, int(np.ceil((high - low).max(initial=0.0) / STEP)) + 1)
        share = np.linspace(0.0, 1.0, steps)

        def at(line: Ints, where: Floats) -> Floats:
            angle = low[line] + where * (high - low)[line]
            # The point multiplied by cos(angle): the same direction, and finite if the line ends at infinity.
            return np.asarray(near[line] * np.cos(angle)[:, None] + (distance[line] * np.sin(angle))[:, None] * unit[line])

        return self._trace_lines(len(begin), share, at)

    def horizon(self) -> list[Floats]:
        """Return the visible stretches (K, 2), pixels, of the horizon of the ground plane."""
        behind = self._heading() + np.pi
        share = np.linspace(0.0, 1.0, int(np.ceil(2 * np.pi / STEP)) + 1)

        def at(_: Ints, where: Floats) -> Floats:
            return self._directions(behind + 2 * np.pi * where, np.zeros(len(where)))

        return self._trace_lines(1, share, at)[0]

    def verticals(self, step: float) -> list[list[Floats]]:
        """Project plumb lines all around the camera. The image of any vertical edge, near or far, lies along a plumb line.

        Args:
            step: angle between their headings, radians, a full turn divided by an integer; one line is straight ahead.

        Returns:
            For each visible line, sorted by heading, its visible stretches, (K, 2) pixels each, from below upwards.
        """
        heading, share, at = self._plumb(step)
        return [stretches for stretches in self._trace_lines(len(heading), share, at) if stretches]

    def count_verticals(self, step: float) -> int:
        """Count the plumb lines that `verticals` finds."""
        heading, share, at = self._plumb(step)
        inside = self.seen(at(np.repeat(np.arange(len(heading)), len(share)), np.tile(share, len(heading))))[1]
        return int(np.count_nonzero(inside.reshape(len(heading), -1).any(axis=1)))

    def _plumb(self, step: float) -> tuple[Floats, Floats, Rays]:
        """Return the headings (L,) of plumb lines, the sampled shares (S,) of their lengths, and their directions' function."""
        count = round(2 * np.pi / step)
        heading = np.asarray(self._heading() - step * (np.arange(count) - count // 2), dtype=np.float64)
        share = np.linspace(0.0, 1.0, int(np.ceil(2 * STEEPEST / STEP)) + 1)

        def at(line: Ints, where: Floats) -> Floats:
            return self._directions(heading[line], np.asarray(STEEPEST * (2 * where - 1), dtype=np.float64))

        return heading, share, at

    def _heading(self) -> float:
        """Return the heading of the camera's viewing direction, radians from the world's x axis towards y."""
        pose = self.camera.pose
        assert pose is not None
        return float(np.arctan2(pose.R_cw[2, 1], pose.R_cw[2, 0]))

    def _directions(self, heading: Floats, elevation: Floats) -> Floats:
        """Return unit vectors (N, 3), camera frame, of headings (N,) and elevations (N,) in the world, radians."""
        pose = self.camera.pose
        assert pose is not None
        level = np.cos(elevation)
        world = np.column_stack([level * np.cos(heading), level * np.sin(heading), np.sin(elevation)])
        return np.asarray(world @ pose.R_cw.T)

    def _trace_lines(self, n: int, share: Floats, at: Rays) -> list[list[Floats]]:
        """Return the visible stretches of `n` lines; `at` gives their directions at shares of their lengths."""
        line = np.repeat(np.arange(n), len(share))
        pixels, inside = self.seen(at(line, np.tile(share, n)))
        pixels, inside = pixels.reshape(n, len(share), 2), inside.reshape(n, len(share))
        row, column = np.nonzero(inside[:, 1:] != inside[:, :-1])
        enters = inside[row, column + 1]
        border = self._border(row, share[np.where(enters, column + 1, column)], share[np.where(enters, column, column + 1)], at)
        ends = {(int(r), int(c)): border[k] for k, (r, c) in enumerate(zip(row, column, strict=True))}
        return [_stretches(pixels[k], inside[k], k, ends) for k in range(n)]

    def _border(self, line: Ints, seen: Floats, unseen: Floats, at: Rays) -> Floats:
        """Return the last visible pixels (E, 2) of lines between a visible and an invisible share (E,) of their lengths."""
        if not len(line):
            return np.zeros((0, 2))
        pixels, inside = self.seen(at(line, _bisect_visible(self._project_directly, line, seen, unseen, at)))
        rows = np.flatnonzero(~inside)
        if len(rows):  # the lens folds between the two shares: repeat the search with the check for folds
            pixels[rows] = self.seen(at(line[rows], _bisect_visible(self.seen, line[rows], seen[rows], unseen[rows], at)))[0]
        return pixels


def _bisect_visible(seen_at: Seen, line: Ints, seen: Floats, unseen: Floats, at: Rays) -> Floats:
    """Find by bisection the last visible shares (E,) of lines between a visible and an invisible share (E,)."""
    for _ in range(HALVINGS):
        middle = 0.5 * (seen + unseen)
        inside = seen_at(at(line, middle))[1]
        seen, unseen = np.where(inside, middle, seen), np.where(inside, unseen, middle)
    return seen


def _stretches(pixels: Floats, inside: Bools, line: int, ends: dict[tuple[int, int], Floats]) -> list[Floats]:
    """Return the runs of visible samples of one line, each extended to the points where it enters and leaves the picture."""
    out = []
    for first, last in find_runs(inside):
        parts: list[Floats] = [pixels[first : last + 1]]
        if (line, first - 1) in ends:
            parts.insert(0, ends[line, first - 1][None])
        if (line, last) in ends:
            parts.append(ends[line, last][None])
        stretch = simplify_polyline(np.concatenate(parts))
        if len(stretch) > 1:
            out.append(stretch)
    return out


def simplify_polyline(points: Floats, tolerance: float = STRAIGHT_PX) -> Floats:
    """Remove the points of a polyline (N, 2) that lie within a tolerance of the rest (Douglas and Peucker 1973)."""
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
    """Choose the spacing of a grid, metres, so that at most `most` spacings fit into its extent."""
    return float(next((one for one in choices if extent_m / one <= most), choices[-1]))
