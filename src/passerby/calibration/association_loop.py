"""Association and solver in turns: who is who makes a rig, the rig tells better who is who, until both settle."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.associate import Tracklets, cluster_by_rig
from passerby.association.attachment import Attached, attach_cameras
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets, with_lens
from passerby.association.candidates import ALL_PAIRS_UP_TO, Candidates, find_candidates, stated_candidates
from passerby.association.cleaning import reassign_detections
from passerby.association.clocks.drift import Drift, clock_drifts, drift_findings
from passerby.association.clocks.frame_rate import estimate_frame_rate
from passerby.association.clocks.offsets import (
    clock_corrections,
    clocks_with,
    relative_to_reference,
    snap_to_whole_frames,
    synchronise,
)
from passerby.association.clocks.starts import FULL_SEARCH_S, NEAR_S, MeasuredStart, Starts, contradicted_starts, find_starts
from passerby.association.figures import association_figures
from passerby.association.focal_search import search_focals_by_tracks
from passerby.association.graph import ViewGraph
from passerby.association.initial_association import (
    InitialAssociation,
    JointEvidence,
    associate_by_appearance,
    associate_by_ground_tracks,
)
from passerby.association.joints.joint_graph import joined_by_joints
from passerby.association.joints.joint_tracks import swap_left_and_right
from passerby.association.registration_failures import nobody_walks, unregistered_cameras
from passerby.association.result import Association
from passerby.calibration.kept_tracklets import KeptTracklets
from passerby.calibration.pointed_heights import PointedHeights, identity_at, pointed_heights
from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.common.parallel import MAX_PROCESSES, pays
from passerby.common.progress import Progress, silent, tell_note
from passerby.core.association_figures import AssociationRound
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Clock, Observations, once_in_frame
from passerby.core.pointing import PointedPerson
from passerby.core.scale_cues import PersonHeight
from passerby.core.solution import Solution
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.core.synchronisation import common_time_steps
from passerby.core.unknown_focals import begin_with, needs_focal_search
from passerby.findings.finding import Finding, notice
from passerby.findings.refusals import findings_of
from passerby.geometry.relative_pose import PairHypothesis


class RigSolver(Protocol):
    """Solves a rig."""

    def __call__(
        self,
        synchronised: Observations,
        guesses: Sequence[PairHypothesis],
        *,
        passing: bool,
        refine_time: bool,
        lenses: Rig | None = None,
        known: Sequence[PersonHeight] = (),
    ) -> Solution:
        """The rig from people at common time steps, refused where the evidence does not do.

        A passing one may rest on a part of the evidence; the clocks' errors are unknowns of it where they are refined. `lenses`
        are those to begin with, where they are known better than at first. `known` are heights of these identities.
        """


MAX_ROUNDS = 4
SEARCHED_ROUNDS, AGAIN_S = 2, 0.5
"""Rounds in which cameras without a pose are searched by the rig's people; and how far the offset of one that was found so may
be off in the next."""
SETTLED = 0.98
"""Identities have settled when so many of the box pairs that are one person were so a round before, and the other way round."""


@dataclass(frozen=True)
class AssociationOptions:
    """How identities are found."""

    mode: str = "combined"
    """combined | trajectory | appearance"""
    search_s: float = 5.0
    """Largest difference of two cameras' clocks that is searched for, seconds; 0 takes them as in step."""
    person_height_m: float = PERSON_HEIGHT_M
    """Mean standing height, metres."""
    pointed: tuple[PointedPerson, ...] = ()
    """People of known height, each named by a pixel."""
    measured: tuple[MeasuredStart, ...] = ()
    """Differences of two cameras' clocks that something else than people tells."""
    groups: tuple[tuple[str, ...], ...] = ()
    """Names of cameras that may share ground, where the user says so: only cameras of one group are compared."""


