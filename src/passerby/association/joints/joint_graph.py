"""Joining of cameras that the tracks of walkers do not join, by people's joints: consistent registrations, and identities."""

from __future__ import annotations

from collections.abc import Container, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.associate import SAMPLE_WORTH, Pairs, Tracklets
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.graph import ViewGraph
from passerby.association.joints.joint_pairs import JointRegistration, SamePerson, register_joints
from passerby.association.joints.joint_tracks import GRID_S, JointTracks
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Bools, Floats
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.findings.finding import Finding, notice
from passerby.geometry.rotations import angle_between
from passerby.geometry.triangulation import triangulate_two_views
from passerby.geometry.two_view import PairHypothesis

Way = tuple[int, Floats, tuple[int, ...]]
"""Path from a tree's root to a camera: the root, the rotation, and the numbers of the registrations on the path."""

CONTRADICTION = np.deg2rad(35.0)
"""Two paths between cameras whose rotations differ by more contradict each other. With joints of a second or two a pair's
rotation is wrong by up to 17 degrees, where a body is nearly flat."""
AS_GOOD = 0.8
"""Of two registrations that contradict each other neither is believed if the worse has this share of the better one's gain."""
BODY_QUANTILE = 0.65
"""Quantile of the observed body lengths that is taken as standing height: people bend, but do not stretch."""


@dataclass(frozen=True, eq=False)
class JointJob:
    """A pair of cameras to be registered by joints."""

    a: int
    b: int
    in_a: JointTracks
    in_b: JointTracks
    lag_steps: int
    rng: np.random.Generator


def register_by_joints(
    joints: Sequence[JointTracks], graph: ViewGraph, rng: np.random.Generator, executor: Executor | None, tell: Progress,
    candidates: Container[tuple[int, int]] | None = None,
) -> list[JointRegistration]:  # fmt: skip
    """Register the cameras that tracks do not join.

    Args:
        joints: joints of every camera.
        graph: registrations by tracks; pairs of cameras of one group are not tried.
        rng: every pair uses a child of it.
        executor: runs the pairs in parallel.
        tell: called for every pair that is done.
        candidates: the pairs, a < b, that are tried; None: all.

    Returns:
        The best registration of each pair that sees people together; those that contradict better ones are not `used`.
    """
    group = {c: number for number, members in enumerate(graph.groups) for c in members}
    wanted = [
        (a, b) for a in range(len(joints)) for b in range(a + 1, len(joints))
        if group[a] != group[b] and len(joints[a]) and len(joints[b]) and (candidates is None or (a, b) in candidates)
    ]  # fmt: skip
    if not wanted:
        return []
    offset = graph.offset_s
    jobs = [
        JointJob(a, b, joints[a], joints[b], round(float(offset[a] - offset[b]) / GRID_S), own)
        for (a, b), own in zip(wanted, rng.spawn(len(wanted)), strict=True)
    ]
    found = side_by_side(_registered, jobs, executor, tell, "registering pairs by keypoints")
    return consistent_registrations([registration for registration in found if registration is not None], len(joints))


def _registered(job: JointJob) -> JointRegistration | None:
    return register_joints(job.a, job.b, job.in_a, job.in_b, job.rng, job.lag_steps)


def consistent_registrations(registrations: Sequence[JointRegistration], n_cameras: int) -> list[JointRegistration]:
    """Mark registrations as not `used` where two paths between cameras contradict each other: the worse one, or both."""
    out = list(registrations)
    while True:
        order = sorted((k for k, one in enumerate(out) if one.used), key=lambda k: -out[k].gain * out[k].score)
        way: dict[int, Way] = {c: (c, np.eye(3), ()) for c in range(n_cameras)}
        rest = []
        for k in order:
            one = out[k]
            if way[one.a][0] == way[one.b][0]:
                rest.append(k)
            else:
                way = _grown(way, one, k)
        wrong = next((k for k in rest if _contradicts(out[k], way)), None)
        if wrong is None:
            return out
        loop = set(way[out[wrong].a][2]) ^ set(way[out[wrong].b][2])
        weakest = min(loop, key=lambda k: out[k].gain)
        if out[wrong].gain > AS_GOOD * out[weakest].gain:
            out[weakest] = replace(out[weakest], used=False)
        out[wrong] = replace(out[wrong], used=False)


def _grown(way: dict[int, Way], one: JointRegistration, number: int) -> dict[int, Way]:
    """Return the paths to all cameras after adding a registration to the tree."""
    (root, to_a, path_a), (old, to_b, path_b) = way[one.a], way[one.b]
    # From the new root to camera b, and back to the old root of b's tree.
    turn = to_b.T @ one.R_ba @ to_a
    out = dict(way)
    for c, (own, to_c, path) in way.items():
        if own == old:
            out[c] = (root, to_c @ turn, (*_apart(path_a, _apart(path_b, path)), number))
    return out


def _apart(first: tuple[int, ...], second: tuple[int, ...]) -> tuple[int, ...]:
    """Return the registrations that are on one of two paths only."""
    return tuple(sorted(set(first) ^ set(second)))


