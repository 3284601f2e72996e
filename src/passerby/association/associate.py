"""Identities of tracklets: first from registered pairs of cameras, later from a calibrated rig."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.correlation_clustering import cluster_tracklets, find_overlaps
from passerby.association.graph import ViewGraph
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.ground.ray_affinity import RayTracks, pairwise_ray_affinity, ray_tracks
from passerby.association.ground.registration import score_motion
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose

Pairs = tuple[Ints, Ints, Floats]
"""(E,) tracklets, numbered over all cameras, (E,) tracklets, and (E,) the evidence that they are one person, nats."""

OVERLAP_S = 0.3
"""Overlap, seconds, above which tracklets of one camera are two people; a shorter one may be a tracker's late end."""
TWO_PEOPLE = 2.0
"""Evidence for two people while one camera sees two tracklets, per grid time. It is finite: a box detected twice, or a tracklet
that ends on another person, must not keep two groups apart against all other evidence."""
GOES_ON = 3.0
"""Evidence for one person where a tracklet continues as another: links are 20 times more likely than the next best
(3 nats)."""
MOST_CONTRADICTIONS = 6
"""Largest number of times that tracklets are joined again with evidence against contradictory joins."""
SAMPLE_WORTH = 0.5
"""Weight of the agreement of one sample: neighbouring samples, half a second apart, are partly redundant."""


@dataclass(frozen=True, eq=False)
class Tracklets:
    """The tracklets of all cameras, in one numbering: camera c's tracklet t is `first[c] + t`."""

    first: Ints
    """(C + 1,)"""
    start_s: Floats
    """(T,) first time by the camera's own clock; `end_s` is the last. Infinite for numbers without a body."""
    end_s: Floats
    continued: tuple[Ints, Ints]
    """(K,) tracklets and (K,) the tracklets that continue them."""

    @classmethod
    def of(cls, cameras: Sequence[CameraTracklets]) -> Tracklets:
        """Number the tracklets of all cameras."""
        first = np.concatenate([[0], np.cumsum([camera.n_tracklets for camera in cameras])]).astype(np.int64)
        start, end = np.full(first[-1], np.inf), np.full(first[-1], -np.inf)
        ends, begins = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for camera, offset in zip(cameras, first[:-1], strict=True):
            own = camera.bodies.take(camera.bodies.identity >= 0)
            np.minimum.at(start, own.identity + offset, own.seconds)
            np.maximum.at(end, own.identity + offset, own.seconds)
            ends.append(camera.continued[0] + offset)
            begins.append(camera.continued[1] + offset)
        return cls(first, start, end, (np.concatenate(ends), np.concatenate(begins)))

    def together(self) -> tuple[Ints, Ints, Floats]:
        """Find pairs of tracklets of one camera that overlap in time, and the length of the overlap, seconds."""
        first, second, seconds = [], [], []
        for c in range(len(self.first) - 1):
            part = slice(int(self.first[c]), int(self.first[c + 1]))
            seen = np.flatnonzero(np.isfinite(self.start_s[part]))
            start, end = self.start_s[part][seen], self.end_s[part][seen]
            i, j = find_overlaps(start, end, OVERLAP_S)
            first.append(seen[i] + part.start)
            second.append(seen[j] + part.start)
            seconds.append(np.minimum(end[i], end[j]) - np.maximum(start[i], start[j]))
        return np.concatenate(first), np.concatenate(second), np.concatenate(seconds)


def joined_pairs(*parts: Pairs | None) -> Pairs | None:
    """Concatenate the pairs of all parts; return None where there are none."""
    known = [part for part in parts if part is not None]
    if not known:
        return None
    first, second, weight = (np.concatenate(columns) for columns in zip(*known, strict=True))
    return first, second, weight


@dataclass(frozen=True, eq=False)
class _Edges:
    first: list[Ints]
    second: list[Ints]
    weight: list[Floats]

    def add(self, first: Ints, second: Ints, weight: Floats) -> None:
        """Add E edges: tracklets, tracklets, and the evidence for one person."""
        self.first.append(first)
        self.second.append(second)
        self.weight.append(weight)