def solve_with_unknown_identities(
    rig: Rig, observations: Observations, options: AssociationOptions, solve: RigSolver, rng: np.random.Generator,
    *, tell: Progress = silent, executor: Executor | None = None, kept: KeptTracklets | None = None,
) -> tuple[Solution, Association]:  # fmt: skip
    """Calibrate cameras from people whom nobody has identified.

    Args:
        rig: names and lenses.
        observations: identities are tracklet numbers of each camera's own, or -1 for detections; without clocks the frame
            numbers are counted alike.
        options: see `AssociationOptions`.
        solve: the solver.
        rng: drives sampling.
        tell: told each stage as it begins.
        executor: prepares cameras and registers pairs of them in parallel.
        kept: tracklets of earlier runs, and of this one for the next.

    Returns:
        The solution, refused where the evidence does not do, and the association that it rests on.
    """
    search_s = options.search_s if observations.clocks else 0.0
    clocks = _clocks(rig, observations, options.person_height_m, rng)
    if kept is not None and kept.has_all(observations, clocks) and not pays(0, len(rig), MAX_PROCESSES):
        executor = None  # its processes would take longer to start than the rest takes
    cameras = build_tracklets(rig, observations, clocks, options.person_height_m, rng, executor, tell=tell, kept=kept)
    if needs_focal_search(rig) and options.mode != "appearance":
        at_start, near_s = _from_their_starts(cameras, search_s, options)
        rig = search_focals_by_tracks(rig, at_start, near_s, options.person_height_m, rng, tell, executor)
        cameras = _with_lenses(cameras, rig, options.person_height_m)
    candidates = _candidates(cameras, search_s, options, tell)
    tell("appearance")
    appearance = AppearanceAffinity.of(cameras, rng, candidates) if options.mode != "trajectory" else None
    tracklets = Tracklets.of(cameras)
    run = _Run(rig, cameras, tracklets, appearance, options)
    try:
        if options.mode == "appearance":
            initial = associate_by_appearance(cameras, tracklets, appearance)
        else:
            affinity = appearance.affinity() if appearance else {}
            joints = JointEvidence([camera.lens for camera in rig], options.person_height_m, rng)
            starts = _starts(cameras, search_s, options, affinity, tell)
            initial = associate_by_ground_tracks(
                cameras, tracklets, search_s, affinity, executor, tell, joints, starts, candidates
            )
            run = replace(run, cameras=_unmirrored(cameras, tracklets, initial))
            _tell_pairs(tell, initial)
    except EvidenceError as error:
        nobody = run.association(np.arange(len(tracklets.start_s)), np.zeros(len(cameras)), None, None, [])
        return Solution("association", rig, "refused", findings_of(error)), nobody
    return _alternate(run, initial, solve, refine=search_s > 0, tell=tell)


def _candidates(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions, tell: Progress
) -> Candidates | None:
    """The pairs of cameras that are compared; None: all, as in small scenes, and where recordings begin at any times."""
    names = [camera.name for camera in cameras]
    if options.groups:
        candidates = stated_candidates(names, options.groups)
    elif len(cameras) <= ALL_PAIRS_UP_TO or search_s > FULL_SEARCH_S or options.mode == "appearance":
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


def _from_their_starts(
    cameras: Sequence[CameraTracklets], search_s: float, options: AssociationOptions
) -> tuple[Sequence[CameraTracklets], float]:
    """The cameras with clocks set by what is beyond doubt of their starts, and what is left to search, seconds."""
    if search_s <= FULL_SEARCH_S:
        return cameras, search_s
    starts = find_starts(cameras, search_s, options.measured, by_tracks=False)
    moved = [
        replace(camera, clock=replace(camera.clock, offset_s=float(offset)))
        for camera, offset in zip(cameras, starts.offset_s, strict=True)
    ]
    return moved, NEAR_S


def _with_lenses(cameras: Sequence[CameraTracklets], rig: Rig, person_height_m: float) -> list[CameraTracklets]:
    """The cameras' people by the lenses of a rig."""
    rngs = np.random.default_rng(0).spawn(len(cameras))
    return [
        with_lens(one, camera.lens, person_height_m, rng) for one, camera, rng in zip(cameras, rig, rngs, strict=True)
    ]  # fmt: skip


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