def _contradicts(one: JointRegistration, way: dict[int, Way]) -> bool:
    """Check whether the rotation of a registration differs from that of the tree."""
    return bool(angle_between(one.R_ba @ way[one.a][1], way[one.b][1]) > CONTRADICTION)


def add_joint_edges(graph: ViewGraph, registrations: Sequence[JointRegistration]) -> ViewGraph:
    """Merge the groups of the view graph that used registrations join, and align their clocks."""
    if not any(one.used for one in registrations):
        return graph
    groups = [list(group) for group in graph.groups]
    offset_s = graph.offset_s.copy()
    for one in sorted((one for one in registrations if one.used), key=lambda one: -one.gain * one.score):
        first, second = (next(group for group in groups if c in group) for c in (one.a, one.b))
        if first is second:
            continue
        offset_s[second] += offset_s[one.a] - one.lag_s - offset_s[one.b]
        groups.remove(second)
        first += second
        offset_s[first] -= offset_s[min(first)]
    ordered = tuple(tuple(sorted(group)) for group in sorted(groups, key=lambda group: (-len(group), min(group))))
    return replace(graph, groups=ordered, offset_s=offset_s)


def joined_by_joints(cameras: Sequence[CameraTracklets], registrations: Sequence[JointRegistration]) -> list[Finding]:
    """Return a notice where cameras were joined by joints: their clock offsets were not searched for."""
    joined = sorted({c for one in registrations if one.used for c in (one.a, one.b)})
    if not joined:
        return []
    return [notice("registered_by_keypoints", *(cameras[c].name for c in joined))]


def known_pairs(tracklets: Tracklets, registrations: Sequence[JointRegistration]) -> Pairs:
    """Return the evidence on identities from the used registrations."""
    people = [(one, person) for one in registrations if one.used for person in one.people]
    i = [tracklets.first[one.a] + person.i for one, person in people]
    j = [tracklets.first[one.b] + person.j for one, person in people]
    weight = [SAMPLE_WORTH * person.score * max(1.0, person.seconds / STEP_S) for _, person in people]
    return np.array(i, dtype=np.int64), np.array(j, dtype=np.int64), np.array(weight, dtype=np.float64)


def find_mirrored_tracklets(tracklets: Tracklets, registrations: Sequence[JointRegistration]) -> Bools:
    """Return a mask (T,) of tracklets in which left and right are exchanged: of each person the minority of tracklets."""
    edges = [
        (int(tracklets.first[one.a]) + person.i, int(tracklets.first[one.b]) + person.j, person)
        for one in registrations if one.used for person in one.people
    ]  # fmt: skip
    out = np.zeros(len(tracklets.start_s), dtype=np.bool_)
    if not any(person.mirrored for _, _, person in edges):
        return out
    group, side = np.arange(len(out)), np.zeros(len(out), dtype=np.bool_)
    for i, j, person in sorted(edges, key=lambda edge: -_worth(edge[2])):
        if group[i] != group[j]:
            moved = group == group[j]
            side[moved] ^= bool(side[i] ^ side[j]) ^ person.mirrored
            group[moved] = group[i]
    for number in np.unique(group):
        own = group == number
        out[own] = side[own] if 2 * np.count_nonzero(side[own]) <= np.count_nonzero(own) else ~side[own]
    return out


def _worth(person: SamePerson) -> float:
    return person.score * person.seconds


def joint_hypothesis(one: JointRegistration, a: CameraTracklets, b: CameraTracklets, person_height_m: float) -> PairHypothesis:
    """Scale the registration to metres, with people of the height `person_height_m`."""
    lengths = [_body_lengths(one, a, b, person) for person in one.people]
    found = np.concatenate([*lengths, np.zeros(0)])
    scale = person_height_m / float(np.quantile(found, BODY_QUANTILE)) if len(found) else person_height_m
    return PairHypothesis(one.a, one.b, one.R_ba, scale * one.t_ba, "joints", one.joints, one.joints)


def _body_lengths(one: JointRegistration, a: CameraTracklets, b: CameraTracklets, person: SamePerson) -> Floats:
    """Return body lengths (N,) in units of the baseline, at all times at which both cameras saw the person."""
    in_a, in_b = (camera.bodies.take(camera.bodies.identity == t) for camera, t in ((a, person.i), (b, person.j)))
    if not len(in_a) or not len(in_b):
        return np.zeros(0)
    order = np.argsort(in_b.seconds, kind="stable")
    place = np.searchsorted(in_b.seconds[order], in_a.seconds + one.lag_s)
    near = order[np.clip(place, 0, len(order) - 1)]
    close = np.abs(in_b.seconds[near] - in_a.seconds - one.lag_s) < GRID_S
    in_a, in_b = in_a.take(close), in_b.take(near[close])
    top = triangulate_two_views(in_a.top, in_b.top, one.R_ba, one.t_ba)
    bottom = triangulate_two_views(in_a.bottom, in_b.bottom, one.R_ba, one.t_ba)
    share = np.maximum(in_a.top_fraction - in_a.bottom_fraction, 0.3)
    length = np.linalg.norm(top - bottom, axis=1) / share
    return np.asarray(length[np.isfinite(length) & (length > 0)])
