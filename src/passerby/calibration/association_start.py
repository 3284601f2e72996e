"""The start of association: tracklets, registered pairs of cameras, and the first identities and clocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.associate import Tracklets, compared_pairs
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.candidates import ALL_PAIRS_UP_TO, Candidates, find_candidates, stated_candidates
from passerby.association.clocks.frame_rate import estimate_frame_rate
from passerby.association.clocks.starts import FILE_CLOCKS, FULL_SEARCH_S, NEAR_S, Starts, find_starts
from passerby.association.focal_search import search_focals_by_tracks
from passerby.association.initial_association import (
    InitialAssociation,
    JointEvidence,
    associate_by_appearance,
    associate_by_ground_tracks,
)
from passerby.association.joints.joint_tracks import swap_left_and_right
from passerby.association.stated import stated_pairs
from passerby.calibration.association_run import AssociationOptions, AssociationRun, with_lenses_of
from passerby.calibration.run import CalibrationRun
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError
from passerby.common.parallel import MAX_PROCESSES, pays
from passerby.common.progress import Progress, tell_note
from passerby.core.cameras import Rig
from passerby.core.observations import Clock, Observations
from passerby.core.unknown_focals import needs_focal_search
from passerby.findings.finding import Finding
from passerby.findings.ranking import findings_of


@dataclass(frozen=True, eq=False)
class AssociationStart:
    """The initial state of the rounds of association and solver."""

    run: AssociationRun
    initial: InitialAssociation | None
    """None if no first association was found."""
    refusal: tuple[Finding, ...] = ()
    """The reasons why none was found."""


def start_association(
    run: CalibrationRun, rig: Rig, observations: Observations, options: AssociationOptions, rng: np.random.Generator
) -> AssociationStart:
    """Make tracklets of each camera, register pairs of cameras by them, and find the first identities and clocks.

    Args:
        run: the scene and its options.
        rig: names and lenses.
        observations: identities are each camera's own tracklet numbers, or -1 for detections; without clocks, equal frame
            numbers are simultaneous in all cameras.
        options: options of the association; with a `search_s` of 0, no clock offset is searched for.
        rng: random numbers for sampling.
    """
    tell, kept, executor = run.progress, run.kept, run.executor
    clocks = _clocks(rig, observations, options.person_height_m, rng)
    if kept is not None:
        kept.tell_of_others(observations, clocks, tell)
    if kept is not None and kept.has_all(observations, clocks) and not pays(0, len(rig), MAX_PROCESSES):
        executor = None  # starting its processes would take longer than the remaining work
    cameras = build_tracklets(
        rig, observations, clocks, options.person_height_m, rng, executor, tell=tell, earlier=run.earlier.tracklets, kept=kept,
        not_people=options.stated.not_people,
    )  # fmt: skip
    if needs_focal_search(rig) and options.mode != "appearance":
        at_start, near_s = _set_by_measured_starts(cameras, options.search_s, options)
        rig = search_focals_by_tracks(rig, at_start, near_s, options.person_height_m, rng, tell, executor)
        cameras = with_lenses_of(cameras, rig, options.person_height_m)
    candidates = _find_candidates(cameras, options.search_s, options, tell)
    tell("appearance")
    appearance = AppearanceAffinity.of(cameras, rng, candidates) if options.mode != "trajectory" else None
    tracklets = Tracklets.of(cameras)
    found = AssociationRun(rig, cameras, tracklets, appearance, options)
    stated = stated_pairs(tracklets, cameras, options.stated)
    try:
        if options.mode == "appearance":
            return AssociationStart(found, associate_by_appearance(cameras, tracklets, appearance, stated))
        affinity = appearance.affinity() if appearance else {}
        joints = JointEvidence([camera.lens for camera in rig], options.person_height_m, rng)
        starts = _find_starts(cameras, options.search_s, options, affinity, tell)
        initial = associate_by_ground_tracks(
            cameras, tracklets, options.search_s, affinity, executor, tell, joints, starts, candidates, run.earlier.pairs,
            stated,
        )  # fmt: skip
    except EvidenceError as error:
        return AssociationStart(found, None, tuple(findings_of(error)))
    found = replace(found, cameras=_swap_mirrored_joints(cameras, tracklets, initial))
    if candidates is not None and initial.graph is not None:
        pairs = compared_pairs(initial.graph, len(rig), candidates)
        found = replace(found, compared=tuple((rig.names[a], rig.names[b]) for a, b in pairs))
    if initial.graph is not None:
        edges = initial.graph.edges
        tell_note(tell, f"{sum(edge.used for edge in edges)} pairs of cameras used, of {len(edges)} that could be registered")
    return AssociationStart(found, initial)


def _find_candidates(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions, tell: Progress
) -> Candidates | None:
    """Find the pairs of cameras to compare; None: all pairs, in small scenes and where the recordings' starts are unknown."""
    names = [camera.name for camera in cameras]
    if options.groups:
        candidates = stated_candidates(names, options.groups)
    elif (
        len(cameras) <= ALL_PAIRS_UP_TO
        or max([search_s, *_list_file_clocks(options)]) > FULL_SEARCH_S
        or options.mode == "appearance"
    ):
        return None
    else:
        tell("candidate pairs")
        candidates = find_candidates([camera.tracks for camera in cameras], search_s)
    tried = candidates.tried
    tell_note(tell, f"{tried.tried} of {tried.possible} pairs of cameras are tried")
    return candidates


