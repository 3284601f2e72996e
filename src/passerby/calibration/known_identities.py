"""Estimation with known identities: one solve; if the clocks are unknown, offsets by the tracks of the same people first."""

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
from passerby.association.not_people import without_people
from passerby.association.registration_failures import unregistered_cameras
from passerby.association.result import Association
from passerby.calibration.pointed_heights import identity_in, pointed_heights
from passerby.calibration.run import CalibrationRun, Estimate
from passerby.calibration.scene_solver import solve_scene
from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Observations
from passerby.core.pointing import StatedIdentities
from passerby.core.scale_cues import PersonHeight
from passerby.core.solution import Solution
from passerby.core.synchronisation import clocks_of, resample_to_common_steps
from passerby.findings.finding import Finding, notice
from passerby.findings.ranking import findings_of
from passerby.people.sightings import upright_sightings
from passerby.scene.inputs import SceneInputs

ANOTHER_PERSON = -1e9
"""Log-likelihood ratio that two different known people are one person: they neither vote nor match."""
NEIGHBOURS, FARTHEST = 2, 0.5
"""Number of boxes on either side, and distance from their median, in body heights, beyond which a box shows another person: an
even walk stays nearer within two boxes."""


def estimate_with_known_identities(
    run: CalibrationRun, inputs: SceneInputs, search_s: float, measured: Sequence[MeasuredStart]
) -> Estimate:
    """Estimate the rig of cameras whose people have the same identities in all of them.

    Args:
        run: the scene and its options.
        inputs: the inputs of the cameras.
        search_s: largest difference of two cameras' clocks that is searched for, seconds; 0: the clocks are right.
        measured: differences of two cameras' clocks that were measured without people.

    Returns:
        The solution, refused if the evidence is insufficient, and the association with the given identities. A camera whose
        clock is not found gets no pose and a finding.
    """
    rng = run.rng()
    seen = _without_not_people(inputs.observations, inputs.stated)
    heights = pointed_heights(inputs.pointed, identity_in(seen))
    if search_s > 0:
        found = _estimate_with_clocks(run, inputs.rig, seen, search_s, measured, heights.people, rng)
    else:
        synchronised = _synchronised(inputs.rig, seen)
        run.progress("solving")
        solution = solve_scene(run, inputs.rig, synchronised, rng, known=heights.people)
        found = Estimate(solution, associate_synchronised(inputs.rig, seen, synchronised, solution))
    return replace(
        found, association=replace(found.association, known_heights=heights.people, height_findings=heights.findings)
    )


def _estimate_with_clocks(
    run: CalibrationRun, rig: Rig, observations: Observations, search_s: float, measured: Sequence[MeasuredStart],
    known: Sequence[PersonHeight], rng: np.random.Generator,
) -> Estimate:  # fmt: skip
    """Find clock offsets by the tracks of the same people; then solve, set the clocks, and solve again."""
    numbers = _numbers(observations)
    named = Observations({name: _renumbered(camera, numbers) for name, camera in observations.cameras.items()})
    cameras = build_tracklets(
        rig, named, observations.clocks, run.scene.scale.person_height_m, rng, run.executor, given=True, tell=run.progress
    )
    try:
        initial = _begin(cameras, search_s, measured, run.executor, run.progress)
    except EvidenceError as error:
        refused = Solution("association", rig, "refused", findings_of(error))
        return Estimate(refused, _association(rig, observations, cameras, None, np.zeros(len(cameras)), refused))
    assert initial.graph is not None
    timed = [cameras[c].name for c in initial.graph.groups[0]]
    lost = {name: notice("clock_unknown", name) for name in rig.names if name not in timed}
    lost |= unregistered_cameras(cameras, initial.graph, search_s, timed=False, starts=initial.starts)
    offset_s, seen = initial.offset_s, _without(observations, lost)
    for passing in (True, False):
        run.progress("solving")
        solution = solve_scene(
            run, rig, synchronise(rig, cameras, seen, offset_s), rng, guesses=initial.guesses, known=known, passing=passing,
            refine_time=True,
        )  # fmt: skip
        if solution.verdict == "refused":
            break
        correction_s, sigma_s = clock_corrections(solution)
        offset_s = offset_s + correction_s
    else:
        whole = snap_to_whole_frames(offset_s, sigma_s, np.array([camera.clock.fps for camera in cameras]))
        if whole is not None:
            clocks, offset_s = adjusted(solution.figures).clocks, whole
            instants = synchronise(rig, cameras, seen, offset_s)
            solution = solve_scene(run, rig, instants, rng, guesses=initial.guesses, known=known)
            solution = replace(solution, figures=replace(adjusted(solution.figures), clocks=clocks))
    solution = replace(solution, findings=(*lost.values(), *solution.findings))
    return Estimate(solution, _association(rig, observations, cameras, initial, offset_s, solution))


