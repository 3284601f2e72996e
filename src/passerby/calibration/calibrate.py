"""The whole calibration, from a scene to the cameras' poses, in the order of its steps.

`calibrate` reads the scene. `calibrate_inputs` estimates each group of cameras that shares people, and joins groups between
which people pass. `correct_inputs` estimates one group and corrects its inputs. `estimate_rig` makes one estimate: rounds of
association and solver. `calibrate_together` makes the result of a group in four stages. CONTRIBUTING.md, "How a box becomes a
rig", continues from there to the normal equations.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.association.attachment import Attached
from passerby.association.clocks.offsets import clock_corrections, snap_to_whole_frames
from passerby.association.clocks.starts import FULL_SEARCH_S, WALL_CLOCK
from passerby.calibration.alignment.known_scale import check_known_scale
from passerby.calibration.alignment.lengths import check_lengths, findings_of_checks
from passerby.calibration.alignment.scene_world import align_to_scene
from passerby.calibration.association_run import AssociationOptions, share_of_same_pairs
from passerby.calibration.association_start import start_association
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import (
    MotionCorrection,
    MotionSearch,
    correct_motion,
    findings_of_motions,
    measure_motions,
)
from passerby.calibration.clock_skew import MOST_CORRECTIONS as MOST_RATE_CORRECTIONS
from passerby.calibration.clock_skew import ClockRateCorrection, clock_skew_findings, correct_clock_rates
from passerby.calibration.diagnostics.ground_planarity import notices_of_ground, shape_of
from passerby.calibration.diagnostics.up_direction import find_tilted_ground, with_up
from passerby.calibration.diagnostics.verdict import find_unusual_heights, with_verdict
from passerby.calibration.effort import Effort, Step, is_enough, note_of_effort, sizes
from passerby.calibration.group_figures import add_figures, check_image_sizes, check_predictions, hold_out_people
from passerby.calibration.held_out import is_worse
from passerby.calibration.joined_groups import find_doors, join_estimates, join_numbers, nearest_door
from passerby.calibration.kept_tracklets import FOLDER, KeptTracklets
from passerby.calibration.known_identities import estimate_with_known_identities
from passerby.calibration.lens_corrections import (
    LensExamination,
    examine_stated_lenses,
)
from passerby.calibration.readings import MOST_CORRECTIONS as MOST_CLOCK_CORRECTIONS
from passerby.calibration.readings import (
    ClockCorrection,
    correct_late_clock,
    findings_of_corrected_clocks,
    findings_of_readings,
    read_cameras,
)
from passerby.calibration.run import CalibrationRun, Correction, Corrections, Estimate
from passerby.calibration.scene_solver import solve_scene, solver_options
from passerby.calibration.separate_groups import (
    FEWEST,
    GroupEstimate,
    join_groups,
    stated_parts,
    unplaced_groups,
)
from passerby.common.parallel import worthwhile
from passerby.common.progress import Progress, silent, tell_note
from passerby.common.text import list_names
from passerby.core.association_figures import AssociationRound
from passerby.core.figures import adjusted
from passerby.core.quarter_turns import turn_observations, turn_rig, undone
from passerby.core.solution import Solution
from passerby.core.unknown_focals import begin_with
from passerby.findings.finding import Finding
from passerby.findings.texts import texts_of
from passerby.scene.inputs import NobodySeenError, SceneInputs, complete_inputs, open_inputs, part_of
from passerby.scene.same_content import doubts_of_same_place
from passerby.scene.scene import Scene
from passerby.scene.sound import measure_by_sound
from passerby.scene.video_inputs import SceneVideoProcessor, joints_remedy
from passerby.solver.refined_lenses import lens_notes

MAX_ROUNDS = 4
"""Largest number of rounds of association and solver in one estimate."""
SEARCHED_ROUNDS = 2
"""Number of rounds in which poses of cameras without one are searched for by the rig's people."""
SETTLED = 0.98
"""Identities have settled when this share of the pairs of tracklets of one person stays the same in a round."""


