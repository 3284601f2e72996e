"""The person-model solver: from people with identities to a metric, gravity-aligned rig. No camera is special.

Data flow: evidence -> each camera's own vertical and ground -> hypotheses of camera pairs -> spanning trees by agreement ->
descent from each tree on a part of the evidence -> descent to the optimum on all of it -> covariance and verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera, Pose, Rig
from passerby.errors import EvidenceError, InputError
from passerby.geometry.rotations import angle_between
from passerby.geometry.similarity import chordal_mean_rotation
from passerby.geometry.single_view import Level, level_camera
from passerby.observations import Observations
from passerby.solver.assembly import candidate_trees, components, cycle_support, heading_rotation, levelled, poses_of_tree
from passerby.solver.cues import cue_rows, expected_heights, first_scale, report_pull, triangulate_marks
from passerby.solver.evidence import Evidence, gather_evidence
from passerby.solver.least_squares import Result, Stopping
from passerby.solver.lens_check import FocalCheck, check_focals
from passerby.solver.pairs import MIN_MATCHES, PairHypothesis, pair_hypotheses
from passerby.solver.person_model import Noise, PeopleState, Priors
from passerby.solver.refinement import AGREE_SIGMAS, Knowledge, Model, RigState, adjust, build_model, learn_noise, rig_of
from passerby.solver.scale import ScaleCues
from passerby.solver.solution import Solution, Verdict
from passerby.solver.standing import standing_instants
from passerby.solver.uncertainty import RigCovariance, correlation_inflation, rig_covariance

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Descents from different trees that end with at least this share of the best one's agreeing sightings are rivals of it, and
# rivals are the same rig when no two cameras stand to each other by more than this angle differently.
_RIVAL_SHARE = 0.97
_RIVAL_ANGLE = np.deg2rad(4.0)
# A coarse descent stops here; the optimum needs more evidence anyhow.
_COARSE = Stopping(15, 1e-4)
# A pose whose sigma exceeds these is no calibration: of the rig's extent, and in degrees.
_MAX_POSITION_SHARE = 0.05
_MAX_ORIENTATION_DEG = 2.0
_MAX_VERTICAL_DEG = 5.0
_MAX_CUE_SIGMAS = 4.0
_MIN_AGREEING = 0.4
_MIN_SIGHTINGS = 20


@dataclass(frozen=True)
class PeopleOptions:
    """Options of the person-model solver."""

    max_sightings: int = 30_000
    """Most sightings of people that enter the adjustment; above, person-instants are drawn at random."""
    max_joints: int = 24_000
    """Most sightings of joints, likewise."""
    coarse_people: int = 400
    """Person-instants of the descents that choose among the first guesses."""
    coarse_joints: int = 1500
    """Joints of the same."""
    learning_people: int = 1500
    """Person-instants of the first round, which learns how noisy the sightings are."""
    learning_joints: int = 6000
    """Joints of the same."""
    rounds: int = 3
    """Most rounds of agreement, adjustment and learnt noise on all of the evidence."""
    max_iterations: int = 60
    """Iterations of the adjustment in each round."""
    tolerance: float = 1e-6
    """Relative decrease of the cost at which a round has converged."""

    def __post_init__(self) -> None:
        for name in (
            "max_sightings",
            "max_joints",
            "coarse_people",
            "coarse_joints",
            "learning_people",
            "learning_joints",
            "rounds",
            "max_iterations",
        ):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}: it must be 1 or more")
        if not 0 < self.tolerance < 1:
            raise InputError(f"tolerance is {self.tolerance}: it must lie between 0 and 1")


def solve_people(
    rig: Rig, observations: Observations, cues: ScaleCues, options: PeopleOptions | None = None, *, rng: np.random.Generator
) -> Solution:
    """Calibrate a rig with the person model.

    Args:
        rig: names and lenses; poses in it are not read.
        observations: boxes and keypoints whose identities hold across cameras; some may be wrong.
        cues: what is known about the scale.
        options: see `PeopleOptions`.
        rng: drives RANSAC and the choice among too many observations.

    Returns:
        The rig in a world with z up, the ground at z = 0, the first registered camera above the origin and looking along +y.
        Cameras that share too little with the largest group have no pose, and a reason.

    Raises:
        EvidenceError: no two cameras saw enough of the same people at the same instants.
    """
    options = options or PeopleOptions()
    first = _Start.prepare(rig, observations, cues, options, rng)
    groups = components(len(rig), first.hypotheses, MIN_MATCHES)
    if len(groups[0]) < 2:
        raise EvidenceError(
            f"no two cameras share {MIN_MATCHES} sightings of the same people that fit one motion: check the identities and "
            "the intrinsics, or record more people where the views overlap"
        )
    reasons = _apart(rig, groups)
    start = first
    if len(groups[0]) < len(rig):
        inside = Rig(tuple(rig.cameras[c] for c in groups[0]))
        start = _Start.prepare(inside, observations, cues, options, rng)
    choice = _choose(start, options, rng)
    fit = _descend(start, choice.state, options, rng)
    covariance, cue_report = _sure(start, fit, cues)
    focals = check_focals(start.rig, fit.model.problem, fit.result.state, covariance.inflation)
    posed = _placed(start.rig, fit.result.state, covariance)
    whole = Rig(tuple(posed[c.name] if c.name in posed.names else Camera(c.name, c.lens) for c in rig))
    reasons = [
        *start.evidence.notes,
        *reasons,
        *choice.doubts,
        *_doubts(start, fit, covariance),
        *_contradictions(cue_report),
        *_wrong_lenses(focals),
    ]
    verdict: Verdict = "doubtful" if reasons else "accepted"
    figures = _figures(start, choice, fit, covariance, cue_report, focals)
    return Solution("people", replace(whole, verdict=verdict), verdict, tuple(reasons), figures)


@dataclass(frozen=True, eq=False)
class _Start:
    """All that is known before the first descent."""

    rig: Rig
    evidence: Evidence
    levels: list[Level | None]
    hypotheses: list[PairHypothesis]
    knowledge: Knowledge

    @classmethod
    def prepare(
        cls, rig: Rig, observations: Observations, cues: ScaleCues, options: PeopleOptions, rng: np.random.Generator
    ) -> _Start:
        evidence = gather_evidence(rig, observations, rng, max_sightings=options.max_sightings, max_joints=options.max_joints)
        mean, sd = expected_heights(cues, evidence.identities)
        body_m = float(np.median(mean)) if len(mean) else cues.population.mean_m
        levels = [_level(evidence, c, body_m, rng) for c in range(len(rig))]
        focal = np.array([camera.lens.focal for camera in rig])
        hypotheses = pair_hypotheses(evidence, levels, focal, body_m, rng)
        return cls(rig, evidence, levels, hypotheses, Knowledge(mean, sd, Priors(), cue_rows(cues, rig)))


@dataclass(frozen=True, eq=False)
class _Choice:
    """The rough rig that most sightings agree with, and what competes with it."""

    state: RigState
    tree: str
    agreeing: int
    candidates: list[dict[str, Any]]
    doubts: list[str]


@dataclass(frozen=True, eq=False)
class _Fit:
    """The optimum."""

    model: Model
    result: Result[PeopleState]
    noise: Noise
    stance: Floats
    rounds: list[dict[str, Any]] = field(default_factory=list)


def _level(evidence: Evidence, camera: int, body_m: float, rng: np.random.Generator) -> Level | None:
    s = evidence.sightings.take(evidence.sightings.camera == camera)
    span, foot = body_m * (s.top_fraction - s.bottom_fraction), body_m * s.bottom_fraction
    return level_camera(s.top, s.bottom, s.top_tangent, s.extent_px, span, foot, rng)


def _apart(rig: Rig, groups: list[list[int]]) -> list[str]:
    names = [", ".join(rig.names[c] for c in group) for group in groups]
    return [
        f"{'cameras' if len(group) > 1 else 'camera'} {name} could not be joined to {names[0]}: too few of the same people "
        "were seen by both at the same instants; record people who walk through both views"
        for group, name in zip(groups[1:], names[1:], strict=True)
    ]


def _choose(start: _Start, options: PeopleOptions, rng: np.random.Generator) -> _Choice:
    """Descend from every tree on a part of the evidence, and keep the rig that most sightings agree with."""
    evidence, knowledge, n = start.evidence, start.knowledge, len(start.rig)
    blocks = np.sort(rng.permutation(len(evidence.person))[: options.coarse_people])
    joints = np.sort(rng.permutation(evidence.n_joints)[: options.coarse_joints])
    found = []
    for name, tree in candidate_trees(start.hypotheses, range(n), n):
        poses = levelled(poses_of_tree(tree, 0), start.levels)
        R, centre = np.array([poses[c].R_cw for c in range(n)]), np.array([poses[c].centre for c in range(n)])
        state = _rescaled(start, R, centre)
        for noise, share in ((Noise(loss=30.0), 0.4), (Noise(), 0.2)):
            model = build_model(evidence, state, noise, knowledge, share=share, blocks=blocks, joints=joints)
            if not (len(model.rows) or len(model.joint_rows)):
                break
            state = rig_of(adjust(model, _COARSE).state)
        model = build_model(evidence, state, Noise(), knowledge, share=0.1, blocks=blocks, joints=joints)
        found.append((len(model.rows) + len(model.joint_rows), name, state))
    if not found or max(count for count, _, _ in found) == 0:
        raise EvidenceError("no arrangement of the cameras agrees with the people: check their identities and the intrinsics")
    best = max(found, key=lambda item: item[0])
    rivals = [name for count, name, state in found if count > _RIVAL_SHARE * best[0] and _differ(state, best[2]) > _RIVAL_ANGLE]
    doubts = [
        "two arrangements of the cameras fit the people almost equally well: record people who walk in more directions"
    ] if rivals else []  # fmt: skip
    return _Choice(best[2], best[1], best[0], [{"tree": name, "agreeing": count} for count, name, _ in found], doubts)


def _rescaled(start: _Start, R: Floats, centre: Floats) -> RigState:
    """A first state with the scale that people and cues agree on."""
    knowledge = start.knowledge
    marks = triangulate_marks(knowledge.cues, R, centre)
    sd = float(np.mean(knowledge.height_sd / knowledge.height_mean)) if len(knowledge.height_sd) else 0.05
    factor = first_scale(knowledge.cues, centre, marks, len(knowledge.height_sd), sd)
    state = RigState.start(R, centre * factor, knowledge.height_mean * factor, knowledge.priors, marks * factor)
    return state


def _differ(a: RigState, b: RigState) -> float:
    """The largest angle between two rigs' relative rotations after the best common turn."""
    turn = chordal_mean_rotation(np.einsum("cji,cjk->cik", a.R, b.R))
    return float(np.max(angle_between(a.R @ turn, b.R)))


