"""Who is who, from what is known at the time: first from pairs of cameras, then from a calibrated rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.association.bodies import Bodies
from passerby.association.graph import ViewGraph
from passerby.association.ground_tracks import GroundTracks, Tolerance, ground_tracks
from passerby.association.joining import NEVER, join, overlapping
from passerby.association.looks import Looks
from passerby.association.registration import agreement
from passerby.cameras import Pose
from passerby.geometry.single_view import Level

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RIG_TOLERANCE = Tolerance(floor_m=0.25, along=0.01, across=0.005, foot_m=0.06)
"""How far off ground positions are once the rig is calibrated."""
OVERLAP_S = 0.3
"""Tracklets of one camera that overlap by more are two people; less may be a tracker's late end."""
SAMPLE_WORTH = 0.5
"""Of the agreement of one sample: neighbours, half a second apart, tell partly the same."""


@dataclass(frozen=True, eq=False)
class Tracklets:
    """The tracklets of all cameras, numbered through: camera c's tracklet t is `first[c] + t`."""

    first: Ints
    """(C + 1,)"""
    start_s: Floats
    """(T,) first and last time by the camera's own clock; NaN for numbers without a box."""
    end_s: Floats

    @classmethod
    def of(cls, bodies: Sequence[Bodies]) -> Tracklets:
        """The tracklets of the cameras' bodies."""
        start, end, count = [], [], [0]
        for seen in bodies:
            n = int(seen.tracklet.max(initial=-1)) + 1
            low, high = np.full(n, np.inf), np.full(n, -np.inf)
            own = seen.tracklet >= 0
            np.minimum.at(low, seen.tracklet[own], seen.seconds[own])
            np.maximum.at(high, seen.tracklet[own], seen.seconds[own])
            start.append(low)
            end.append(high)
            count.append(n)
        return cls(np.cumsum(count), np.concatenate(start), np.concatenate(end))

    def never_one(self) -> tuple[Ints, Ints]:
        """Pairs of tracklets of one camera that overlap in time."""
        first, second = [], []
        for c in range(len(self.first) - 1):
            part = slice(int(self.first[c]), int(self.first[c + 1]))
            seen = np.flatnonzero(np.isfinite(self.start_s[part]))
            i, j = overlapping(self.start_s[part][seen], self.end_s[part][seen], OVERLAP_S)
            first.append(seen[i] + part.start)
            second.append(seen[j] + part.start)
        return np.concatenate(first), np.concatenate(second)


@dataclass(frozen=True, eq=False)
class _Edges:
    first: list[Ints]
    second: list[Ints]
    weight: list[Floats]

    def add(self, first: Ints, second: Ints, weight: Floats) -> None:
        self.first.append(first)
        self.second.append(second)
        self.weight.append(weight)


def people_of_pairs(
    tracklets: Tracklets, tracks: Sequence[GroundTracks | None], graph: ViewGraph,
    likeness: Mapping[tuple[int, int], Floats] | None = None,
) -> Ints:  # fmt: skip
    """(T,) person of each tracklet, joined by the registrations of the view graph."""
    motions = {
        (edge.a, edge.b): (edge.guess.turn, edge.guess.shift, edge.guess.lag_s)
        for edge in graph.edges
        if edge.used and edge.guess is not None
    }
    return _people(tracklets, tracks, motions, likeness)


def people_of_rig(
    tracklets: Tracklets, bodies: Sequence[Bodies], poses: Sequence[Pose | None], offset_s: Floats,
    likeness: Mapping[tuple[int, int], Floats] | None = None,
) -> Ints:  # fmt: skip
    """(T,) person of each tracklet, joined by where a calibrated rig puts them on the ground.

    Args:
        tracklets: of all cameras.
        bodies: people of each camera, times by its own clock.
        poses: one a camera, world z up and ground at z = 0; None for a camera that is not registered.
        offset_s: (C,) what to add to each camera's clock.
        likeness: appearance, as for `register_pair`.
    """
    tracks: list[GroundTracks | None] = []
    for seen, pose in zip(bodies, poses, strict=True):
        level = None if pose is None else Level(np.asarray(pose.R_cw[:, 2]), float(pose.centre[2]), 0.0)
        tracks.append(None if level is None or level.height <= 0 else ground_tracks(seen, level, RIG_TOLERANCE, shortest_s=0.0))
    motions = {}
    for a, first in enumerate(poses):
        for b in range(a + 1, len(poses)):
            second, in_a, in_b = poses[b], tracks[a], tracks[b]
            if first is None or second is None or in_a is None or in_b is None:
                continue
            from_a, from_b = in_a.level.R_lc @ first.R_cw, in_b.level.R_lc @ second.R_cw
            turn = from_b @ from_a.T
            shift = from_b @ (first.centre - second.centre)
            motions[a, b] = (complex(turn[0, 0], turn[1, 0]), complex(shift[0], shift[1]), float(offset_s[a] - offset_s[b]))
    return _people(tracklets, tracks, motions, likeness)


def people_of_votes(tracklets: Tracklets, looks: Looks) -> Ints:
    """(T,) person of each tracklet, joined by looks.

    For one person speaks every instant at which the two tracklets were matched, against it every other that both were seen at.
    """
    edges = _Edges([], [], [])
    for (a, b), pair in looks.pairs.items():
        together, matched = pair.votes.together.tocoo(), pair.votes.matched
        row_a, row_b = together.coords
        i, j = (features.tracklet[row] for features, row in zip(looks.features_of(a, b), (row_a, row_b), strict=True))
        yes = np.asarray(matched[row_a, row_b], dtype=np.float64).ravel()
        edges.add(i + tracklets.first[a], j + tracklets.first[b], SAMPLE_WORTH * (2 * yes - together.data))
    return _joined(tracklets, edges)


def _people(
    tracklets: Tracklets, tracks: Sequence[GroundTracks | None],
    motions: Mapping[tuple[int, int], tuple[complex, complex, float]], likeness: Mapping[tuple[int, int], Floats] | None,
) -> Ints:  # fmt: skip
    edges = _Edges([], [], [])
    for (a, b), (turn, shift, lag_s) in motions.items():
        in_a, in_b = tracks[a], tracks[b]
        if in_a is None or in_b is None:
            continue
        i, j, value, _ = agreement(in_a, in_b, turn, shift, lag_s)
        weight = SAMPLE_WORTH * value
        if likeness is not None and (a, b) in likeness:
            weight = weight + likeness[a, b][i, j]
        edges.add(i + tracklets.first[a], j + tracklets.first[b], weight)
    return _joined(tracklets, edges)


def _joined(tracklets: Tracklets, edges: _Edges) -> Ints:
    i, j = tracklets.never_one()
    edges.add(i, j, np.full(len(i), NEVER))
    return join(len(tracklets.start_s), np.concatenate(edges.first), np.concatenate(edges.second), np.concatenate(edges.weight))
