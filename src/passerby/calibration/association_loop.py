"""Association and solver in turns: identities give a rig, the rig gives better identities, until both settle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.associate import Tracklets, cluster_by_rig, compared_pairs
from passerby.association.attachment import Attached, attach_cameras
from passerby.association.camera_tracklets import CameraTracklets, EarlierTracklets, build_tracklets, earlier_tracklets
from passerby.association.candidates import ALL_PAIRS_UP_TO, Candidates, find_candidates, stated_candidates
from passerby.association.clocks.frame_rate import estimate_frame_rate
from passerby.association.clocks.offsets import (
    clock_corrections,
    snap_to_whole_frames,
)
from passerby.association.clocks.starts import FILE_CLOCKS, FULL_SEARCH_S, NEAR_S, Starts, find_starts
from passerby.association.focal_search import search_focals_by_tracks
from passerby.association.initial_association import (
    EarlierPairs,
    InitialAssociation,
    JointEvidence,
    associate_by_appearance,
    associate_by_ground_tracks,
    earlier_pairs,
)
from passerby.association.joints.joint_tracks import swap_left_and_right
from passerby.association.result import Association
from passerby.association.stated import stated_pairs
from passerby.calibration.association_run import AssociationOptions, AssociationRun, with_lenses_of
from passerby.calibration.kept_tracklets import KeptTracklets
from passerby.calibration.rig_solver import RigSolver
from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.common.parallel import MAX_PROCESSES, pays
from passerby.common.progress import Progress, silent, tell_note
from passerby.core.association_figures import AssociationRound
from passerby.core.cameras import Rig
from passerby.core.observations import Clock, Observations
from passerby.core.solution import Solution
from passerby.core.unknown_focals import begin_with, needs_focal_search
from passerby.findings.refusals import findings_of

MAX_ROUNDS = 4
SEARCHED_ROUNDS = 2
"""Rounds in which cameras without a pose are searched by the rig's people."""
SETTLED = 0.98
"""Identities have settled when so many of the box pairs that are one person were so a round before, and the other way round."""


@dataclass(frozen=True, eq=False)
class EarlierAssociation:
    """What other estimates of a scene have found of single cameras and of pairs, used again where their input is the same."""

    tracklets: EarlierTracklets = field(default_factory=earlier_tracklets)
    pairs: EarlierPairs = field(default_factory=earlier_pairs)


def solve_with_unknown_identities(
    rig: Rig, observations: Observations, options: AssociationOptions, solve: RigSolver, rng: np.random.Generator,
    *, tell: Progress = silent, executor: Executor | None = None, earlier: EarlierAssociation | None = None,
    kept: KeptTracklets | None = None,
) -> tuple[Solution, Association]:  # fmt: skip
    """Calibrate cameras from people without identities.

    Args:
        rig: names and lenses.
        observations: identities are tracklet numbers of each camera's own, or -1 for detections; without clocks the frame
            numbers are counted alike.
        options: see `AssociationOptions`.
        solve: the solver.
        rng: drives sampling.
        tell: called with each stage as it begins.
        executor: prepares cameras and registers pairs of them in parallel.
        earlier: what other estimates of the scene have found of single cameras and pairs; this one's is added.
        kept: tracklets of earlier runs, and of this one for the next.

    Returns:
        The solution, refused where the evidence does not do, and the association that it uses.
    """
    earlier = earlier or EarlierAssociation()
    search_s = options.search_s if observations.clocks else 0.0
    clocks = _clocks(rig, observations, options.person_height_m, rng)
    if kept is not None:
        kept.tell_of_others(observations, clocks, tell)
    if kept is not None and kept.has_all(observations, clocks) and not pays(0, len(rig), MAX_PROCESSES):
        executor = None  # its processes would take longer to start than the rest takes
    cameras = build_tracklets(
        rig, observations, clocks, options.person_height_m, rng, executor, tell=tell, earlier=earlier.tracklets, kept=kept,
        not_people=options.stated.not_people,
    )  # fmt: skip
    if needs_focal_search(rig) and options.mode != "appearance":
        at_start, near_s = _from_their_starts(cameras, search_s, options)
        rig = search_focals_by_tracks(rig, at_start, near_s, options.person_height_m, rng, tell, executor)
        cameras = with_lenses_of(cameras, rig, options.person_height_m)
    candidates = _candidates(cameras, search_s, options, tell)
    tell("appearance")
    appearance = AppearanceAffinity.of(cameras, rng, candidates) if options.mode != "trajectory" else None
    tracklets = Tracklets.of(cameras)
    run = AssociationRun(rig, cameras, tracklets, appearance, options)
    stated = stated_pairs(tracklets, cameras, options.stated)
    try:
        if options.mode == "appearance":
            initial = associate_by_appearance(cameras, tracklets, appearance, stated)
        else:
            affinity = appearance.affinity() if appearance else {}
            joints = JointEvidence([camera.lens for camera in rig], options.person_height_m, rng)
            starts = _starts(cameras, search_s, options, affinity, tell)
            initial = associate_by_ground_tracks(
                cameras,
                tracklets,
                search_s,
                affinity,
                executor,
                tell,
                joints,
                starts,
                candidates,
                earlier.pairs,
                stated,
            )
            run = replace(run, cameras=_unmirrored(cameras, tracklets, initial))
            if candidates is not None and initial.graph is not None:
                pairs = compared_pairs(initial.graph, len(rig), candidates)
                run = replace(run, compared=tuple((rig.names[a], rig.names[b]) for a, b in pairs))
            _tell_pairs(tell, initial)
    except EvidenceError as error:
        nobody = run.association(np.arange(len(tracklets.start_s)), np.zeros(len(cameras)), None, None, [])
        return Solution("association", rig, "refused", findings_of(error)), nobody
    return _alternate(run, initial, solve, refine=search_s > 0, tell=tell, executor=executor)