def cluster_by_pairwise_poses(
    tracklets: Tracklets, tracks: Sequence[GroundTracks | None], graph: ViewGraph,
    affinity: Mapping[tuple[int, int], Floats] | None = None, known: Pairs | None = None,
) -> Ints:  # fmt: skip
    """Return the person (T,) of each tracklet, joined by the registrations of the view graph and by other evidence."""
    edges = _Edges([], [], [])
    if known is not None:
        edges.add(*known)
    _add_registered(edges, tracklets, tracks, graph, affinity, [True] * len(tracks))
    return _joined(tracklets, edges)


def _add_registered(
    edges: _Edges, tracklets: Tracklets, tracks: Sequence[GroundTracks | None], graph: ViewGraph,
    affinity: Mapping[tuple[int, int], Floats] | None, wanted: Sequence[bool],
) -> None:  # fmt: skip
    """Add the evidence of the registrations of all pairs with a wanted camera."""
    for edge in graph.edges:
        in_a, in_b = tracks[edge.a], tracks[edge.b]
        if not edge.used or edge.guess is None or in_a is None or in_b is None or not (wanted[edge.a] or wanted[edge.b]):
            continue
        i, j, value, _ = score_motion(in_a, in_b, edge.guess.turn, edge.guess.shift, edge.guess.lag_s)
        weight = _weight(value, i, j, affinity, (edge.a, edge.b))
        edges.add(i + tracklets.first[edge.a], j + tracklets.first[edge.b], weight)


def cluster_by_rig(
    tracklets: Tracklets, cameras: Sequence[CameraTracklets], graph: ViewGraph, poses: Sequence[Pose | None], offset_s: Floats,
    person_height_m: float, affinity: Mapping[tuple[int, int], Floats] | None = None, known: Pairs | None = None,
    candidates: Container[tuple[int, int]] | None = None,
) -> Ints:  # fmt: skip
    """Return the person (T,) of each tracklet, joined where tracklets meet in a calibrated rig.

    Args:
        tracklets: of all cameras.
        cameras: their people.
        graph: registrations, used for cameras that the rig lacks.
        poses: one a camera, world z up and ground at z = 0; None for a camera that is not registered.
        offset_s: (C,) time offset to add to each camera's clock, seconds.
        person_height_m: typical standing height, metres.
        affinity: appearance, as for `register_pair`.
        known: other evidence for one person.
        candidates: the pairs of cameras, a < b, of which some are compared (see `compared_pairs`); None: all are.
    """
    tracks = [None if pose is None else ray_tracks(own.bodies, pose) for own, pose in zip(cameras, poses, strict=True)]
    edges = _Edges([], [], [])
    if known is not None:
        edges.add(*known)
    compared = compared_pairs(graph, len(cameras), candidates)

    def meetings(a: int, b: int) -> Pairs | None:
        in_a, in_b = tracks[a], tracks[b]
        if in_a is None or in_b is None:
            return None
        i, j, value = pairwise_ray_affinity(in_a, in_b, float(offset_s[a] - offset_s[b]), person_height_m)
        return i + tracklets.first[a], j + tracklets.first[b], _weight(value, i, j, affinity, (a, b))

    for a, b in compared:
        if (found := meetings(a, b)) is not None:
            edges.add(*found)
    lost = [pose is None for pose in poses]
    _add_registered(edges, tracklets, [camera.tracks for camera in cameras], graph, affinity, lost)
    person = _joined(tracklets, edges)
    if candidates is None:
        return person
    # A person joined through others may be in two places at once: pairs of cameras that see the person there are compared too.
    known_pairs = set[tuple[int, int]]()
    met: dict[tuple[int, int], Pairs | None] = {}
    for _ in range(MOST_CONTRADICTIONS):
        before = len(known_pairs)
        for a, b in _seeing_one(tracklets, tracks, offset_s, person):
            if (a, b) in compared:
                continue
            if (a, b) not in met:
                met[a, b] = meetings(a, b)
            if (found := met[a, b]) is not None:
                i, j, weight = found
                new = np.array([pair not in known_pairs for pair in zip(i.tolist(), j.tolist(), strict=True)], dtype=bool)
                new &= person[i] == person[j]
                known_pairs.update(zip(i[new].tolist(), j[new].tolist(), strict=True))
                edges.add(i[new], j[new], weight[new])
        if len(known_pairs) == before:
            break
        person = _joined(tracklets, edges)
    return person


