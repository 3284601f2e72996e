"""The person-model solver: from people with identities to a metric, gravity-aligned rig. No camera is a reference.

Data flow: evidence -> each camera's own vertical and ground -> hypotheses of camera pairs -> spanning trees by agreement ->
descent from each tree on a part of the evidence -> descent to the optimum on all of it -> covariance and verdict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.figures import CueFigures
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.lens_figures import LensFigures
from passerby.core.measuring import MeasuringFigures, add_measuring_sigmas
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.solution import Solution, decide_verdict
from passerby.core.synchronisation import USUAL_FPS
from passerby.core.unknown_focals import begin_with
from passerby.core.usability import add_missing_camera_doubts, doubts_of_uncertainty
from passerby.findings.finding import doubt, refusal
from passerby.findings.ranking import RefusalError
from passerby.geometry.two_view import PairHypothesis
from passerby.people.box_heights import heights_by_boxes
from passerby.solver.bodies_world import placed_by_bodies
from passerby.solver.cue_agreement import check_cue_consistency, known_cues, weigh_cues
from passerby.solver.cue_leverage import freed_measurements
from passerby.solver.cues import scale_cue_weights, settle_cues, triangulate_marks
from passerby.solver.findings import figures_of, find_separate_groups, height_noise, notices_about
from passerby.solver.initialisation import (
    Initialisation,
    InitialRig,
    JoinedRig,
    PeopleOptions,
    check_units,
    select_initial_rig,
    start_at,
)
from passerby.solver.measuring_uncertainty import measuring_uncertainty
from passerby.solver.pairs import MIN_MATCHES
from passerby.solver.people_cues import people_cues
from passerby.solver.people_state import AdjustmentState
from passerby.solver.pose_graph import connected_components, heading_rotation
from passerby.solver.refined_lenses import decide_refined_lenses, far_lenses, lens_figures
from passerby.solver.refinement import Fit, refine_rig
from passerby.solver.registrations import doubts_about_registrations
from passerby.solver.stated_lenses import refine_stated_lenses
from passerby.solver.systematic import ConsiderParameters
from passerby.solver.uncertainty import RigCovariance, add_learnt_stance, design_effect, joint_design_effect, rig_covariance
from passerby.solver.zones import ZONE_CAMERAS, ZonedRig, initial_rig_by_zones, seams_of

__all__ = ["PeopleOptions", "PeopleSolution", "solve_people"]

FEWEST_BOXED = 2
"""Smallest number of people for an estimate of the size of boxes, including the person whose height is measured."""
_RESTARTS = 2
"""Largest number of restarts from a new initial rig with better lenses."""


@dataclass(frozen=True, eq=False)
class PeopleSolution(Solution):
    """A solution with the optimum it was computed from, for tests of other explanations of the observations. Only the fields of
    `Solution` are written to files.
    """

    start: Initialisation | None = None
    fit: Fit | None = None
    covariance: RigCovariance | None = None
    fps: float | None = None
    """Time steps a second; None where that is unknown."""


def solve_people(
    rig: Rig, observations: Observations, cues: ScaleCues, options: PeopleOptions | None = None, *, rng: np.random.Generator,
    guesses: Sequence[PairHypothesis] = (), executor: Executor | None = None, begin: JoinedRig | None = None,
) -> Solution:  # fmt: skip
    """Calibrate a rig with the person model.

    Args:
        rig: names and lenses; poses in it are not read.
        observations: boxes and keypoints whose identities hold across cameras; some may be wrong.
        cues: what is known about the scale.
        options: see `PeopleOptions`.
        rng: drives RANSAC and the choice among too many observations.
        guesses: hypotheses of relative poses, found before; they are weighted by the observations that agree with them.
        executor: solves zones of a large rig in parallel; one after the other when None.
        begin: a rig joined from groups; then `guesses` are between all of its cameras, and no others are computed.

    Returns:
        The rig in a world with z up, the ground at z = 0, the first registered camera above the origin and looking along +y.
        Cameras that share too little with the largest group have no pose, and a finding reports them.

    Raises:
        RefusalError: no two cameras saw enough of the same people at the same instants.
    """
    options = options or PeopleOptions()
    stated = () if "distortion" in options.refine_lens else options.refine_lens
    if stated:
        options = replace(options, refine_lens=())

    # 1. Evidence, the vertical of each camera, and hypotheses of pairs; the largest group of cameras that they connect.
    start = Initialisation.prepare(rig, observations, cues, options, rng, guesses, begin)
    groups = connected_components(len(rig), start.hypotheses, MIN_MATCHES)
    if len(groups[0]) < 2:
        raise RefusalError(refusal("no_pair_fits", least=MIN_MATCHES))
    findings, among = find_separate_groups(rig, groups), list(guesses)
    if len(groups[0]) < len(rig):
        inside = Rig(tuple(rig.cameras[c] for c in groups[0]))
        among = [h for guess in guesses if (h := guess.among(groups[0])) is not None]
        start = Initialisation.prepare(inside, observations, cues, options, rng, among, begin)
    check_units(start)

    # 2. The initial rig, refined to the optimum; repeated where the refined lenses differ much from the initial ones.
    choice, zoned = _initial_rig(start, options, rng, executor, begin)
    fit = refine_rig(start, choice.state, options, rng)
    for _ in range(_RESTARTS):
        if start.near(fit.start):
            break
        # An initial rig with very wrong lenses may be in a wrong arrangement, or may have left people out.
        better = begin_with(start.stated, _observed(fit))
        start = Initialisation.prepare(better, observations, cues, options, rng, among, begin)
        try:
            choice, zoned = _initial_rig(start, options, rng, executor, begin)
        except EvidenceError:
            findings.append(doubt("reinitialisation_failed"))
            break
        fit = refine_rig(start, choice.state, options, rng)

    # 3. Refinement of stated lenses on request, and the world frame from bodies where no person is seen whole.
    refinement = None
    if stated:  # with its own random numbers: a refinement that is dropped changes nothing
        fit, refinement = refine_stated_lenses(fit, stated, options, rng.spawn(1)[0], observations.fps or USUAL_FPS)
    fit = placed_by_bodies(fit, observations, cues, options, rng)
    start = fit.start

    # 4. The covariance of the cameras, the scale cues, and the uncertainty of measurements with the rig.
    covariance, weighed, lenses = _estimate_uncertainty(start, fit, cues, observations)
    measuring = _measuring(start, fit, covariance)
    weighed, disagreements = check_cue_consistency(weighed)
    posed = add_measuring_sigmas(_placed(start.rig, fit.result.state, covariance), measuring)
    posed = _with_refined_sigmas(posed, lenses)
    whole = Rig(tuple(posed[c.name] if c.name in posed.names else Camera(c.name, c.lens) for c in rig))
    figures = replace(figures_of(start, choice, fit, covariance, weighed, lenses), measuring=measuring, refinement=refinement)

    # 5. Findings and the verdict.
    findings = [
        *start.evidence.findings,
        *findings,
        *choice.doubts,
        *notices_about(start, fit),
        *disagreements,
        *doubts_about_registrations(start.rig, start.hypotheses, fit.result.state.R, fit.result.state.centre),
        *far_lenses(lenses),
    ]
    findings = add_missing_camera_doubts(whole, findings)
    findings += doubts_of_uncertainty(whole, figures, findings)
    verdict = decide_verdict(whole, findings)
    if zoned is not None:
        seams = seams_of(zoned, start.rig, covariance, fit.result.state.R)
        figures = replace(figures, zones=zoned.figures(start.rig), seams=seams)
    return PeopleSolution(
        "people", replace(whole, verdict=verdict), verdict, tuple(findings), figures, start, fit, covariance, observations.fps
    )  # fmt: skip


def _initial_rig(
    start: Initialisation,
    options: PeopleOptions,
    rng: np.random.Generator,
    executor: Executor | None,
    begin: JoinedRig | None,
) -> tuple[InitialRig, ZonedRig | None]:
    """Return the initial rig, and the zones that it was joined from; None where it was not computed by zones."""
    if begin is not None:
        return start_at(start, begin, options, rng), None
    zoned = initial_rig_by_zones(start, options, rng, executor) if len(start.rig) > ZONE_CAMERAS else None
    return (select_initial_rig(start, options, rng), None) if zoned is None else (zoned.rig, zoned)


def _estimate_uncertainty(
    start: Initialisation, fit: Fit, cues: ScaleCues, observations: Observations
) -> tuple[RigCovariance, list[CueFigures], dict[str, LensFigures]]:
    """Return the covariance of the cameras, the figures of the scale cues, and the figures of the refined lenses."""
    state, knowledge = fit.result.state, start.knowledge
    seen = np.unique(fit.model.problem.person)
    terms = replace(fit.model.problem, lens_weight=np.ones(()), group_weight=1.0).terms(state, jacobians=True)
    inflation = design_effect(fit.model, start.evidence, terms)
    expected = knowledge.height_mean[seen], knowledge.height_weight_sd[seen]
    rows = settle_cues(knowledge.cues, state.R, state.centre, state.heights[seen], *expected)
    report, sigma = scale_cue_weights(
        cues, rows, state.R, state.centre, triangulate_marks(rows, state.R, state.centre), state.heights[seen], *expected,
        start.evidence.identities[seen], 1.0 if rows is None or rows.world is None else rows.world.factor(state),
        _heights_by_boxes(start, state, observations) if cues.people else None,
        None if rows is None else freed_measurements(rows, state, fit.model.problem.layout, fit.result.normal, inflation),
        None if knowledge.unusual is None else knowledge.unusual[seen],
        None if knowledge.height_spread is None else knowledge.height_spread[seen],
    )  # fmt: skip
    # With noisy boxes, the scale is biased by about the variance of their heights: 7 % too small at 27 % of noise.
    report += people_cues(_posed(start.rig, state), observations)
    more = weigh_cues(known_cues(report)).more_variance
    sigma = float(np.linalg.norm([sigma, height_noise(fit, start.evidence) ** 2, np.sqrt(more)]))
    terms = add_learnt_stance(terms, fit.result.normal)
    estimated = start.unknowns.parts
    held = ConsiderParameters.of_lenses(start.rig, fit.model.problem, state, estimated)
    of_joints = joint_design_effect(fit.model, start.evidence, terms)
    lenses = decide_refined_lenses(start.unknowns, start.stated, fit.model.problem, state, inflation, of_joints, held)
    # Without intrinsics, the adjustment's joint covariance of lenses and poses includes the common errors of boxes.
    lens_sigma = None if lenses is None or fit.model.problem.lens_normal else lenses.sigma
    covariance = rig_covariance(terms, fit.model.problem, state, inflation, sigma, lens_sigma, held, of_joints, estimated)
    return covariance, report, lens_figures(lenses, start.stated, start.rig)


def _measuring(start: Initialisation, fit: Fit, covariance: RigCovariance) -> MeasuringFigures | None:
    """Return the uncertainty of points and of the ground where people walked, or where their joints were."""
    state, boxes, joints = fit.result.state, fit.model.problem.sightings, fit.model.problem.joints
    whose, camera, at = (
        (boxes.block, boxes.camera, state.people) if len(state.people) else (joints.point, joints.camera, state.joints)
    )
    height_m = float(np.median(state.heights)) if len(state.heights) else 0.0
    seen = np.zeros((len(start.rig), len(at)), dtype=bool)
    seen[camera, whose] = True
    rig, groups = _posed(start.rig, state), start.knowledge.groups
    return measuring_uncertainty(rig, covariance.complete, at[:, :2], seen, height_m, covariance.free, groups)


def _observed(fit: Fit) -> Rig:
    """Return the cameras with the poses and lenses of an optimum; without a pose where no observation agrees."""
    problem, rig = fit.model.problem, _posed(fit.start.rig, fit.result.state)
    agreeing = np.isin(np.arange(len(rig)), np.concatenate([problem.sightings.camera, problem.joints.camera]))
    return Rig(tuple(one if seen else replace(one, pose=None) for one, seen in zip(rig, agreeing, strict=True)))


def _posed(rig: Rig, state: AdjustmentState) -> Rig:
    """Return the cameras with the poses of a state, in its world."""
    poses = (Pose.from_centre(R, centre) for R, centre in zip(state.R, state.centre, strict=True))
    return Rig(tuple(replace(camera, pose=pose) for camera, pose in zip(rig, poses, strict=True)))


def _heights_by_boxes(start: Initialisation, state: AdjustmentState, observations: Observations) -> dict[int, float]:
    """Return identity -> height from boxes, metres, over the median ratio of heights from boxes to those of the rig."""
    boxed = heights_by_boxes(_posed(start.rig, state), observations)
    adjusted = dict(zip(start.evidence.identities.tolist(), state.heights.tolist(), strict=True))
    ratios = [height / adjusted[identity] for identity, height in boxed.items() if identity in adjusted]
    if len(ratios) < FEWEST_BOXED:
        return {}
    return {identity: height / float(np.median(ratios)) for identity, height in boxed.items()}


def _with_refined_sigmas(rig: Rig, lenses: Mapping[str, LensFigures]) -> Rig:
    """Return the rig with the sigmas of refined focal lengths in place of guessed ones; `lenses` as from `lens_figures`."""
    cameras = []
    for camera in rig:
        parts = lenses.get(camera.name)
        focal = None if parts is None else parts.focal
        if focal is not None and camera.lens.focal_sd is not None:
            sd = float(np.clip(focal.sigma_px / focal.refined_px, 1e-6, LARGEST_FOCAL_SD))
            camera = replace(camera, lens=replace(camera.lens, focal_sd=sd, uncalibrated=False))
        cameras.append(camera)
    return replace(rig, cameras=tuple(cameras))


def _placed(rig: Rig, state: AdjustmentState, covariance: RigCovariance) -> Rig:
    """Return the rig with poses and sigmas, the first camera above the origin, looking along +y."""
    turn = heading_rotation(state.R[0])
    shift = -turn @ np.array([*state.centre[0, :2], 0.0])
    cameras = []
    for c, camera in enumerate(rig):
        pose = Pose.from_centre(state.R[c], state.centre[c]).moved(turn, shift)
        cameras.append(Camera(camera.name, camera.lens, pose, covariance.sigma(c).moved(turn)))
    return Rig(tuple(cameras))
