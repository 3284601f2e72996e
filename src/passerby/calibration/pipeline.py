"""`calibrate()`: the order of the stages, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.association.result import Association
from passerby.calibration.alignment.known_scale import check_known_scale
from passerby.calibration.alignment.lengths import check_lengths, findings_of_checks
from passerby.calibration.alignment.scene_world import align_to_scene
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import DetectedMotion, Motion, MotionRepair, findings_of_motions
from passerby.calibration.clock_skew import MOST_CORRECTIONS, clock_rate_figures, clock_skew_findings, find_clock_skew
from passerby.calibration.diagnostics.ground_planarity import ground_figures, notices_of_ground, on_ground, shape_of
from passerby.calibration.diagnostics.smaller_pictures import doubts_of_smaller_pictures
from passerby.calibration.diagnostics.unusual_people import told_of_unusual
from passerby.calibration.diagnostics.up_direction import find_tilted_ground, up_figures, with_up
from passerby.calibration.diagnostics.verdict import judged
from passerby.calibration.estimation import Estimate, Estimator
from passerby.calibration.held_out import HeldOut, hold_out
from passerby.calibration.kept_tracklets import FOLDER, KeptTracklets
from passerby.calibration.lens_corrections import (
    LensOutcome,
    correct_lenses,
    is_worse,
    with_focal_changes,
    with_unsettled_lenses,
)
from passerby.calibration.lens_priors import with_lens_priors
from passerby.calibration.prediction import findings_of_predictions, predict_people
from passerby.calibration.readings import MOST_CORRECTIONS as CLOCK_CORRECTIONS
from passerby.calibration.readings import correct_late_clock, corrected_clocks
from passerby.calibration.repairs import Repair, apply_repairs
from passerby.calibration.scene_solver import solver_options
from passerby.calibration.separate_groups import calibrate_by_groups
from passerby.calibration.unrecorded import Spans, unrecorded_instants
from passerby.common.parallel import worthwhile
from passerby.common.progress import Progress, silent, tell_note
from passerby.core.figures import AdjustedFigures, adjusted
from passerby.core.measuring_figures import with_measuring_sigmas
from passerby.core.quarter_turns import turn_observations, turn_rig, undone
from passerby.core.solution import Solution
from passerby.findings.finding import Finding
from passerby.findings.texts import texts_of
from passerby.people.ground_shape import GroundShape
from passerby.scene.coarse_boxes import with_coarse_boxes
from passerby.scene.inputs import SceneInputs, read_inputs
from passerby.scene.same_content import doubts_of_same_place
from passerby.scene.scene import Scene
from passerby.scene.sound import measure_by_sound
from passerby.scene.video_inputs import SceneVideoProcessor, joints_remedy
from passerby.solver.refined_lenses import lens_notes


def calibrate(
    scene: Scene | str | Path, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None,
    keep: str | Path | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate the cameras of a scene from the people in it.

    Too little evidence does not raise: it is a calibration with the verdict "refused" or "doubtful" and its reasons.

    Args:
        scene: a scene, or the path of a scene file.
        seed: of the random numbers (RANSAC); the same scene and seed give the same result, bit for bit.
        progress: called with the name of each stage as it begins and, where its parts can be counted, with the number of parts
            that are done and their total.
        executor: works on cameras, and on pairs of them, side by side, such as a `concurrent.futures.ProcessPoolExecutor`;
            None: one after the other. The result does not depend on it.
        keep: folder in which are kept what was seen in the videos and each camera's tracklets, so that a run that was stopped,
            or is repeated with other options, goes on from there: usually that which the calibration is written into.
            None: nothing is kept.

    Raises:
        InputError: the scene file or a file that it names is missing, broken, or contradicts another.
    """
    tell = progress or silent
    began = time.perf_counter()
    tell("reading")
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    solver_options(scene)  # what is wrong with them is reported before hours are spent on videos
    watch = SceneVideoProcessor(None if keep is None else Path(keep), executor, tell)
    inputs = read_inputs(scene, watch, measure_by_sound)
    for note in (_amount(inputs), *texts_of(inputs.findings)):  # what `watch` has to note was reported when it was found
        tell_note(tell, note)
    read = time.perf_counter()
    executor = worthwhile(executor, scene.size_bytes, len(scene.cameras))
    found = calibrate_inputs(scene, inputs, seed=seed, progress=tell, executor=executor, keep=keep)
    missing = len(found.rig.posed()) < len(found.rig)
    joints = joints_remedy(scene, "refusal" if found.verdict == "refused" else "notice") if missing else None
    return replace(
        found,
        diagnostics=(*found.doubts, *([joints] if joints else []), *watch.notes, *found.notices),
        perception=watch.figures,
        seconds={"reading": read - began, **watch.seconds, **found.seconds},
        groups=tuple(replace(one, perception=watch.figures) for one in found.groups),
    )


