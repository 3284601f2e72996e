"""Placement of a rig in a world by the bodies it sees: the last step where no person is seen from head to feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.geometry.rotations import rotation_between
from passerby.solver.body_segments import (
    GROUND_SD_M,
    SEGMENTS,
    Bodies,
    BodyScale,
    bodies_in_space,
    body_scale,
    ground_below,
    segments_agree,
)
from passerby.solver.body_vertical import BodyVertical, body_vertical, parts_agree
from passerby.solver.cue_terms import CueRows, WorldRows
from passerby.solver.cues import expected_heights, settle_cues
from passerby.solver.gauge import SCALE, TILT_X, TILT_Y, Z, held_system, similarity_freedoms
from passerby.solver.initialisation import PeopleOptions
from passerby.solver.optimizer.least_squares import Stopping, minimise
from passerby.solver.people_state import AdjustmentState
from passerby.solver.refinement import Fit


def placed_by_bodies(
    fit: Fit, observations: Observations, cues: ScaleCues, options: PeopleOptions, rng: np.random.Generator
) -> Fit:
    """Return the fit in a world whose scale, up direction and ground come from bodies, where nothing else determines them.

    Joints leave a similarity free. It is therefore estimated after the shape of the rig, and enters the problem as rows on all
    cameras. The fit is returned unchanged where a person is seen whole, where no trunk or arm is seen, and where segments
    contradict each other.

    Args:
        fit: the optimum.
        observations: the observations it was computed from.
        cues: known facts about the scale.
        options: limits of the last descent.
        rng: draws bodies where there are many.
    """
    state, problem, rows = fit.result.state, fit.model.problem, fit.start.knowledge.cues
    if len(problem.sightings) or any(finding.code == "keypoint_names_unfit" for finding in fit.start.evidence.findings):
        return fit
    _, free = held_system(fit.result.normal.reduce().H, state, problem.layout.camera_size)
    tied = np.setdiff1d(np.arange(len(state.R)), free.cameras)
    if len(tied) < 2:
        return fit
    rig = Rig(tuple(fit.start.rig.cameras[c] for c in tied))
    bodies = bodies_in_space(rig, state.R[tied], state.centre[tied], observations, rng)
    if bodies is None:
        return fit
    people = np.unique(bodies.identity)
    mean, sd = expected_heights(cues, people)
    if not (segments_agree(bodies, mean, people) and parts_agree(bodies)):
        return fit
    scale, vertical = body_scale(bodies, mean, sd, people), body_vertical(bodies)
    if scale is None and vertical is None:
        return fit
    placed, world = _placed(state, tied, rows, bodies, scale, vertical, people, mean)
    known = replace(rows or CueRows(), world=world)
    known = settle_cues(known, placed.R, placed.centre, np.zeros(0), np.zeros(0), np.zeros(0)) or known
    knowledge = replace(fit.start.knowledge, cues=known)
    model = replace(fit.model, problem=replace(problem, cues=known), state=placed)
    result = minimise(model.problem, model.state, Stopping(options.max_iterations, options.tolerance))
    return replace(fit, model=model, result=result, start=replace(fit.start, knowledge=knowledge))


def _placed(
    state: AdjustmentState, tied: Ints, rows: CueRows | None, bodies: Bodies, scale: BodyScale | None,
    vertical: BodyVertical | None, people: Ints, height_mean: Floats,
) -> tuple[AdjustmentState, WorldRows]:  # fmt: skip
    """Return the state in the world of the bodies, and rows that hold the cameras `tied` there with the bodies' sigmas."""
    planned = rows is not None and rows.plan is not None and len(rows.plan.camera) > 1
    measured = rows is not None and (len(rows.lengths) + len(rows.distances) > 0 or planned)
    log_factor = 0.0 if scale is None else scale.log_factor
    factor = 1.0 if measured else float(np.exp(log_factor))
    up = np.array([0.0, 0.0, 1.0])
    turn = np.eye(3) if vertical is None else rotation_between(vertical.up, up)
    ground = None
    if vertical is not None and (measured or scale is not None):
        ground = ground_below(bodies, vertical.up, factor, people, height_mean)
    placed = _moved(state, factor, turn, 0.0 if ground is None else ground[0])
    stated = rows is not None and len(rows.heights) > 0
    if rows is not None and stated:
        low = placed.centre[rows.height_of, 2] - rows.heights[:, 0]
        placed = _moved(placed, 1.0, np.eye(3), float(np.average(low, weights=1 / rows.heights[:, 1] ** 2)))
    along = similarity_freedoms(placed, tied).along
    held = []
    if scale is not None:
        held.append(along[SCALE : SCALE + 1] / scale.sd)
    if vertical is not None:
        held.append(np.linalg.cholesky(np.linalg.inv(_tilts(vertical, turn))).T @ along[[TILT_X, TILT_Y]])
    ground_by = None if ground is None or stated else ground[1]
    if ground_by is not None:
        held.append(along[Z : Z + 1] / GROUND_SD_M)
    trunk = None
    if scale is not None:
        usual = SEGMENTS[0].share * float(np.mean(height_mean))
        trunk = (usual, usual * scale.sd)
    world = WorldRows(
        placed.R, placed.centre, np.concatenate(held), along[SCALE], trunk, 0 if scale is None else scale.people,
        log_factor if measured else 0.0, None if ground_by is None else GROUND_SD_M, () if scale is None else scale.segments,
        () if vertical is None else vertical.parts, ground_by,
    )  # fmt: skip
    return placed, world


def _moved(state: AdjustmentState, factor: float, turn: Floats, ground: float) -> AdjustmentState:
    """Return the state scaled by `factor`, rotated by `turn` (3, 3), and lowered by `ground` metres."""

    def moved(points: Floats) -> Floats:
        return np.asarray(factor * points @ turn.T - np.array([0.0, 0.0, ground]))

    return replace(
        state, R=state.R @ turn.T, centre=moved(state.centre), joints=moved(state.joints),
        lengths=moved(state.lengths.reshape(-1, 3)).reshape(-1, 6),
    )  # fmt: skip


def _tilts(vertical: BodyVertical, turn: Floats) -> Floats:
    """Return the covariance (2, 2) of rotations about the world's x and y: a tilt of up by d is a rotation by z x d."""
    flat = (vertical.basis @ turn.T)[:, :2]
    about = flat @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return np.asarray(about.T @ vertical.covariance @ about)