@dataclass(frozen=True, eq=False)
class _Run:
    """What stays the same over the rounds."""

    rig: Rig
    cameras: Sequence[CameraTracklets]
    tracklets: Tracklets
    appearance: AppearanceAffinity | None
    options: AssociationOptions

    def with_lenses(self, found: Rig) -> _Run:
        """The same people by the lenses of a solution, where these were found with it."""
        cameras = tuple(
            replace(old, lens=replace(new.lens, uncalibrated=True)) if old.lens.uncalibrated and new.pose else old
            for old, new in zip(self.rig, found, strict=True)
        )
        rig = replace(self.rig, cameras=cameras)
        return replace(self, rig=rig, cameras=_with_lenses(self.cameras, rig, self.options.person_height_m))

    def rows(self, person: Ints, offset_s: Floats, solution: Solution | None) -> list[tuple[Ints, Ints]]:
        """The person of every box and of every set of joints, camera by camera; -1 for nobody."""
        out = []
        for c, camera in enumerate(self.cameras):
            own = person[self.tracklets.first[c] : self.tracklets.first[c + 1]]
            parts = []
            for part in (camera.seen.boxes, camera.seen.keypoints):
                known = part.identity > UNKNOWN
                column = np.full(len(part), UNKNOWN)
                column[known] = own[part.identity[known]]
                parts.append(_once(column, part.frame, part.identity))
            out.append((parts[0], parts[1]))
        if solution is None:
            return out
        bodies = [camera.bodies for camera in self.cameras]
        before = [
            np.where(seen.from_joints, _at(joints, seen.row), _at(boxes, seen.row))
            for seen, (boxes, joints) in zip(bodies, out, strict=True)
        ]
        clocks = clocks_with(self.cameras, offset_s)
        grid = common_time_steps(Observations({camera.name: camera.seen for camera in self.cameras}), clocks).clock
        for (boxes, joints), seen, after in zip(
            out,
            bodies,
            reassign_detections(solution.rig, bodies, before, clocks, grid, self.options.person_height_m),
            strict=True,
        ):
            boxes[seen.row[~seen.from_joints]] = after[~seen.from_joints]
            joints[seen.row[seen.from_joints]] = after[seen.from_joints]
        return [
            (_once(boxes, camera.seen.boxes.frame, boxes), _once(joints, camera.seen.keypoints.frame, joints))
            for camera, (boxes, joints) in zip(self.cameras, out, strict=True)
        ]

    def lost(
        self, solution: Solution, graph: ViewGraph, before: Mapping[int, Attached], *, search: bool
    ) -> dict[int, tuple[float, float]]:
        """Cameras without a pose that no pair registers, by number: how far which clock offset is to be searched.

        One that was placed `before` is placed again near its offset; the others are tried where a `search` is wanted.
        """
        alone = {group[0] for group in graph.groups if len(group) == 1}
        without = {c for c, camera in enumerate(solution.rig) if camera.pose is None} & alone
        search_s = self.options.search_s
        again = {c: (min(search_s, AGAIN_S), before[c].offset_s) for c in sorted(without & set(before))}
        return again | (dict.fromkeys(sorted(without - set(before)), (search_s, 0.0)) if search else {})

    def known(self, rows: Sequence[tuple[Ints, Ints]]) -> PointedHeights:
        """The heights of the people at whom the user pointed, by the identities that `identified` gives them."""
        number = {camera.name: c for c, camera in enumerate(self.cameras)}

        def identify(one: PointedPerson) -> int | None:
            if one.camera not in number:
                return None
            c = number[one.camera]
            person = identity_at(one, self.cameras[c].seen, *rows[c])
            return None if person is None else person + 1

        return pointed_heights(self.options.pointed, identify)

    def identified(self, rows: Sequence[tuple[Ints, Ints]]) -> Observations:
        """The people who are somebody, in each camera's own frames."""
        cameras = {}
        for camera, (boxes, joints) in zip(self.cameras, rows, strict=True):
            named = replace(camera.seen.boxes, identity=boxes + 1), replace(camera.seen.keypoints, identity=joints + 1)
            cameras[camera.name] = CameraObservations(named[0].take(boxes > UNKNOWN), named[1].take(joints > UNKNOWN))
        return Observations(cameras)

    def instants(self, identified: Observations, offset_s: Floats) -> Observations:
        """The same at instants that all cameras share."""
        return synchronise(self.rig, self.cameras, identified, offset_s)

    def association(
        self, person: Ints, offset_s: Floats, solution: Solution | None, initial: InitialAssociation | None,
        rounds: list[AssociationRound], sigma_s: Floats | None = None, attached: Collection[int] = (),
    ) -> Association:  # fmt: skip
        """The result; the first registered camera's clock is the rig's. `attached`: cameras that the rig's people placed."""
        offset_s = relative_to_reference(offset_s, solution.rig if solution else None)
        rows = self.rows(person, offset_s, solution)
        identified, heights = self.identified(rows), self.known(rows)
        known = {} if sigma_s is None else dict(zip(self.rig.names, sigma_s.tolist(), strict=True))
        figures = association_figures(self.cameras, self.tracklets, self.appearance, initial, person, offset_s)
        graph = initial.graph if initial is not None else None
        drifts = {} if solution is None else self._drifts(person, offset_s, solution)
        return Association(
            identified, self.instants(identified, offset_s), clocks_with(self.cameras, offset_s),
            {name: sigma for name, sigma in known.items() if np.isfinite(sigma)}, replace(figures, rounds=tuple(rounds)),
            {} if graph is None or initial is None
            else unregistered_cameras(self.cameras, graph, self.options.search_s, starts=initial.starts),
            *self._told(solution, initial, drifts, offset_s, attached),
            {self.cameras[c].name: drift for c, drift in drifts.items()},
            heights.people, heights.findings,
        )  # fmt: skip

    def _drifts(self, person: Ints, offset_s: Floats, solution: Solution) -> dict[int, Drift]:
        """How the clocks drift, by the rig."""
        first, poses = self.tracklets.first, [camera.pose for camera in solution.rig]
        own = [person[first[c] : first[c + 1]] for c in range(len(self.cameras))]
        return clock_drifts(self.cameras, poses, own, offset_s)

    def _told(
        self,
        solution: Solution | None,
        initial: InitialAssociation | None,
        drifts: Mapping[int, Drift],
        offset_s: Floats,
        attached: Collection[int],
    ) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
        """What speaks against relying on the association, and what is odd about it."""
        if solution is None:
            return (), ()
        poses = [camera.pose for camera in solution.rig]
        doubts, notices = drift_findings(self.cameras, drifts)
        graph = initial.graph if initial is not None else None
        walked = graph is not None and any(edge.used for edge in graph.edges)
        joined = joined_by_joints(self.cameras, initial.by_joints) if initial is not None else []
        joined += [notice("registered_by_rig", self.cameras[c].name) for c in sorted(attached) if poses[c] is not None]
        if initial is not None and initial.starts is not None:
            registered = [pose is not None for pose in poses]
            contradicted = contradicted_starts(initial.starts, self.rig.names, offset_s, registered)
            notices = [*initial.starts.notices, *contradicted, *notices]
        return (*(nobody_walks(self.cameras, poses) if walked else ()), *doubts), (*joined, *notices)


def _at(column: Ints, row: Ints) -> Ints:
    """The column at the rows, -1 where it is too short (the rows are of another column there)."""
    padded = np.append(column, UNKNOWN)
    return np.asarray(padded[np.minimum(row, len(column))])


def _once(person: Ints, frame: Ints, tracklet: Ints) -> Ints:
    """Everybody once in a frame: of two boxes the one of the longer tracklet keeps the name."""
    length = np.bincount(tracklet[tracklet > UNKNOWN], minlength=1)
    long = np.where(tracklet > UNKNOWN, length[np.maximum(tracklet, 0)], 0)
    kept = np.isin(np.arange(len(person)), once_in_frame(frame, person, -long))
    return np.where(kept, person, UNKNOWN)


def _alternate(
    run: _Run, initial: InitialAssociation, solve: RigSolver, *, refine: bool, tell: Progress
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
            found = attach_cameras(run.cameras, poses, own, offset_s, run.options.person_height_m, lost)
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