def _descend(start: _Start, state: RigState, options: PeopleOptions, rng: np.random.Generator) -> _Fit:
    """Rounds on all of the evidence: who agrees, where is the optimum, how noisy is it, who stands."""
    evidence = start.evidence
    noise, stance, share = Noise(), np.ones(len(evidence.person)), 0.15
    rounds: list[dict[str, Any]] = []
    for number in range(options.rounds):
        last = number == options.rounds - 1
        part = number == 0 and not last
        blocks = np.sort(rng.permutation(len(evidence.person))[: options.learning_people]) if part else None
        joints = np.sort(rng.permutation(evidence.n_joints)[: options.learning_joints]) if part else None
        model = build_model(
            evidence, state, noise, start.knowledge, share=share, blocks=blocks, joints=joints, stance=stance, rename=number > 0
        )
        stopping = Stopping(options.max_iterations, options.tolerance) if last else Stopping(12, 1e-4)
        result = adjust(model, stopping)
        state = rig_of(result.state)
        rounds.append(
            {
                "sightings": len(model.rows), "renamed": model.renamed, "joints": len(model.joint_rows),
                "iterations": result.iterations,
                "converged": result.converged, "cost": result.cost,
            }
        )  # fmt: skip
        if last:
            break
        noise = learn_noise(model, result)
        stance = _stance(model, result.state, len(evidence.person))
        share = AGREE_SIGMAS * max(noise.centre if len(model.rows) else 0.0, noise.joint if evidence.n_joints else 0.0)
    return _Fit(model, result, noise, stance, rounds)


