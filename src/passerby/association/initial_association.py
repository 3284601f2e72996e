"""Association before any rig is known: by the registrations of camera pairs, or by appearance alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.associate import (
    Pairs,
    Tracklets,
    cluster_by_appearance_votes,
    cluster_by_pairwise_poses,
    joined_pairs,
)
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.candidates import Candidates
from passerby.association.clocks.starts import NEAR_S, Starts, shifted, with_lag
from passerby.association.graph import Edge, ViewGraph, view_graph
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.ground.registration import PairRegistration, register_pair
from passerby.association.joints.joint_graph import (
    add_joint_edges,
    find_mirrored_tracklets,
    joint_hypothesis,
    known_pairs,
    register_by_joints,
)
from passerby.association.joints.joint_pairs import JointRegistration
from passerby.association.joints.joint_tracks import joint_tracks
from passerby.association.registration_failures import fit_of, fixed_by, sees_too_little, what_would_fit
from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.parallel import EarlierResults
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Lens
from passerby.findings.finding import Finding, refusal
from passerby.findings.ranking import RefusalError
from passerby.geometry.single_view import Level
from passerby.geometry.two_view import PairHypothesis

TRIED = 3
"""Number of pairs that are tried at other frame rates and larger lags where no pair can be registered."""
PAIR_S = 0.25
"""Approximate computing time of the registration of a pair, seconds, for a recording of ten minutes."""
MIN_LOOKS = 0.02
"""Least weight of appearance in the clearest pair of cameras; below it appearance does not distinguish people."""


@dataclass(frozen=True, eq=False)
class InitialAssociation:
    """First estimate of identities and clocks."""

    person: Ints
    """(T,) person of each tracklet."""
    offset_s: Floats
    """(C,) offset to add to each camera's clock, seconds."""
    graph: ViewGraph | None
    """None where only appearance was used."""
    guesses: tuple[PairHypothesis, ...] = ()
    """The relative poses of the registered pairs, for the solver."""
    by_joints: tuple[JointRegistration, ...] = ()
    """Registrations by joints of the pairs that tracks did not join."""
    known: Pairs | None = None
    """Evidence on identities from joints and from the user."""
    mirrored: Bools | None = None
    """(T,) whether left and right joints are exchanged in each tracklet; None where that is not known."""
    starts: Starts | None = None
    """Start times of the recordings; None where all clock offsets were searched in full."""
    candidates: Candidates | None = None
    """The pairs of cameras that were tried; None for all."""


@dataclass(frozen=True, eq=False)
class JointEvidence:
    """Input for the registration of cameras by joints."""

    lenses: Sequence[Lens]
    """Lens of every camera."""
    person_height_m: float
    """Mean standing height, metres."""
    rng: np.random.Generator
    """Drives RANSAC."""


def associate_by_ground_tracks(
    cameras: Sequence[CameraTracklets], tracklets: Tracklets, max_lag_s: float, affinity: Mapping[tuple[int, int], Floats],
    executor: Executor | None = None, tell: Progress = silent, joints: JointEvidence | None = None,
    starts: Starts | None = None, candidates: Candidates | None = None, earlier: EarlierPairs | None = None,
    stated: Pairs | None = None,
) -> InitialAssociation:  # fmt: skip
    """Register all pairs by their ground tracks, keep the registrations that agree, and join the tracklets by them.

    Cameras that tracks do not join are registered by joints where there are any.

    Args:
        cameras: all cameras.
        tracklets: of all cameras.
        max_lag_s: largest difference of two clocks that is searched for.
        affinity: evidence of appearance, by pair of cameras; empty where there is none.
        executor: runs the pairs in parallel; one after the other where it is None.
        tell: called for every pair that is done.
        joints: input for joints; None: they are not used.
        starts: start times of the recordings, where they are known already: each pair is searched about them.
        candidates: the pairs that are tried; None: all.
        earlier: registrations of other estimates of the scene: pairs with the same tracks are taken from there.
        stated: corrections of identities by the user.

    Raises:
        RefusalError: no two cameras can be registered.
    """
    jobs = [
        job
        for a, first in enumerate(cameras)
        for b, second in enumerate(cameras)
        if a < b and first.tracks is not None and second.tracks is not None
        if candidates is None or (a, b) in candidates
        if (job := _job(a, b, first.tracks, second.tracks, max_lag_s, affinity.get((a, b)), starts)) is not None
    ]
    earlier = earlier_pairs() if earlier is None else earlier
    keys = [(cameras[job.a].name, cameras[job.b].name) for job in jobs]
    found = earlier.side_by_side(_registered, jobs, keys, executor, tell, "registering camera pairs", job_s=PAIR_S)
    pairs = [replace(pair, a=job.a, b=job.b) for pair, job in zip(found, jobs, strict=True)]
    graph = _with_starts(view_graph(pairs, len(cameras)), starts)
    by_joints = [] if joints is None else _registered_by_joints(cameras, graph, joints, executor, tell, candidates)
    graph = add_joint_edges(graph, by_joints)
    if len(graph.groups[0]) < 2:
        raise RefusalError(_no_pair(cameras, graph, max_lag_s, starts))
    used = [one for one in by_joints if one.used]
    known = joined_pairs(known_pairs(tracklets, used) if used else None, stated)
    person = cluster_by_pairwise_poses(tracklets, [camera.tracks for camera in cameras], graph, affinity, known)
    guesses = [_hypothesis(edge, cameras[edge.a].level, cameras[edge.b].level) for edge in graph.edges if edge.used]
    if joints is not None:
        guesses += [joint_hypothesis(one, cameras[one.a], cameras[one.b], joints.person_height_m) for one in used]
    mirrored = find_mirrored_tracklets(tracklets, used) if used else None
    told_guesses = tuple(guess for guess in guesses if guess is not None)
    return InitialAssociation(
        person, graph.offset_s, graph, told_guesses, tuple(by_joints), known, mirrored, starts, candidates
    )


