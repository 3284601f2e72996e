"""The whole calibration: from a scene to the cameras' poses, in the order in which it happens.

`calibrate` reads the scene and calibrates each group of cameras that shares people. `calibrate_together` is one group in five
stages. `estimate_rig` is one estimate: rounds of association and solver. CONTRIBUTING.md, "How a box becomes a rig", continues
from there to the normal equations.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from passerby.association.result import Association
from passerby.calibration.alignment.known_scale import check_known_scale
from passerby.calibration.alignment.lengths import check_lengths, findings_of_checks
from passerby.calibration.alignment.scene_world import align_to_scene
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import (
    DetectedMotion,
    Motion,
    findings_of_motions,
)
from passerby.calibration.clock_skew import clock_rate_figures, clock_skew_findings
from passerby.calibration.corrections import CorrectedEstimate
from passerby.calibration.diagnostics.ground_planarity import ground_figures, notices_of_ground, on_ground, shape_of
from passerby.calibration.diagnostics.smaller_pictures import doubts_of_smaller_pictures
from passerby.calibration.diagnostics.up_direction import find_tilted_ground, up_figures, with_up
from passerby.calibration.diagnostics.verdict import find_unusual_heights, with_verdict
from passerby.calibration.effort import Effort, Step, is_enough, note_of_effort, sizes
from passerby.calibration.held_out import HeldOut, hold_out
from passerby.calibration.kept_tracklets import FOLDER, KeptTracklets
from passerby.calibration.lens_corrections import (
    LensExamination,
    with_focal_changes,
    with_unsettled_lenses,
)
from passerby.calibration.lens_priors import with_lens_priors
from passerby.calibration.prediction import findings_of_predictions, predict_people
from passerby.calibration.readings import findings_of_corrected_clocks
from passerby.calibration.run import CalibrationRun, Estimate
from passerby.calibration.scene_solver import solver_options
from passerby.calibration.separate_groups import estimate_groups, join_groups, stated_parts
from passerby.calibration.unrecorded import Spans, unrecorded_instants
from passerby.common.parallel import worthwhile
from passerby.common.progress import Progress, silent, tell_note
from passerby.core.figures import AdjustedFigures, adjusted
from passerby.core.measuring import add_measuring_sigmas
from passerby.core.quarter_turns import turn_observations, turn_rig, undone
from passerby.core.solution import Solution
from passerby.findings.finding import Finding
from passerby.findings.texts import texts_of
from passerby.people.ground_shape import GroundShape
from passerby.scene.box_interpretations import adjust_for_coarse_boxes
from passerby.scene.inputs import NobodySeenError, SceneInputs, complete_inputs, open_inputs, part_of
from passerby.scene.same_content import doubts_of_same_place
from passerby.scene.scene import Scene
from passerby.scene.sound import measure_by_sound
from passerby.scene.video_inputs import SceneVideoProcessor, joints_remedy
from passerby.solver.refined_lenses import lens_notes


def calibrate(
    scene: Scene | str | Path, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None,
    keep: str | Path | None = None, effort: Effort | None = None, show: Callable[[Calibration], None] | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate the cameras of a scene from the people in it.

    Long videos are watched in stretches, those first that teach most, until the rig measures as well as `effort` says.

    Too little evidence does not raise: it is a calibration with the verdict "refused" or "doubtful" and its reasons.

    Args:
        scene: a scene, or the path of a scene file.
        seed: of the random numbers (RANSAC); the same scene and seed give the same result, bit for bit.
        progress: called with the name of each stage as it begins and, where its parts can be counted, with the number of parts
            that are done and their total.
        executor: works on cameras, and on pairs of them, side by side, such as a `concurrent.futures.ProcessPoolExecutor`;
            None: one after the other. The result does not depend on it.
        keep: folder for the detections of the videos and each camera's tracklets, usually the output folder: a run that was
            stopped, or is repeated with other options, goes on from there. None: nothing is kept.
        effort: how well the rig is to measure, and how much of the videos may be watched for it; None: 5 cm.
        show: called with the rig of each part of the videos but the last, as soon as there is one.

    Raises:
        InputError: the scene file or a file that it names is missing, broken, or contradicts another.
        CalibrationInterrupted: a `KeyboardInterrupt` that has the rig that there was.
    """
    tell = progress or silent
    began = time.perf_counter()
    tell("reading")
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    solver_options(scene)  # wrong options are reported before hours are spent on videos
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
            for note in (_amount(inputs), *texts_of(inputs.findings)):  # the notes of `watch` were shown when they were found
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
    """A calibration was interrupted when it had a rig from a part of the videos."""

    def __init__(self, calibration: Calibration) -> None:
        super().__init__()
        self.calibration = calibration


def _with_videos(
    scene: Scene, watch: SceneVideoProcessor, found: Calibration, seconds: Mapping[str, float], part: Finding | None
) -> Calibration:
    """A calibration with what is to be reported of the scene's videos."""
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
    """Calibrate from inputs that were read; arguments and errors as of `calibrate`.

    Cameras that share no people with the largest group are calibrated by themselves (`Calibration.groups`).
    """
    kept = None if keep is None else KeptTracklets(Path(keep) / FOLDER, len(inputs.rig))
    run = CalibrationRun(scene, solver_options(scene), seed, progress or silent, executor, kept)
    stated = scene.sites.groups if scene.solver.method == "people" else ()
    parts = stated_parts(inputs.rig.names, stated)
    separate = [inputs] if len(parts) == 1 else [part_of(inputs, part) for part in parts]
    found = [one for part in separate for one in estimate_groups(run, part)]
    groups = [calibrate_together(run, one) for one in found]
    return join_groups(groups if len(parts) == 1 else sorted(groups, key=lambda one: -len(one.rig.posed())), run.progress)