def _stance(model: Model, state: PeopleState, n_blocks: int) -> Floats:
    """(N,) who may be standing, over all person-instants of the evidence."""
    out = np.ones(n_blocks)
    person = model.problem.person
    if len(person):
        extent = state.people[:, 3] - state.people[:, 2]
        out[model.blocks] = standing_instants(extent, state.heights[person], person)
    return out


def _sure(start: _Start, fit: _Fit, cues: ScaleCues) -> tuple[RigCovariance, dict[str, Any]]:
    """The covariance of the cameras, and what the scale rests on."""
    state, knowledge = fit.result.state, start.knowledge
    seen = np.unique(fit.model.problem.person)
    report, sigma = report_pull(
        cues, knowledge.cues, state.centre, state.globals[1:].reshape(-1, 3), state.heights[seen], knowledge.height_mean[seen],
        knowledge.height_sd[seen], start.evidence.identities[seen],
    )  # fmt: skip
    terms = fit.model.problem.terms(state, jacobians=True)
    inflation = correlation_inflation(fit.model, start.evidence, terms)
    covariance = rig_covariance(terms, fit.model.problem.layout, state, inflation, sigma)
    return covariance, {"relative_sigma": sigma, "cues": report}


def _placed(rig: Rig, state: PeopleState, covariance: RigCovariance) -> Rig:
    """The rig with the first camera above the origin, looking along +y."""
    turn = heading_rotation(state.R[0])
    shift = -turn @ np.array([*state.centre[0, :2], 0.0])
    cameras = []
    for c, camera in enumerate(rig):
        pose = Pose.from_centre(state.R[c], state.centre[c]).moved(turn, shift)
        sigma = covariance.sigma(c)
        block = np.eye(6)
        block[:3, :3] = turn
        assert sigma.covariance is not None
        cameras.append(Camera(camera.name, camera.lens, pose, replace(sigma, covariance=block @ sigma.covariance @ block.T)))
    return Rig(tuple(cameras))


