"""Identities are known, the clocks are not: offsets by the tracks of the same people, refined by the solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.clocks.drift import clock_drifts, drift_findings
from passerby.association.clocks.offsets import (
    clock_corrections,
    clocks_with,
    relative_to_reference,
    snap_to_whole_frames,
    synchronise,
)
from passerby.association.clocks.starts import FULL_SEARCH_S, MeasuredStart, contradicted_starts, find_starts
from passerby.association.figures import association_figures
from passerby.association.initial_association import InitialAssociation, associate_by_ground_tracks
from passerby.association.registration_failures import unregistered_cameras
from passerby.association.result import Association
from passerby.calibration.rig_solver import RigSolver
from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Observations
from passerby.core.solution import Solution
from passerby.findings.finding import Finding, notice
from passerby.findings.refusals import findings_of
from passerby.people.sightings import upright_sightings

SOMEBODY_ELSE = -1e9
"""Log-likelihood ratio of two known people being one: they neither vote nor match."""
NEIGHBOURS, ASTRAY = 2, 0.5
"""Boxes on either side, and body heights from their median beyond which a box shows somebody else: in two boxes' time nobody
strays so far from an even walk."""


def solve_with_unknown_offsets(
    rig: Rig, observations: Observations, max_offset_s: float, person_height_m: float, solve: RigSolver,
    rng: np.random.Generator,
    *, measured: Sequence[MeasuredStart] = (), tell: Progress = silent, executor: Executor | None = None,
) -> tuple[Solution, Association]:  # fmt: skip
    """Find the cameras' clocks by people whose identities are known, and solve the rig.

    Args:
        rig: names and lenses.
        observations: identities hold over all cameras; every camera has a clock.
        max_offset_s: largest difference of two cameras' clocks that is searched for.
        person_height_m: mean standing height, metres.
        solve: the solver; where its figures hold `clocks`, their corrections are taken.
        rng: drives sampling.
        measured: differences of two cameras' clocks that something else than people tells.
        tell: told each stage as it begins.
        executor: works on cameras and on pairs of them side by side.

    Returns:
        The solution, refused where the evidence does not do, and the association, its identities those given. A camera whose
        clock is not found has no pose, and a finding says so.
    """
    numbers = _numbers(observations)
    seen = Observations({name: _renumbered(camera, numbers) for name, camera in observations.cameras.items()})
    cameras = build_tracklets(rig, seen, observations.clocks, person_height_m, rng, executor, given=True, tell=tell)
    try:
        initial = _begin(cameras, max_offset_s, measured, executor, tell)
    except EvidenceError as error:
        refused = Solution("association", rig, "refused", findings_of(error))
        return refused, _association(rig, observations, cameras, None, np.zeros(len(cameras)), refused)
    assert initial.graph is not None
    timed = [cameras[c].name for c in initial.graph.groups[0]]
    lost = {name: notice("clock_unknown", name) for name in rig.names if name not in timed}
    lost |= unregistered_cameras(cameras, initial.graph, max_offset_s, timed=False, starts=initial.starts)
    return _refined(rig, observations, cameras, initial, lost, solve, tell)


def _refined(
    rig: Rig, observations: Observations, cameras: Sequence[CameraTracklets], initial: InitialAssociation,
    lost: Mapping[str, Finding],
    solve: RigSolver, tell: Progress,
) -> tuple[Solution, Association]:  # fmt: skip
    """Solve, set the clocks, and solve again: by the cameras whose clocks are known."""
    offset_s, seen = initial.offset_s, _without(observations, lost)
    for passing in (True, False):
        tell("solving")
        solution = solve(synchronise(rig, cameras, seen, offset_s), initial.guesses, passing=passing, refine_time=True)
        if solution.verdict == "refused":
            break
        correction_s, sigma_s = clock_corrections(solution)
        offset_s = offset_s + correction_s
    else:
        in_step = snap_to_whole_frames(offset_s, sigma_s, np.array([camera.clock.fps for camera in cameras]))
        if in_step is not None:
            clocks, offset_s = adjusted(solution.figures).clocks, in_step
            solution = solve(synchronise(rig, cameras, seen, offset_s), initial.guesses, passing=False, refine_time=False)
            solution = replace(solution, figures=replace(adjusted(solution.figures), clocks=clocks))
    solution = _without_clocks(solution, lost)
    return solution, _association(rig, observations, cameras, initial, offset_s, solution)


def _begin(
    cameras: Sequence[CameraTracklets], max_offset_s: float, measured: Sequence[MeasuredStart], executor: Executor | None,
    tell: Progress,
) -> InitialAssociation:  # fmt: skip
    """Register the pairs by people who are the same."""
    people = np.arange(max((camera.n_tracklets for camera in cameras), default=0))
    same = np.where(people[:, None] == people, 0.0, SOMEBODY_ELSE)
    affinity = {
        (a, b): same[: first.n_tracklets, : second.n_tracklets]
        for a, first in enumerate(cameras)
        for b, second in enumerate(cameras)
        if a < b
    }
    starts = None
    if max_offset_s > FULL_SEARCH_S or measured:
        tell("starts of the recordings")
        starts = find_starts(cameras, max_offset_s, measured, affinity, known=True)
    return associate_by_ground_tracks(cameras, Tracklets.of(cameras), max_offset_s, affinity, executor, tell, starts=starts)


def _numbers(observations: Observations) -> Ints:
    """The known identities of all cameras, sorted."""
    seen = [part.identity for camera in observations.cameras.values() for part in (camera.boxes, camera.keypoints)]
    known = np.unique(np.concatenate(seen))
    return np.asarray(known[known > UNKNOWN])


def _renumbered(seen: CameraObservations, numbers: Ints) -> CameraObservations:
    """Identities as their places among the numbers: matrices by identity stay small."""

    def renumbered(identity: Ints) -> Ints:
        return np.where(identity > UNKNOWN, np.searchsorted(numbers, identity), UNKNOWN)

    boxes = replace(seen.boxes, identity=renumbered(seen.boxes.identity))
    return CameraObservations(
        replace(boxes, identity=np.where(find_regular_boxes(boxes), boxes.identity, UNKNOWN)),
        replace(seen.keypoints, identity=renumbered(seen.keypoints.identity)),
        seen.wands,
    )


def find_regular_boxes(boxes: Boxes) -> Bools:
    """(N,) which boxes lie where the neighbouring ones of their identity lead one to expect.

    One that shows somebody else for a moment would bend the track of its person over a second.
    """
    order = np.lexsort((boxes.frame, boxes.identity))
    middle = boxes.ltwh[order, :2] + 0.5 * boxes.ltwh[order, 2:]
    around = np.arange(len(order))[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    inside = np.clip(around, 0, len(order) - 1)
    own = (around == inside) & (boxes.identity[order][inside] == boxes.identity[order][:, None])
    expected = np.nanmedian(np.where(own[..., None], middle[inside], np.nan), axis=1)
    near = np.linalg.norm(middle - expected, axis=1) < ASTRAY * boxes.ltwh[order, 3]
    out = np.zeros(len(order), dtype=bool)
    out[order] = near
    return out


def _without(observations: Observations, lost: Mapping[str, Finding]) -> Observations:
    """Boxes in line and joints, the lost cameras seeing nobody.

    Who is interpolated between a box of his own and one of somebody else is nowhere near either.
    """
    seen = {
        name: replace(camera, boxes=camera.boxes.take(find_regular_boxes(camera.boxes)))
        if name not in lost
        else CameraObservations()
        for name, camera in observations.cameras.items()
    }
    return replace(observations, cameras=seen)


def _without_clocks(solution: Solution, lost: Mapping[str, Finding]) -> Solution:
    """The solution with what is known of each camera whose clock is not known."""
    return replace(solution, findings=(*lost.values(), *solution.findings))


def _association(
    rig: Rig, observations: Observations, cameras: Sequence[CameraTracklets], initial: InitialAssociation | None,
    offset_s: Floats,
    solution: Solution,
) -> Association:  # fmt: skip
    """The result; the first registered camera's clock is the rig's."""
    offset_s = relative_to_reference(offset_s, solution.rig)
    people = [np.arange(camera.n_tracklets) for camera in cameras]
    figures = association_figures(cameras, Tracklets.of(cameras), None, initial, np.concatenate(people), offset_s)
    poses = [camera.pose for camera in solution.rig]
    drifts = clock_drifts(cameras, poses, people, offset_s) if any(poses) else {}
    doubts, notices = drift_findings(cameras, drifts)
    if initial is not None and initial.starts is not None:
        contradicted = contradicted_starts(initial.starts, rig.names, offset_s, [pose is not None for pose in poses])
        notices = [*initial.starts.notices, *contradicted, *notices]
    sigma_s = {name: clock.sigma_s for name, clock in adjusted(solution.figures).clocks.items()}
    instants = synchronise(rig, cameras, observations, offset_s)
    clocks = clocks_with(cameras, offset_s)
    return Association(
        observations, instants, clocks, sigma_s, figures, doubts=tuple(doubts), notices=tuple(notices),
        drifts={cameras[c].name: drift for c, drift in drifts.items()},
    )  # fmt: skip


def associate_synchronised(rig: Rig, observations: Observations, instants: Observations, solution: Solution) -> Association:
    """The association where identities are given and no clock is searched for: whether the clocks keep step all the same.

    Args:
        rig: names and lenses.
        observations: as they were read, with clocks where the rates differ.
        instants: the same at common instants.
        solution: the rig that was made of them.
    """
    clocks = observations.clocks or ({} if observations.fps is None else dict.fromkeys(rig.names, Clock(observations.fps)))
    poses = [camera.pose for camera in solution.rig]
    if not clocks or not any(poses):
        return Association(observations, instants, observations.clocks)
    numbers, none = _numbers(observations), np.zeros(0, np.int64)
    seen = [_renumbered(observations[name], numbers) for name in rig.names]
    cameras = [
        CameraTracklets(camera.name, own, clock, upright_sightings(own, camera.lens, clock), None, None, (none, none))
        for camera, own in zip(rig, seen, strict=True)
        for clock in (clocks[camera.name],)
    ]
    people = [np.arange(camera.n_tracklets) for camera in cameras]
    drifts = clock_drifts(cameras, poses, people, np.zeros(len(cameras)))
    doubts, notices = drift_findings(cameras, drifts)
    return Association(
        observations, instants, observations.clocks, doubts=tuple(doubts), notices=tuple(notices),
        drifts={cameras[c].name: drift for c, drift in drifts.items()},
    )  # fmt: skip
