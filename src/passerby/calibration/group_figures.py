"""Figures of the rig of one group of cameras, and the checks of it that use its people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.association.result import Association
from passerby.calibration.camera_motion import DetectedMotion, Motion
from passerby.calibration.clock_skew import clock_rate_figures
from passerby.calibration.diagnostics.ground_planarity import ground_figures, on_ground
from passerby.calibration.diagnostics.smaller_pictures import doubts_of_smaller_pictures
from passerby.calibration.diagnostics.up_direction import up_figures
from passerby.calibration.held_out import HeldOut, hold_out
from passerby.calibration.lens_corrections import LensExamination, with_focal_changes, with_unsettled_lenses
from passerby.calibration.lens_priors import with_lens_priors
from passerby.calibration.prediction import findings_of_predictions, predict_people
from passerby.calibration.run import CalibrationRun, Estimate
from passerby.calibration.separate_groups import GroupEstimate
from passerby.calibration.unrecorded import unrecorded_instants
from passerby.core.figures import AdjustedFigures, adjusted
from passerby.core.measuring import add_measuring_sigmas
from passerby.core.solution import Solution
from passerby.findings.finding import Finding
from passerby.people.ground_shape import GroundShape
from passerby.scene.box_interpretations import adjust_for_coarse_boxes
from passerby.scene.inputs import SceneInputs


def add_figures(
    run: CalibrationRun, stated: SceneInputs, inputs: SceneInputs, estimate: Estimate, lenses: LensExamination,
    motions: Sequence[Motion], shape: GroundShape | None, held_out: HeldOut | None,
) -> Solution:  # fmt: skip
    """Add the figures of corrections, lenses, the ground, the up direction and held-out people to a solution."""
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


def hold_out_people(run: CalibrationRun, estimate: Estimate) -> HeldOut | None:
    """Adjust the rig again without held-out people; None for method `geopose`, which has no such adjustment."""
    if estimate.solution.method != "people":
        return None
    return hold_out(estimate.solution.rig, estimate.association.instants, run.scene.scale.person_height_m, run.seed)


def check_predictions(
    solution: Solution, held_out: HeldOut | None, association: Association, found: GroupEstimate
) -> list[Finding]:
    """Find the cameras that predict people poorly, by the rig that was adjusted without held-out people, if there is one.

    Predictions between the groups on both sides of a door are not used: the relative pose of the groups limits them, and its
    uncertainty is in the sigmas.
    """
    if solution.method != "people":
        return []
    rig = solution.rig if held_out is None else held_out.rig
    outcomes = predict_people(rig, association.instants, unrecorded_instants(found.stated.gaps, association))
    for door in found.doors:
        first, second = (np.isin(np.array(rig.names), group) for group in (door.first, door.second))
        across = (first[outcomes.by] & second[outcomes.within]) | (second[outcomes.by] & first[outcomes.within])
        outcomes = outcomes.take(~across)
    boxed = any(len(seen.boxes) for seen in association.instants.cameras.values())
    return findings_of_predictions(rig, outcomes, adjusted(solution.figures).noise if boxed else None)


def check_image_sizes(run: CalibrationRun, found: GroupEstimate, solution: Solution, association: Association) -> list[Finding]:
    """Find images that are smaller than the lens is for, except those that were already found camera by camera."""
    known = {name for one in found.lenses.findings if one.code == "smaller_image_fits" for name in one.cameras}
    doubts = doubts_of_smaller_pictures(run, found.stated.rig, found.inputs.observations, solution, association)
    return [one for one in doubts if not known.issuperset(one.cameras)]