def _doubts(start: _Start, fit: _Fit, covariance: RigCovariance) -> list[str]:
    """What speaks against the optimum, by camera."""
    out = []
    state, model, rig = fit.result.state, fit.model, start.rig
    total = np.bincount(start.evidence.sightings.camera, minlength=len(rig)) + np.bincount(
        start.evidence.joints.camera, minlength=len(rig)
    )
    used = np.bincount(model.problem.sightings.camera, minlength=len(rig)) + np.bincount(
        model.problem.joints.camera, minlength=len(rig)
    )
    extent = float(np.max(np.linalg.norm(state.centre - state.centre.mean(axis=0), axis=1))) + 1.0
    for c, camera in enumerate(rig):
        sigma = covariance.shape_sigma(c)
        if used[c] < _MIN_SIGHTINGS:
            out.append(f"camera {camera.name} rests on {used[c]} sightings only: record more people in its view")
        elif used[c] < _MIN_AGREEING * total[c]:
            out.append(
                f"camera {camera.name}: only {used[c]} of {total[c]} sightings agree with the rig: check its intrinsics, its "
                "clock and the identities"
            )
        if sigma.position_m > _MAX_POSITION_SHARE * extent or sigma.orientation_deg > _MAX_ORIENTATION_DEG:
            out.append(
                f"camera {camera.name} is uncertain by {1000 * sigma.position_m:.0f} mm and {sigma.orientation_deg:.1f} "
                "degrees: record longer, or people nearer to it and in more places"
            )
    if covariance.vertical_deg > _MAX_VERTICAL_DEG:
        out.append(
            f"the vertical is uncertain by {covariance.vertical_deg:.1f} degrees: record people who walk about, "
            "seen from head to feet"
        )
    if not fit.result.converged:
        out.append("the adjustment did not converge: raise [solver.options] max_iterations")
    return out