def _candidates(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions, tell: Progress
) -> Candidates | None:
    """The pairs of cameras that are compared; None: all, as in small scenes, and where recordings begin at any times."""
    names = [camera.name for camera in cameras]
    if options.groups:
        candidates = stated_candidates(names, options.groups)
    elif (
        len(cameras) <= ALL_PAIRS_UP_TO
        or max([search_s, *_by_file_clocks(options)]) > FULL_SEARCH_S
        or options.mode == "appearance"
    ):
        return None
    else:
        tell("candidate pairs")
        candidates = find_candidates([camera.tracks for camera in cameras], search_s)
    tried = candidates.tried
    tell_note(tell, f"{tried.tried} of {tried.possible} pairs of cameras are tried")
    return candidates


def _starts(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions,
    affinity: Mapping[tuple[int, int], Floats], tell: Progress,
) -> Starts | None:  # fmt: skip
    """When the recordings began; None where nothing was measured and all clock offsets can be searched in full."""
    if search_s <= 0 or (search_s <= FULL_SEARCH_S and not options.measured):
        return None
    tell("starts of the recordings")
    return find_starts(cameras, search_s, options.measured, affinity)


def _by_file_clocks(options: AssociationOptions) -> list[float]:
    """How far recordings begin apart by the clocks of their files, seconds."""
    return [abs(one.offset_s) for one in options.measured if one.found_by in FILE_CLOCKS]


def _from_their_starts(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions
) -> tuple[Sequence[CameraTracklets], float]:
    """The cameras with clocks set by what is significant of their starts, and what is left to search, seconds."""
    by_clocks = _by_file_clocks(options)
    if search_s <= 0 or (search_s <= FULL_SEARCH_S and not by_clocks):
        return cameras, search_s
    # Activity, which has to agree with the files' clocks, is compared above `FULL_SEARCH_S` only.
    searched_s = search_s if search_s > FULL_SEARCH_S else max(FULL_SEARCH_S, *by_clocks) + search_s
    starts = find_starts(cameras, searched_s, options.measured, by_tracks=False)
    moved = [
        replace(camera, clock=replace(camera.clock, offset_s=float(offset)))
        for camera, offset in zip(cameras, starts.offset_s, strict=True)
    ]
    return moved, NEAR_S if search_s > FULL_SEARCH_S else search_s


def _tell_pairs(tell: Progress, initial: InitialAssociation) -> None:
    """How many pairs of cameras could be registered."""
    if initial.graph is not None:
        edges = initial.graph.edges
        tell_note(tell, f"{sum(edge.used for edge in edges)} pairs of cameras used, of {len(edges)} that could be registered")


def _unmirrored(
    cameras: Sequence[CameraTracklets], tracklets: Tracklets, initial: InitialAssociation
) -> Sequence[CameraTracklets]:
    """The cameras, left and right set right in the joints."""
    if initial.mirrored is None or not initial.mirrored.any():
        return cameras
    out = []
    for c, camera in enumerate(cameras):
        joints = swap_left_and_right(camera.seen.keypoints, initial.mirrored[tracklets.first[c] : tracklets.first[c + 1]])
        out.append(replace(camera, seen=replace(camera.seen, keypoints=joints)))
    return out