def _find_starts(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions,
    affinity: Mapping[tuple[int, int], Floats], tell: Progress,
) -> Starts | None:  # fmt: skip
    """Find the starts of the recordings; None if none was measured and all clock offsets can be searched in full."""
    if search_s <= 0 or (search_s <= FULL_SEARCH_S and not options.measured):
        return None
    tell("starts of the recordings")
    return find_starts(cameras, search_s, options.measured, affinity)


def _list_file_clocks(options: AssociationOptions) -> list[float]:
    """Return the differences between the starts of recordings by the clocks of their files, seconds."""
    return [abs(one.offset_s) for one in options.measured if one.found_by in FILE_CLOCKS]


def _set_by_measured_starts(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions
) -> tuple[Sequence[CameraTracklets], float]:
    """Set the clocks by the significant starts of the recordings; return the cameras and the offset left to search, seconds."""
    by_clocks = _list_file_clocks(options)
    if search_s <= 0 or (search_s <= FULL_SEARCH_S and not by_clocks):
        return cameras, search_s
    # Activity has to agree with the files' clocks, but is compared above `FULL_SEARCH_S` only.
    searched_s = search_s if search_s > FULL_SEARCH_S else max(FULL_SEARCH_S, *by_clocks) + search_s
    starts = find_starts(cameras, searched_s, options.measured, by_tracks=False)
    moved = [
        replace(camera, clock=replace(camera.clock, offset_s=float(offset)))
        for camera, offset in zip(cameras, starts.offset_s, strict=True)
    ]
    return moved, NEAR_S if search_s > FULL_SEARCH_S else search_s


def _swap_mirrored_joints(
    cameras: Sequence[CameraTracklets], tracklets: Tracklets, initial: InitialAssociation
) -> Sequence[CameraTracklets]:
    """Exchange the left and right joints of mirrored tracklets, and return the cameras."""
    if initial.mirrored is None or not initial.mirrored.any():
        return cameras
    out = []
    for c, camera in enumerate(cameras):
        joints = swap_left_and_right(camera.seen.keypoints, initial.mirrored[tracklets.first[c] : tracklets.first[c + 1]])
        out.append(replace(camera, seen=replace(camera.seen, keypoints=joints)))
    return out


def _clocks(rig: Rig, observations: Observations, person_height_m: float, rng: np.random.Generator) -> dict[str, Clock]:
    """Return each camera's clock; an unknown frame rate is estimated from the speed at which people walk."""
    known, fps = observations.clocks, observations.fps
    if all(name in known for name in rig.names):
        return dict(known)
    common = Clock(fps if fps is not None else estimate_frame_rate(rig, observations, person_height_m, rng))
    return {name: known.get(name, common) for name in rig.names}