def _begin(
    cameras: Sequence[CameraTracklets], max_offset_s: float, measured: Sequence[MeasuredStart], executor: Executor | None,
    tell: Progress,
) -> InitialAssociation:  # fmt: skip
    """Register the pairs of cameras by the tracks of people with the same identity."""
    people = np.arange(max((camera.n_tracklets for camera in cameras), default=0))
    same = np.where(people[:, None] == people, 0.0, ANOTHER_PERSON)
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
    """Return the known identities of all cameras, sorted."""
    seen = [part.identity for camera in observations.cameras.values() for part in (camera.boxes, camera.keypoints)]
    known = np.unique(np.concatenate(seen))
    return np.asarray(known[known > UNKNOWN])


def _renumbered(seen: CameraObservations, numbers: Ints) -> CameraObservations:
    """Replace identities by their indices in the sorted numbers, so that matrices by identity stay small.

    Boxes that `find_regular_boxes` rejects lose their identity.
    """

    def renumbered(identity: Ints) -> Ints:
        return np.where(identity > UNKNOWN, np.searchsorted(numbers, identity), UNKNOWN)

    boxes = replace(seen.boxes, identity=renumbered(seen.boxes.identity))
    return CameraObservations(
        replace(boxes, identity=np.where(find_regular_boxes(boxes), boxes.identity, UNKNOWN)),
        replace(seen.keypoints, identity=renumbered(seen.keypoints.identity)),
        seen.wands,
    )


def find_regular_boxes(boxes: Boxes) -> Bools:
    """Return whether each box (N,) is near the median of the neighbouring boxes of its identity.

    A box that shows another person for a moment would bend the track of its identity over a second.
    """
    order = np.lexsort((boxes.frame, boxes.identity))
    middle = boxes.ltwh[order, :2] + 0.5 * boxes.ltwh[order, 2:]
    around = np.arange(len(order))[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    inside = np.clip(around, 0, len(order) - 1)
    own = (around == inside) & (boxes.identity[order][inside] == boxes.identity[order][:, None])
    expected = np.nanmedian(np.where(own[..., None], middle[inside], np.nan), axis=1)
    near = np.linalg.norm(middle - expected, axis=1) < FARTHEST * boxes.ltwh[order, 3]
    out = np.zeros(len(order), dtype=bool)
    out[order] = near
    return out


def _without(observations: Observations, lost: Mapping[str, Finding]) -> Observations:
    """Keep only regular boxes, and all joints; lost cameras get no observations.

    An interpolation between a box of one person and a box of another would give a position where neither is.
    """
    seen = {
        name: replace(camera, boxes=camera.boxes.take(find_regular_boxes(camera.boxes)))
        if name not in lost
        else CameraObservations()
        for name, camera in observations.cameras.items()
    }
    return replace(observations, cameras=seen)


def _association(
    rig: Rig, observations: Observations, cameras: Sequence[CameraTracklets], initial: InitialAssociation | None,
    offset_s: Floats,
    solution: Solution,
) -> Association:  # fmt: skip
    """Return the association; the first registered camera's clock is the rig's clock."""
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
    """Return the association for given identities without a clock search, with the drifts of the clocks.

    Args:
        rig: names and lenses.
        observations: the observations as they were read, with clocks where the rates differ.
        instants: the same observations at common instants.
        solution: the solution from them.
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


def _without_not_people(seen: Observations, stated: StatedIdentities) -> Observations:
    """Remove the ids, in their cameras, that the user states to be no people."""
    if not stated.not_people:
        return seen
    cameras = {
        name: without_people(camera, [one for one in stated.not_people if one.camera == name])
        for name, camera in seen.cameras.items()
    }
    return replace(seen, cameras=cameras)


def _synchronised(rig: Rig, seen: Observations) -> Observations:
    """Return the people at common time steps, by the stated clocks."""
    sizes = {camera.name: camera.lens.size for camera in rig}
    found = resample_to_common_steps(seen, clocks_of(seen, rig.names), sizes=sizes)
    return found if seen.clocks or seen.fps else replace(found, fps=None)