def _clocks(rig: Rig, observations: Observations, person_height_m: float, rng: np.random.Generator) -> dict[str, Clock]:
    """Every camera's clock; where no frame rate is known, one at which people walk as people do."""
    known, fps = observations.clocks, observations.fps
    if all(name in known for name in rig.names):
        return dict(known)
    common = Clock(fps if fps is not None else estimate_frame_rate(rig, observations, person_height_m, rng))
    return {name: known.get(name, common) for name in rig.names}


def _alternate(
    run: AssociationRun,
    initial: InitialAssociation,
    solve: RigSolver,
    *,
    refine: bool,
    tell: Progress,
    executor: Executor | None = None,
) -> tuple[Solution, Association]:
    """Solve and associate in turns."""
    person, offset_s = initial.person, initial.offset_s
    rounds: list[AssociationRound] = []
    solution: Solution | None = None
    attached: dict[int, Attached] = {}
    lenses = run.rig if any(camera.lens.uncalibrated for camera in run.rig) else None
    for number in range(MAX_ROUNDS):
        tell(f"round {number + 1}")
        rows = run.rows(person, offset_s, solution)
        instants, known = run.instants(run.identified(rows), offset_s), run.known(rows).people
        solution = solve(instants, initial.guesses, passing=True, refine_time=refine, lenses=lenses, known=known)
        if solution.verdict == "refused":
            return solution, run.association(person, offset_s, None, initial, rounds)
        offset_s = offset_s + clock_corrections(solution)[0]
        if lenses is not None:
            run, lenses = run.with_lenses(solution.rig), begin_with(lenses, solution.rig)
        poses = [camera.pose for camera in solution.rig]
        before = person
        if initial.graph is not None:
            lost = run.lost(solution, initial.graph, attached, search=number < SEARCHED_ROUNDS)
            first = run.tracklets.first
            own = [person[first[c] : first[c + 1]] for c in range(len(poses))]
            found = attach_cameras(
                run.cameras, poses, own, offset_s, run.options.person_height_m, lost, initial.candidates,
                executor if initial.candidates is not None else None, tell,
            )  # fmt: skip
            attached |= found
            for c, one in found.items():
                poses[c], offset_s[c] = one.pose, one.offset_s
            affinity = run.appearance.affinity() if run.appearance else None
            person_height_m = run.options.person_height_m
            person = cluster_by_rig(
                run.tracklets, run.cameras, initial.graph, poses, offset_s, person_height_m, affinity, initial.known,
                initial.candidates,
            )  # fmt: skip
        same = _alike(before, person)
        rounds.append(AssociationRound(registered=sum(pose is not None for pose in poses), unchanged=same))
        tell_note(tell, f"{rounds[-1].registered} of {len(poses)} cameras have poses")
        if same > SETTLED:
            break
    tell("solving")
    rows = run.rows(person, offset_s, solution)
    identified, known = run.identified(rows), run.known(rows).people
    solution = solve(
        run.instants(identified, offset_s), initial.guesses, passing=False, refine_time=refine, lenses=lenses, known=known
    )
    if refine and solution.verdict != "refused":
        correction_s, sigma_s = clock_corrections(solution)
        offset_s = offset_s + correction_s
        in_step = snap_to_whole_frames(offset_s, sigma_s, np.array([camera.clock.fps for camera in run.cameras]))
        if in_step is not None:
            offset_s = in_step
            solution = solve(
                run.instants(identified, offset_s), initial.guesses, passing=False, refine_time=False, lenses=lenses,
                known=known,
            )  # fmt: skip
        return solution, run.association(person, offset_s, solution, initial, rounds, sigma_s, attached)
    return solution, run.association(person, offset_s, solution, initial, rounds, attached=attached)


def _alike(before: Ints, after: Ints) -> float:
    """How alike two groupings of tracklets are: pairs together in both, as a share of those in either."""

    def pairs(label: Ints) -> float:
        count = np.bincount(label).astype(np.float64)
        return float((count * (count - 1)).sum() / 2)

    _, both = np.unique(np.column_stack([before, after]), axis=0, return_inverse=True)
    common = pairs(both.ravel())
    return common / max(pairs(before) + pairs(after) - common, 1.0)