def _wrong_lenses(focals: list[FocalCheck]) -> list[str]:
    return [
        f"camera {check.camera}: people fit a focal length {100 * abs(np.expm1(check.change)):.0f} % "
        f"{'longer' if check.change > 0 else 'shorter'} than stated: check its intrinsics"
        for check in focals
        if check.wrong
    ]


def _contradictions(scale: dict[str, Any]) -> list[str]:
    return [
        f"the scale cue '{cue['cue']}' says {cue['stated_m']:.3f} m, but the rest makes it {cue['measured_m']:.3f} m, "
        f"{abs(cue['residual_sigmas']):.0f} sigmas off: check it"
        for cue in scale["cues"]
        if abs(cue["residual_sigmas"]) > _MAX_CUE_SIGMAS
    ]


def _figures(
    start: _Start, choice: _Choice, fit: _Fit, covariance: RigCovariance, scale: dict[str, Any], focals: list[FocalCheck]
) -> dict[str, Any]:
    """JSON-ready figures of every stage."""
    state, model, rig = fit.result.state, fit.model, start.rig
    support = cycle_support(start.hypotheses, len(rig))
    sightings = model.problem.sightings
    terms = model.problem.terms(state, jacobians=False)
    residual_px = np.linalg.norm(terms[0].residual, axis=1) * model.problem.centre_sigma() if len(sightings) else np.zeros(0)
    cameras = []
    for c, camera in enumerate(rig):
        own = sightings.camera == c
        level = start.levels[c]
        within = covariance.shape_sigma(c)
        cameras.append(
            {
                "name": camera.name, "sightings": int(np.count_nonzero(start.evidence.sightings.camera == c)),
                "agreeing": int(np.count_nonzero(own)),
                "joints": int(np.count_nonzero(model.problem.joints.camera == c)),
                "median_residual_px": float(np.median(residual_px[own])) if own.any() else None,
                "slack": float(state.slack[c]),
                "focal_change": focals[c].change, "focal_change_sigma": focals[c].sigma,
                "shape_position_sigma_mm": 1000 * within.position_m,
                "shape_orientation_sigma_deg": within.orientation_deg,
                "own_level": None if level is None else {"height_m": level.height, "residual": level.residual},
            }
        )  # fmt: skip
    noise = fit.noise
    return {
        "cameras": cameras,
        "pairs": [
            {
                "cameras": [rig.names[h.a], rig.names[h.b]], "route": h.route, "inliers": h.inliers, "matches": h.matches,
                "support": float(agreement),
            }
            for h, agreement in zip(start.hypotheses, support, strict=True)
        ],
        "trees": choice.candidates, "tree": choice.tree, "rounds": fit.rounds,
        "noise": {"floor_px": noise.floor_px, "centre": noise.centre, "height": noise.height, "joint": noise.joint},
        "people": {
            "identities": len(np.unique(model.problem.person)), "instants": len(model.problem.person),
            "standing": float(np.mean(fit.stance[model.blocks])) if len(model.blocks) else None,
            "heights_m": {
                str(start.evidence.identities[p]): float(state.heights[p]) for p in np.unique(model.problem.person)
            },
        },
        "foot_shift": float(state.globals[0]), "scale": scale | {"relative_sigma": covariance.scale},
        "vertical_sigma_deg": covariance.vertical_deg, "covariance_inflation": covariance.inflation,
    }  # fmt: skip