def calibrate_together(run: CalibrationRun, found: CorrectedEstimate) -> Calibration:
    """The calibration of cameras as one rig; those that share no people with its largest group have no pose."""
    scene, tell, stated, inputs = run.scene, run.progress, found.stated, found.inputs
    estimate, corrections, lenses, moved = found.estimate, found.corrections, found.lenses, found.moved
    height_m = scene.scale.person_height_m
    began = time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        # 1. Figures: how certain the rig is, and how well it predicts people who were held out.
        association = estimate.association
        shape = shape_of(estimate.solution, association.instants, height_m)
        held_out = _hold_out(run, estimate)
        solution = add_figures(run, stated, inputs, estimate, lenses, moved, shape, held_out)

        # 2. The world frame. Pixels that the scene states, and all results, are of the images as filmed.
        filmed = replace(solution, rig=turn_rig(solution.rig, undone(scene.turns)))
        solution, placed = check_known_scale(solution, align_to_scene(scene, filmed, stated.elsewhere))
        checks = check_lengths(scene.scale.checks, placed.rig, adjusted(solution.figures).scale.relative_sigma)
        of_world = (*placed.findings, *findings_of_checks(checks))

        # 3. Findings, and the verdict by them.
        unsettled = tuple(one for one in lenses.of("notice") if one.code == "lens_doubtful")  # may explain an uncertainty
        causes = (*stated.doubts, *findings_of_motions(moved, solution.rig), *lenses.of("doubt"), *unsettled)
        doubts = (
            *_findings_of_predictions(solution, held_out, association, stated.gaps),
            *doubts_of_same_place(solution.rig, inputs.observations),
            *_doubts_of_smaller_images(run, inputs, solution, association, lenses),
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


def add_figures(
    run: CalibrationRun, stated: SceneInputs, inputs: SceneInputs, estimate: Estimate, lenses: LensExamination,
    motions: Sequence[Motion], shape: GroundShape | None, held_out: HeldOut | None,
) -> Solution:  # fmt: skip
    """The solution, its figures with those of corrections, lenses, the ground, the up direction and people held out."""
    scene, solution = run.scene, estimate.solution
    rates = None
    if "clock_rate" in scene.solver.refine and (stated.observations.clocks or stated.observations.fps is not None):
        rates = clock_rate_figures(stated, inputs, estimate)
    figures = replace(
        solution.figures,
        moved=tuple(one.figures for one in motions if isinstance(one, DetectedMotion)),
        drifts=tuple(one.figures for one in motions if not isinstance(one, DetectedMotion)) or None,
        ground=ground_figures(shape),
        up=up_figures(solution, estimate.association.instants, run.rng()),
        clock_rates=rates,
        held_out=None if held_out is None else held_out.figures,
    )
    if isinstance(figures, AdjustedFigures):
        figures = replace(figures, lenses=with_lens_priors(figures.lenses, stated.rig))
        figures = with_unsettled_lenses(with_focal_changes(figures, lenses.result), lenses.result)
        figures = adjust_for_coarse_boxes(figures, stated.doubts)
        if shape is not None and not (scene.world is not None and scene.world.tilt):
            figures = on_ground(figures, shape)
        solution = replace(solution, rig=add_measuring_sigmas(solution.rig, figures.measuring))
    return replace(solution, figures=figures)


def _states_up(scene: Scene) -> bool:
    """Whether `[world]` sets the up direction, by points, positions or lines."""
    return scene.world is not None and (scene.world.tilt or bool(scene.world.lines))


def _hold_out(run: CalibrationRun, estimate: Estimate) -> HeldOut | None:
    """Hold out people of a rig of the person model; the published method has no other adjustment."""
    if estimate.solution.method != "people":
        return None
    return hold_out(estimate.solution.rig, estimate.association.instants, run.scene.scale.person_height_m, run.seed)


def _findings_of_predictions(
    solution: Solution, held_out: HeldOut | None, association: Association, gaps: Mapping[str, Spans]
) -> list[Finding]:
    """The cameras that predict people poorly, by the rig that was adjusted without some of them."""
    if solution.method != "people":
        return []
    rig = solution.rig if held_out is None else held_out.rig
    outcomes = predict_people(rig, association.instants, unrecorded_instants(gaps, association))
    boxed = any(len(seen.boxes) for seen in association.instants.cameras.values())
    return findings_of_predictions(rig, outcomes, adjusted(solution.figures).noise if boxed else None)


def _doubts_of_smaller_images(
    run: CalibrationRun, inputs: SceneInputs, solution: Solution, association: Association, lenses: LensExamination
) -> list[Finding]:
    """Images that are smaller than the lens is for; not tried for several cameras at once where one was found by itself."""
    if any(one.code == "smaller_image_fits" for one in lenses.findings):
        return []
    return doubts_of_smaller_pictures(run, inputs, solution, association)


def _amount(inputs: SceneInputs) -> str:
    """How much there is to calibrate from, in words."""
    seen = inputs.observations
    boxes = sum(len(seen[name].boxes) for name in inputs.rig.names)
    joints = sum(len(seen[name].keypoints) for name in inputs.rig.names)
    return f"{len(inputs.rig)} cameras, {boxes} boxes" + (f", {joints} skeletons" if joints else "")