def compared_pairs(
    graph: ViewGraph, n_cameras: int, candidates: Container[tuple[int, int]] | None
) -> dict[tuple[int, int], None]:
    """Select the pairs of cameras whose tracklets are compared: all where `candidates` is None. Otherwise select registered
    pairs, and the candidates of cameras that are in no registered pair.

    Other pairs share little ground, as through a door. With a rig that is a little off, different people on both sides of a
    wall seem to be at the same place. (Simulated halls and a corridor, 21 cameras, seed 801: of 3,800 and 4,300 box pairs on
    both sides of two doors 30 and 22 % were wrong with these pairs, and 6 and 17 % are without them.)
    """
    pairs = [(a, b) for a in range(n_cameras) for b in range(a + 1, n_cameras)]
    if candidates is None:
        return dict.fromkeys(pairs)
    registered = {(edge.a, edge.b) for edge in graph.edges if edge.used}
    alone = set(range(n_cameras)) - {camera for pair in registered for camera in pair}
    return dict.fromkeys(pair for pair in pairs if pair in registered or (pair in candidates and alone.intersection(pair)))


def _seeing_one(
    tracklets: Tracklets, tracks: Sequence[RayTracks | None], offset_s: Floats, person: Ints
) -> list[tuple[int, int]]:
    """Find the pairs of cameras, a < b, that see one person at one time."""
    seen, camera = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
    for c, own in enumerate(tracks):
        if own is not None:
            step = own.step + round(float(offset_s[c]) / STEP_S)
            seen.append(np.unique(np.column_stack([person[own.tracklet + tracklets.first[c]], step]), axis=0))
            camera.append(np.full(len(seen[-1]), c))
    _, moment = np.unique(np.concatenate(seen), axis=0, return_inverse=True)
    row = np.concatenate(camera)
    there = csr_array((np.ones(len(row)), (row, moment.ravel())), shape=(len(tracks), len(row)))
    a, b = (there @ there.T).nonzero()
    return [(int(one), int(other)) for one, other in sorted(zip(a, b, strict=True)) if one < other]


def _weight(value: Floats, i: Ints, j: Ints, affinity: Mapping[tuple[int, int], Floats] | None, key: tuple[int, int]) -> Floats:
    """Return the evidence for one person: from positions and, where it is known, from appearance."""
    weight = SAMPLE_WORTH * value
    return weight + affinity[key][i, j] if affinity is not None and key in affinity else weight


def cluster_by_appearance_votes(tracklets: Tracklets, appearance: AppearanceAffinity, known: Pairs | None = None) -> Ints:
    """Return the person (T,) of each tracklet, joined by appearance.

    Each instant at which two tracklets were matched is evidence for one person; every other instant at which both were seen is
    evidence against it. `known` is other evidence for one person.
    """
    edges = _Edges([], [], [])
    if known is not None:
        edges.add(*known)
    for (a, b), pair in appearance.pairs.items():
        together, matched = pair.votes.together.tocoo(), pair.votes.matched
        row_a, row_b = together.coords
        i, j = (features.tracklet[row] for features, row in zip(appearance.features_of(a, b), (row_a, row_b), strict=True))
        yes = np.asarray(matched[row_a, row_b], dtype=np.float64).ravel()
        edges.add(i + tracklets.first[a], j + tracklets.first[b], SAMPLE_WORTH * (2 * yes - together.data))
    return _joined(tracklets, edges)


def _joined(tracklets: Tracklets, edges: _Edges) -> Ints:
    i, j, seconds = tracklets.together()
    edges.add(i, j, -TWO_PEOPLE * seconds / STEP_S)
    edges.add(*tracklets.continued, np.full(len(tracklets.continued[0]), GOES_ON))
    return cluster_tracklets(
        len(tracklets.start_s), np.concatenate(edges.first), np.concatenate(edges.second), np.concatenate(edges.weight)
    )
