"""Groups of cameras that nothing else registers, joined where people pass from one to the other: edges of the view graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.graph import Edge, ViewGraph, with_edges
from passerby.association.ground.pair_matching import GroundMotion
from passerby.association.ground.passages import Passage
from passerby.association.ground.registration import Registration
from passerby.common.arrays import Ints
from passerby.core.cameras import Pose
from passerby.findings.finding import Finding, notice
from passerby.geometry.single_view import Level

MOST_EDGES = 3
"""Pairs of cameras of one seam, those that see most of the people who pass."""
LEAST_SHARE = 0.25
"""Of the people that the pair with the most sees."""


@dataclass(frozen=True, eq=False)
class SeamEdge:
    """Two cameras on both sides of a seam."""

    a: str
    b: str
    pose_a: Pose
    """In the world of its own group,"""
    pose_b: Pose
    """and in that of the other."""
    motion: GroundMotion
    """Between these worlds, and between the clocks of the two cameras."""
    place: complex
    """Where people pass, in the first world."""
    people: int
    """Who pass and are seen by both."""


@dataclass(frozen=True, eq=False)
class Seam:
    """Where people pass between two groups."""

    cameras: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of either group."""
    people: int
    """People who pass from one to the other."""
    needed: int
    """So many would be clear of chance."""
    edges: tuple[SeamEdge, ...]
    """The pairs of cameras that see most of them; one or more."""

    @property
    def clear(self) -> bool:
        """Whether the groups are joined."""
        return self.people >= self.needed

    @property
    def finding(self) -> Finding:
        """The notice that two groups are one rig."""
        nearest = self.edges[0]
        return notice("groups_joined", nearest.a, nearest.b, people=self.people, sizes=[len(group) for group in self.cameras])

    @classmethod
    def of(cls, passage: Passage, first: Sequence[GroupCamera], second: Sequence[GroupCamera]) -> Seam:
        """The seam of two groups whose cameras are in the order of the passage."""
        edges = list[SeamEdge]()
        for at in np.argsort(-passage.cameras, axis=None, kind="stable")[:MOST_EDGES].tolist():
            a, b = first[at // len(second)], second[at % len(second)]
            people = int(passage.cameras.flat[at])
            if edges and people < LEAST_SHARE * int(passage.cameras.max()):
                break
            motion = replace(passage.motion, lag_s=passage.motion.lag_s + a.offset_s - b.offset_s)
            edges.append(SeamEdge(a.name, b.name, a.pose, b.pose, motion, passage.place, people))
        names = tuple(one.name for one in first), tuple(one.name for one in second)
        return cls(names, passage.votes, passage.needed, tuple(edges))


@dataclass(frozen=True, eq=False)
class GroupCamera:
    """A camera of a calibrated group."""

    name: str
    pose: Pose
    offset_s: float
    """What to add to its clock for that of the group."""


def add_seams(graph: ViewGraph, seams: Sequence[Seam], cameras: Sequence[CameraTracklets]) -> ViewGraph:
    """The view graph with the edges of seams whose cameras are among these."""
    number = {camera.name: c for c, camera in enumerate(cameras)}
    edges = [
        edge
        for one in (one for seam in seams for one in seam.edges)
        if one.a in number and one.b in number
        if (edge := _edge(one, number[one.a], number[one.b], cameras)) is not None
    ]
    return with_edges(graph, edges) if edges else graph


def _edge(one: SeamEdge, a: int, b: int, cameras: Sequence[CameraTracklets]) -> Edge | None:
    """The edge between the levelled frames of two cameras, which is how tracks see them."""
    first, second = cameras[a].level, cameras[b].level
    if first is None or second is None:
        return None
    there = one.motion.turn * one.place + one.motion.shift
    from_first, to_second = _to_level(one.pose_a, first, one.place), _to_level(one.pose_b, second, there)
    if from_first is None or to_second is None:
        return None
    motion = from_first.inverse.then(one.motion).then(to_second)
    middle = from_first.turn * one.place + from_first.shift
    if a > b:
        middle = motion.turn * middle + motion.shift
        motion, a, b = motion.inverse, b, a
    none: Ints = np.zeros(0, np.int64)
    guess = Registration(
        motion.turn, motion.shift, motion.lag_s, float(one.people), one.people, 1.0, middle, none, none, np.zeros(0)
    )  # fmt: skip
    return Edge(a, b, guess, 0.0, 1.0, used=True)


def _to_level(pose: Pose, level: Level, place: complex) -> GroundMotion | None:
    """From the world to a camera's levelled frame about a place on the ground; None where the camera cannot see the ground."""
    around = place + np.array([0.0, 1.0, -1.0])
    ground = np.column_stack([around.real, around.imag, np.zeros(3)])
    seen = level.ground_positions((ground - pose.centre) @ pose.R_cw.T)
    if not np.isfinite(seen).all():
        return None
    at = seen[:, 0] + 1j * seen[:, 1]
    turn = complex(at[1] - at[2]) / 2
    return GroundMotion(turn, complex(at[0]) - turn * place, 0.0)