def calibrate(
    scene: Scene | str | Path, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None,
    keep: str | Path | None = None, effort: Effort | None = None, show: Callable[[Calibration], None] | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate the cameras of a scene from the people in it.

    Long videos are processed in stretches, the most informative ones first, until the rig measures as well as `effort` asks.

    Too little evidence raises no error: the calibration gets the verdict "refused" or "doubtful" and its reasons.

    Args:
        scene: a scene, or the path of a scene file.
        seed: seed of the random numbers (RANSAC); the same scene and seed give the same result, bit for bit.
        progress: called with the name of each stage as it begins and, where its parts can be counted, with the number of parts
            that are done and their total.
        executor: processes cameras, and pairs of them, in parallel, such as a `concurrent.futures.ProcessPoolExecutor`;
            None: one after the other. The result does not depend on it.
        keep: folder for the detections of the videos and each camera's tracklets, usually the output folder. A run that was
            stopped, or is repeated with other options, uses them again. None: nothing is kept.
        effort: the wanted accuracy of the rig, and the limit of the processing time; None: 5 cm.
        show: called with the calibration from each part of the videos but the last, as soon as it exists.

    Raises:
        InputError: the scene file or a file that it names is missing, broken, or contradicts another.
        CalibrationInterrupted: a `KeyboardInterrupt` that contains the last calibration.
    """
    tell = progress or silent
    began = time.perf_counter()
    tell("reading")
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    solver_options(scene)  # wrong options are reported before the videos are processed, which may take hours
    watch = SceneVideoProcessor(None if keep is None else Path(keep), executor, tell)
    opened, effort = open_inputs(scene), effort or Effort()
    clocks = measure_by_sound(scene, opened)
    stretches = watch.plan_stretches(scene, opened) if effort.limited else ()
    recorded_s, found, steps = sum(one.seconds for one in stretches), None, list[Step]()
    try:
        for size in sizes(len(stretches)):
            watch.stretches = tuple(sorted(stretches[:size], key=lambda one: one.begin_s))
            read = time.perf_counter()
            try:
                inputs = complete_inputs(scene, opened, watch, lambda *_: clocks)
            except NobodySeenError:
                if size >= len(stretches):
                    raise
                continue
            for note in (_amount(inputs), *texts_of(inputs.findings)):  # the notes of `watch` have already been shown
                tell_note(tell, note)
            reading_s = time.perf_counter() - read
            processes = worthwhile(executor, scene.size_bytes, len(scene.cameras))
            found = calibrate_inputs(scene, inputs, seed=seed, progress=tell, executor=processes, keep=keep)
            steps.append(Step.of(found, sum(one.seconds for one in watch.stretches), time.perf_counter() - began))
            found = _with_videos(scene, watch, found, {"reading": reading_s}, note_of_effort(steps, recorded_s))
            if size >= len(stretches) or is_enough(steps, effort):
                break
            if show is not None:
                show(found)
    except KeyboardInterrupt:
        if found is not None:
            raise CalibrationInterrupted(found) from None
        raise
    assert found is not None
    return found


class CalibrationInterrupted(KeyboardInterrupt):
    """A calibration was interrupted after it had a result from a part of the videos."""

    def __init__(self, calibration: Calibration) -> None:
        super().__init__()
        self.calibration = calibration


def _with_videos(
    scene: Scene, watch: SceneVideoProcessor, found: Calibration, seconds: Mapping[str, float], part: Finding | None
) -> Calibration:
    """Add the findings, figures and times of the scene's videos to a calibration."""
    missing = len(found.rig.posed()) < len(found.rig)
    joints = joints_remedy(scene, "refusal" if found.verdict == "refused" else "notice") if missing else None
    first = (*([joints] if joints else []), *([part] if part else []))
    return replace(
        found,
        diagnostics=(*found.doubts, *first, *watch.notes, *found.notices),
        perception=watch.figures,
        seconds={**seconds, **watch.seconds, **found.seconds},
        groups=tuple(replace(one, perception=watch.figures) for one in found.groups),
    )


def calibrate_inputs(
    scene: Scene, inputs: SceneInputs, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None,
    keep: str | Path | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate from inputs that were read before; arguments and errors are those of `calibrate`.

    Cameras that share no people with the largest group are calibrated separately (`Calibration.groups`).
    """
    kept = None if keep is None else KeptTracklets(Path(keep) / FOLDER, len(inputs.rig))
    run = CalibrationRun(scene, solver_options(scene), seed, progress or silent, executor, kept)
    stated = scene.sites.groups if scene.solver.method == "people" else ()
    parts = stated_parts(inputs.rig.names, stated)
    found = list[GroupEstimate]()
    for whole in [inputs] if len(parts) == 1 else [part_of(inputs, part) for part in parts]:
        waiting, groups = [whole], list[GroupEstimate]()
        while waiting:
            part = waiting.pop(0)
            one = correct_inputs(run, part)
            left = unplaced_groups(run, one)
            for names in left:
                tell_note(run.progress, f"{list_names(names)} share no people with the other cameras: calibrated separately")
            waiting = [*(part_of(part, names) for names in left), *waiting]
            if not groups or len(one.rig.posed()) >= FEWEST:
                groups.append(one)
        found += join_by_passages(run, whole, groups)
    if len(parts) > 1:
        found.sort(key=lambda one: -len(one.rig.posed()))
    return join_groups([(one, calibrate_together(run, one)) for one in found], run.progress)


def join_by_passages(run: CalibrationRun, inputs: SceneInputs, found: Sequence[GroupEstimate]) -> list[GroupEstimate]:
    """Join the groups of cameras between which people pass, and return all groups.

    If a common rig contradicts its groups, it would measure worse than they do. It is then tried again without the passage of
    the fewest people.
    """
    if len(found) < 2 or run.scene.association.given or run.scene.solver.method != "people":
        return list(found)
    doors = find_doors(run, found)
    between = {pair: door for pair, door in doors.items() if door.passage.turn_known}
    out = {number: replace(one, nearest=nearest_door(number, doors)) for number, one in enumerate(found)}
    waiting = join_numbers(list(between), len(found))
    while waiting:
        members = waiting.pop()
        own = [found[number] for number in members]
        tell_note(run.progress, f"people pass between groups of {', '.join(str(len(one.rig.posed())) for one in own)} cameras")
        inside = {pair: door for pair, door in between.items() if pair[0] in members}
        place = {number: rank for rank, number in enumerate(members)}
        one = join_estimates(run, inputs, own, {(place[a], place[b]): door for (a, b), door in inside.items()})
        if one is not None:
            out[members[0]] = one
            for number in members[1:]:
                del out[number]
        else:
            weakest = min(inside, key=lambda pair: inside[pair].passage.votes)
            del between[weakest], inside[weakest]
            waiting += join_numbers(list(inside), len(found))
    return list(out.values())


def correct_inputs(run: CalibrationRun, inputs: SceneInputs) -> GroupEstimate:
    """Estimate a rig. While the estimate shows a fault of the input, correct the fault and estimate again.

    An estimate takes six solves at most. There is one estimate, and one more for each correction. The largest numbers of
    corrections are: one for each camera (motion), three of clock offsets, three of lenses, and six of clock rates if these are
    refined. The check of image sizes adds one solve for each camera whose people stay in a part of the image, and one more.
    """
    height_m, stated = run.scene.scale.person_height_m, inputs
    motions = MotionSearch(stated, run.scene.association.given, height_m)
    began = time.perf_counter()
    # The systems are small: more BLAS threads only wait for each other, and their number would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        estimate, corrections = estimate_rig(run, inputs), Corrections()
        while True:
            correction, lenses = find_correction(run, motions, inputs, estimate, corrections)
            if correction is None:
                break
            after = estimate_rig(run, correction.inputs)
            if not correction.explains(after, estimate, height_m) or (
                correction.tentative and is_worse(after, estimate, height_m, run.seed)
            ):
                corrections = replace(corrections, dropped=(*corrections.dropped, correction))
                continue
            corrections = replace(corrections, made=(*corrections.made, correction))
            inputs, estimate = correction.inputs, after
        moved = measure_motions(motions, corrections, estimate)
    return GroupEstimate(stated, inputs, estimate, corrections, lenses, moved, time.perf_counter() - began)


def calibrate_together(run: CalibrationRun, found: GroupEstimate) -> Calibration:
    """Make the calibration of cameras as one rig; cameras that share no people with its largest group have no pose."""
    scene, tell, stated, inputs = run.scene, run.progress, found.stated, found.inputs
    estimate, corrections, lenses, moved = found.estimate, found.corrections, found.lenses, found.moved
    height_m = scene.scale.person_height_m
    began = time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        # 1. Figures: the uncertainty of the rig, and its residuals for people who were held out.
        association = estimate.association
        shape = shape_of(estimate.solution, association.instants, height_m)
        held_out = hold_out_people(run, estimate)
        solution = add_figures(run, stated, inputs, estimate, lenses, moved, shape, held_out)

        # 2. The world frame. Pixels that the scene states, and all results, refer to the images as filmed.
        filmed = replace(solution, rig=turn_rig(solution.rig, undone(scene.turns)))
        solution, placed = check_known_scale(solution, align_to_scene(scene, filmed, stated.elsewhere))
        checks = check_lengths(scene.scale.checks, placed.rig, adjusted(solution.figures).scale.relative_sigma)
        of_world = (*placed.findings, *findings_of_checks(checks))

        # 3. Findings, and the verdict from them.
        unsettled = tuple(one for one in lenses.of("notice") if one.code == "lens_doubtful")  # may explain an uncertainty
        causes = (*stated.doubts, *findings_of_motions(moved, solution.rig), *lenses.of("doubt"), *unsettled)
        doubts = (
            *check_predictions(solution, held_out, association, found),
            *doubts_of_same_place(solution.rig, inputs.observations),
            *check_image_sizes(run, found, solution, association),
            *association.doubts,
            *(one for one in association.height_findings if one.severity != "notice"),
            *(one for one in of_world if one.severity == "doubt"),
            *notices_of_ground(shape, placed=scene.world is not None),  # may explain an uncertainty
        )
        solution = with_verdict(
            solution, association.instants, given=scene.association.given, why=association.lost, causes=causes, doubts=doubts
        )
    solved = time.perf_counter()
    rates = solution.figures.clock_rates or {}
    refined = (
        *(one for one in lenses.of("notice") if one not in unsettled),
        *lens_notes(adjusted(solution.figures)),
        *findings_of_corrected_clocks(corrections),
        *clock_skew_findings(rates),
        *find_tilted_ground(solution.figures.up, up_stated=_states_up(scene)),
        *find_unusual_heights(adjusted(solution.figures).people),
        *(door.finding for door in found.doors),
    )
    unused = tuple(one for one in association.height_findings if one.severity == "notice")
    frame = tuple(one for one in of_world if one.severity == "notice")
    for note in (
        *texts_of((*refined, *association.notices, *unused, *frame)),
        f"{solution.verdict}{''.join(f': {reason}' for reason in solution.reasons[:1])}",
    ):
        tell_note(tell, note)

    # 4. The result.
    upright, back = solution.rig, undone(scene.turns)
    seen = turn_observations(association.observations, upright, back)
    instants = turn_observations(association.instants, upright, back)
    return Calibration(
        scene=scene,
        rig=with_up(replace(placed.rig, verdict=solution.verdict), None if _states_up(scene) else solution.figures.up),
        verdict=solution.verdict,
        diagnostics=(*solution.findings, *stated.findings, *association.notices, *unused, *refined, *frame),
        observations=seen,
        seed=run.seed,
        options=asdict(run.options),
        figures=replace(placed.figures, checks=checks or None),
        association=replace(association, observations=seen, instants=instants),
        clocked=bool(stated.observations.clocks),
        wall_clock=stated.wall_clock,
        world=placed.world,
        seconds={"solving": found.seconds + solved - began},
    )


def estimate_rig(run: CalibrationRun, inputs: SceneInputs) -> Estimate:
    """Estimate the rig, and the identities and clocks if they are unknown, in six solves at most.

    The rig is solved with the current identities, and the rig then improves the identities, until both settle.
    """
    scene, rig = run.scene, inputs.rig
    search_s = scene.association.search_s if inputs.observations.clocks else 0.0
    # Errors of the recorders' clocks are within the offsets that are searched in full: they help only a larger search.
    measured = tuple(one for one in inputs.measured if one.found_by != WALL_CLOCK or search_s > FULL_SEARCH_S)
    if scene.association.given:
        return estimate_with_known_identities(run, inputs, search_s, measured)
    wanted = AssociationOptions(
        scene.association.mode, search_s, scene.scale.person_height_m, inputs.pointed, measured, inputs.stated,
        scene.sites.groups,
    )  # fmt: skip
    rng, refine_time = run.rng(), search_s > 0  # one stream of random numbers for association and solver

    # 1. Tracklets of each camera, pairs of cameras that their people register, first identities and clocks.
    start = start_association(run, rig, inputs.observations, wanted, rng)
    state, initial = start.run, start.initial
    if initial is None:
        singles = np.arange(len(state.tracklets.start_s))
        association = state.association(singles, np.zeros(len(state.cameras)), None, None, [])
        return Estimate(Solution("association", state.rig, "refused", start.refusal), association)
    person, offset_s = initial.person, initial.offset_s
    lenses = state.rig if any(camera.lens.uncalibrated for camera in state.rig) else None
    rounds, attached, solution = list[AssociationRound](), dict[int, Attached](), None

    # 2. Rounds: solve with these identities and clocks, then identify people by the rig.
    for number in range(MAX_ROUNDS):
        run.progress(f"round {number + 1}")
        rows = state.rows(person, offset_s, solution)
        instants, known = state.instants(state.identified(rows), offset_s), state.known(rows).people
        solution = solve_scene(
            run, rig, instants, rng, guesses=initial.guesses, known=known, passing=True, refine_time=refine_time, lenses=lenses
        )
        if solution.verdict == "refused":
            return Estimate(solution, state.association(person, offset_s, None, initial, rounds))
        offset_s = offset_s + clock_corrections(solution)[0]
        if lenses is not None:
            state, lenses = state.with_lenses(solution.rig), begin_with(lenses, solution.rig)
        before = person
        person, registered = state.identify_by_rig(
            person, offset_s, solution, initial, attached, search=number < SEARCHED_ROUNDS, executor=run.executor,
            tell=run.progress,
        )  # fmt: skip
        rounds.append(AssociationRound(registered=registered, unchanged=share_of_same_pairs(before, person)))
        tell_note(run.progress, f"{registered} of {len(rig)} cameras have poses")
        if rounds[-1].unchanged > SETTLED:
            break

    # 3. The last solve, with all of the evidence; a second one if all clocks are found to differ by whole frames.
    run.progress("solving")
    rows = state.rows(person, offset_s, solution)
    identified, known = state.identified(rows), state.known(rows).people
    instants = state.instants(identified, offset_s)
    solution = solve_scene(
        run, rig, instants, rng, guesses=initial.guesses, known=known, refine_time=refine_time, lenses=lenses
    )
    sigma_s = None
    if refine_time and solution.verdict != "refused":
        correction_s, sigma_s = clock_corrections(solution)
        offset_s = offset_s + correction_s
        whole = snap_to_whole_frames(offset_s, sigma_s, np.array([camera.clock.fps for camera in state.cameras]))
        if whole is not None:
            offset_s, instants = whole, state.instants(identified, whole)
            solution = solve_scene(run, rig, instants, rng, guesses=initial.guesses, known=known, lenses=lenses)
    return Estimate(solution, state.association(person, offset_s, solution, initial, rounds, sigma_s, attached))


def find_correction(
    run: CalibrationRun, motions: MotionSearch, inputs: SceneInputs, estimate: Estimate, corrections: Corrections
) -> tuple[Correction | None, LensExamination]:
    """Correct the first fault of the input that an estimate shows; if there is none, return the findings on the lenses.

    The order is clock rates, clock offsets, motion, lenses: else a fault of a clock or a motion is taken for one of a lens.
    """
    if "clock_rate" in run.scene.solver.refine and corrections.allows(ClockRateCorrection, MOST_RATE_CORRECTIONS):
        rates = correct_clock_rates(inputs, estimate)
        if rates is not None:
            return rates, LensExamination()
    read = read_cameras(inputs, estimate)
    if corrections.allows(ClockCorrection, MOST_CLOCK_CORRECTIONS):
        clock = correct_late_clock(inputs, read)
        if clock is not None:
            return clock, LensExamination()
    if corrections.allows(MotionCorrection, len(inputs.rig)):
        motion = correct_motion(motions, inputs, estimate)
        if motion is not None:
            return motion, LensExamination()
    misread = findings_of_readings(estimate, read)
    return examine_stated_lenses(inputs, estimate, corrections, run.scene.scale.person_height_m, misread)


def _states_up(scene: Scene) -> bool:
    """Check whether `[world]` sets the up direction, by points, positions or lines."""
    return scene.world is not None and (scene.world.tilt or bool(scene.world.lines))


def _amount(inputs: SceneInputs) -> str:
    """Return the amount of input in words."""
    seen = inputs.observations
    boxes = sum(len(seen[name].boxes) for name in inputs.rig.names)
    joints = sum(len(seen[name].keypoints) for name in inputs.rig.names)
    return f"{len(inputs.rig)} cameras, {boxes} boxes" + (f", {joints} skeletons" if joints else "")