def _registered_by_joints(
    cameras: Sequence[CameraTracklets], graph: ViewGraph, joints: JointEvidence, executor: Executor | None, tell: Progress,
    candidates: Candidates | None,
) -> list[JointRegistration]:  # fmt: skip
    """Register the pairs that tracks did not join by their joints, where there are enough."""
    if len(graph.groups) < 2 or sum(len(camera.seen.keypoints) > 0 for camera in cameras) < 2:
        return []
    seen = [
        joint_tracks(camera.seen.keypoints, lens, camera.clock) for camera, lens in zip(cameras, joints.lenses, strict=True)
    ]
    return register_by_joints(seen, graph, joints.rng, executor, tell, candidates)


def _hypothesis(edge: Edge, level_a: Level | None, level_b: Level | None) -> PairHypothesis | None:
    """Return the motion between two cameras in space, from the motion between their grounds."""
    if edge.guess is None or level_a is None or level_b is None:
        return None
    scale = abs(edge.guess.turn)
    c, s = edge.guess.turn.real / scale, edge.guess.turn.imag / scale
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    # Each camera has its own scale of metres: the baseline is in their geometric mean.
    shift = np.array([edge.guess.shift.real, edge.guess.shift.imag, scale * level_a.height - level_b.height]) / np.sqrt(scale)
    R_lb = level_b.R_lc
    return PairHypothesis(
        edge.a, edge.b, R_lb.T @ turn @ level_a.R_lc, R_lb.T @ shift, "tracks", edge.guess.samples, edge.guess.samples
    )


@dataclass(frozen=True, eq=False)
class _Job:
    a: int
    b: int
    tracks_a: GroundTracks
    tracks_b: GroundTracks
    max_lag_s: float
    affinity: Floats | None
    lag: int = 0
    """Lag in grid steps that is known already: the search is about it."""


def _job(
    a: int, b: int, first: GroundTracks, second: GroundTracks, max_lag_s: float, affinity: Floats | None, starts: Starts | None
) -> _Job | None:
    """Return the search for a pair; None where the start times of its recordings are unknown and may be hours apart."""
    if starts is None:
        return _Job(a, b, first, second, max_lag_s, affinity)
    lag = starts.lag_steps(a, b)
    if lag is not None:
        return _Job(a, b, first, shifted(second, lag), min(NEAR_S, max_lag_s), affinity, lag)
    return None if starts.far else _Job(a, b, first, second, max_lag_s, affinity)


EarlierPairs = EarlierResults[_Job, PairRegistration]
"""Earlier results by the names of the two cameras."""


def earlier_pairs() -> EarlierPairs:
    """Return no pairs: earlier pairs exist only after the first estimate."""
    return EarlierPairs(_same_pair)


def _same_pair(one: _Job, other: _Job) -> bool:
    """Check whether two jobs of one pair have the same result, for any numbers of the cameras."""
    same_tracks = one.tracks_a is other.tracks_a and one.tracks_b is other.tracks_b
    searched = (one.max_lag_s, one.lag) == (other.max_lag_s, other.lag)
    return same_tracks and searched and one.affinity is None and other.affinity is None


def _registered(job: _Job) -> PairRegistration:
    return with_lag(register_pair(job.a, job.b, job.tracks_a, job.tracks_b, job.max_lag_s, job.affinity), job.lag)


def _with_starts(graph: ViewGraph, starts: Starts | None) -> ViewGraph:
    """Add the recordings' start times to the offsets of the graph's groups, so that cameras of different groups compare."""
    if starts is None:
        return graph
    offset_s = graph.offset_s.copy()
    for group in graph.groups:
        offset_s[list(group)] += starts.offset_s[group[0]]
    return replace(graph, offset_s=offset_s)


def _no_pair(
    cameras: Sequence[CameraTracklets], graph: ViewGraph, max_lag_s: float, starts: Starts | None = None
) -> list[Finding]:
    """Return the findings that explain why no two cameras can be registered."""
    found = [refusal("no_pair_registered")]
    found += [] if starts is None else [replace(one, severity="refusal") for one in starts.doubts.values()]
    found += [empty for camera in cameras if (empty := sees_too_little(camera)) is not None]
    edges = sorted((edge for edge in graph.edges if edge.guess), key=lambda edge: -edge.guess.merit if edge.guess else 0.0)
    for number, edge in enumerate(edges[:6]):
        a, b = cameras[edge.a], cameras[edge.b]
        better = what_would_fit(a, b, max_lag_s) if number < TRIED and starts is None else None
        found.append(refusal("pair_unregistered", a.name, b.name, **fit_of(edge), **fixed_by(better)))
    return found


def associate_by_appearance(
    cameras: Sequence[CameraTracklets], tracklets: Tracklets, appearance: AppearanceAffinity | None,
    stated: Pairs | None = None,
) -> InitialAssociation:  # fmt: skip
    """Join tracklets by appearance alone, as the paper does: those matched at most of the instants at which both were seen.

    Raises:
        RefusalError: appearance distinguishes no people.
    """
    if appearance is None:
        raise RefusalError(refusal("no_embeddings"))
    clearest = max((pair.usefulness.weight for pair in appearance.pairs.values() if pair.usefulness is not None), default=0.0)
    if clearest < MIN_LOOKS:
        raise RefusalError(refusal("embeddings_useless"))
    person = cluster_by_appearance_votes(tracklets, appearance, stated)
    return InitialAssociation(person, np.zeros(len(cameras)), None)