def calibrate_inputs(
    scene: Scene, inputs: SceneInputs, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None,
    keep: str | Path | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate from inputs that were read; arguments and errors as of `calibrate`.

    Cameras that share no people with the largest group are calibrated by themselves (`Calibration.groups`).
    """
    tell = progress or silent
    kept = None if keep is None else KeptTracklets(Path(keep) / FOLDER, len(inputs.rig))
    estimator = Estimator(scene, solver_options(scene), seed, tell, executor, kept)
    stated = scene.sites.groups if scene.solver.method == "people" else ()
    return calibrate_by_groups(inputs, stated, partial(_calibrate_together, estimator), tell)


def _calibrate_together(estimator: Estimator, inputs: SceneInputs) -> Calibration:
    """The calibration of cameras as one rig; those that share no people with its largest group have no pose.

    An estimate is six solves at most (`Estimator`). There is one, and one more for each correction: as many as there are
    cameras (`MotionRepair`), three of lenses, and six of clock rates where these are refined. The check of picture sizes adds
    one solve for each camera whose people keep to a part of the picture, and one.
    """
    scene, tell = estimator.scene, estimator.progress
    began = time.perf_counter()
    # The systems are small: more BLAS threads only wait for each other, and the number of them would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        motion = MotionRepair(inputs, scene.association.given, scene.scale.person_height_m)
        repairs = [Repair(find_clock_skew, MOST_CORRECTIONS)] if "clock_rate" in scene.solver.refine else []
        disagreement = partial(_disagreement, scene, seed=estimator.seed)
        worse = partial(is_worse, disagreement=disagreement)
        repairs.append(Repair(correct_late_clock, CLOCK_CORRECTIONS, worse))
        repairs.append(Repair(motion, len(inputs.rig)))
        lens = correct_lenses(
            apply_repairs(inputs, estimator, repairs), lambda other: apply_repairs(other, estimator, repairs), disagreement
        )  # fmt: skip
        repaired = lens.repaired
        motions = motion.measured_again(repaired.corrections, repaired.estimate)
        association = repaired.estimate.association
        shape = shape_of(repaired.estimate.solution, association.instants, scene.scale.person_height_m)
        held_out = _held_out(scene, repaired.estimate, estimator.seed)
        solution = _with_figures(scene, inputs, lens, motions, shape, held_out, estimator.seed)
        # Pixels that the scene states, and all results, are of the images as filmed.
        filmed = replace(solution, rig=turn_rig(solution.rig, undone(scene.turns)))
        solution, placed = check_known_scale(solution, align_to_scene(scene, filmed, inputs.elsewhere))
        checks = check_lengths(scene.scale.checks, placed.rig, adjusted(solution.figures).scale.relative_sigma)
        off = findings_of_checks(checks)
        predicted = _unpredicted(solution, held_out, association, inputs.gaps)
        sized = any(one.code == "smaller_image_fits" for one in lens.findings)
        doubts, notes = _doubts(scene, repaired.inputs, solution, association, None if sized else estimator)
        ground = notices_of_ground(shape, placed=scene.world is not None)
        misplaced = tuple(finding for finding in (*placed.findings, *off) if finding.severity == "doubt")
        unsettled = tuple(one for one in lens.of("notice") if one.code == "lens_doubtful")  # may explain what is uncertain
        causes = (*inputs.doubts, *findings_of_motions(motions, solution.rig), *lens.of("doubt"), *unsettled)
        solution = _decided(scene, solution, association, causes, (*predicted, *doubts, *misplaced, *ground))
    solved = time.perf_counter()
    rates = solution.figures.clock_rates or {}
    clocks = (*corrected_clocks(repaired.corrections), *clock_skew_findings(rates))
    said = tuple(one for one in lens.of("notice") if one not in unsettled)
    refined = (*said, *lens_notes(adjusted(solution.figures)), *clocks, *notes)
    unused = tuple(finding for finding in association.height_findings if finding.severity == "notice")
    frame = tuple(finding for finding in (*placed.findings, *off) if finding.severity == "notice")
    for note in (
        *texts_of((*refined, *association.notices, *unused, *frame)),
        f"{solution.verdict}{''.join(f': {reason}' for reason in solution.reasons[:1])}",
    ):
        tell_note(tell, note)
    upright, back = solution.rig, undone(scene.turns)
    seen = turn_observations(association.observations, upright, back)
    instants = turn_observations(association.instants, upright, back)
    return Calibration(
        scene=scene,
        rig=with_up(replace(placed.rig, verdict=solution.verdict), None if _states_up(scene) else solution.figures.up),
        verdict=solution.verdict,
        diagnostics=(*solution.findings, *inputs.findings, *association.notices, *unused, *refined, *frame),
        observations=seen,
        seed=estimator.seed,
        options=asdict(estimator.options),
        figures=replace(placed.figures, checks=checks or None),
        association=replace(association, observations=seen, instants=instants),
        clocked=bool(inputs.observations.clocks),
        wall_clock=inputs.wall_clock,
        world=placed.world,
        seconds={"solving": solved - began},
    )


def _states_up(scene: Scene) -> bool:
    """Whether `[world]` sets the up direction, by points, positions or lines."""
    return scene.world is not None and (scene.world.tilt or bool(scene.world.lines))


def _held_out(scene: Scene, estimate: Estimate, seed: int) -> HeldOut | None:
    """Of a rig of the person model; the paper's method knows no other adjustment."""
    if estimate.solution.method != "people":
        return None
    return hold_out(estimate.solution.rig, estimate.association.instants, scene.scale.person_height_m, seed)


def _unpredicted(
    solution: Solution, held_out: HeldOut | None, association: Association, gaps: Mapping[str, Spans]
) -> list[Finding]:
    """The cameras that predict people poorly, by the rig that was adjusted without some of them."""
    if solution.method != "people":
        return []
    rig = solution.rig if held_out is None else held_out.rig
    return findings_of_predictions(rig, predict_people(rig, association.instants, unrecorded_instants(gaps, association)))


def _disagreement(scene: Scene, estimate: Estimate, *, seed: int) -> float | None:
    """By how much people who were held out disagree with an estimate, as a share of their size; None where too few are."""
    found = _held_out(scene, estimate, seed)
    return None if found is None or found.figures is None else found.figures.held_out.median_share


def _with_figures(
    scene: Scene, inputs: SceneInputs, lens: LensOutcome, motions: Sequence[Motion], shape: GroundShape | None,
    held_out: HeldOut | None, seed: int,
) -> Solution:  # fmt: skip
    """The solution, its figures with those of the repairs, of the lenses, of the ground and of the people held out."""
    repaired = lens.repaired
    solution = repaired.estimate.solution
    rates = None
    if "clock_rate" in scene.solver.refine and (inputs.observations.clocks or inputs.observations.fps is not None):
        rates = clock_rate_figures(inputs, repaired.inputs, repaired.estimate)
    moved = tuple(one.figures for one in motions if isinstance(one, DetectedMotion))
    drifts = tuple(one.figures for one in motions if not isinstance(one, DetectedMotion)) or None
    up = up_figures(solution, repaired.estimate.association.instants, np.random.default_rng(seed))
    figures = replace(
        solution.figures, moved=moved, drifts=drifts, ground=ground_figures(shape), up=up, clock_rates=rates,
        held_out=None if held_out is None else held_out.figures,
    )  # fmt: skip
    if isinstance(figures, AdjustedFigures):
        figures = replace(figures, lenses=with_lens_priors(figures.lenses, inputs.rig))
        figures = with_unsettled_lenses(with_focal_changes(figures, lens.result), lens.result)
        figures = with_coarse_boxes(figures, inputs.doubts)
        if shape is not None and not (scene.world is not None and scene.world.tilt):
            figures = on_ground(figures, shape)
        solution = replace(solution, rig=with_measuring_sigmas(solution.rig, figures.measuring))
    return replace(solution, figures=figures)


def _doubts(
    scene: Scene, inputs: SceneInputs, solution: Solution, association: Association, estimator: Estimator | None,
) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:  # fmt: skip
    """Evidence against relying on the solution, and what is only to be noted of the ground and of people.

    Where there is no `estimator`, smaller images of several cameras at once are not tried.
    """
    tilted = find_tilted_ground(solution.figures.up, up_stated=_states_up(scene))
    sizes = [] if estimator is None else doubts_of_smaller_pictures(
        inputs.rig, inputs.observations, solution,
        lambda rig: estimator.solver(rig)(association.instants, known=association.known_heights),
    )  # fmt: skip
    places = doubts_of_same_place(solution.rig, inputs.observations)
    heights = [finding for finding in association.height_findings if finding.severity != "notice"]
    unusual = told_of_unusual(adjusted(solution.figures).people)
    doubts = (*places, *sizes, *association.doubts, *heights)
    return doubts, (*tilted, *unusual)


def _decided(
    scene: Scene, solution: Solution, association: Association, causes: Sequence[Finding], doubts: Sequence[Finding],
) -> Solution:  # fmt: skip
    """The solution with the verdict on it."""
    return judged(
        solution, association.instants, given=scene.association.given, why=association.lost, causes=causes,
        doubts=doubts,
    )  # fmt: skip


def _amount(inputs: SceneInputs) -> str:
    """How much there is to calibrate from, in words."""
    seen = inputs.observations
    boxes = sum(len(seen[name].boxes) for name in inputs.rig.names)
    joints = sum(len(seen[name].keypoints) for name in inputs.rig.names)
    return f"{len(inputs.rig)} cameras, {boxes} boxes" + (f", {joints} skeletons" if joints else "")
