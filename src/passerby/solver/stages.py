"""The stages of the person-model solver, each a function from what is known to what is known after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Rig
from passerby.errors import EvidenceError, InputError
from passerby.geometry.rotations import angle_between
from passerby.geometry.similarity import chordal_mean_rotation
from passerby.geometry.single_view import Level, level_camera
from passerby.observations import Observations
from passerby.solver.assembly import candidate_trees, levelled, poses_of_tree
from passerby.solver.cues import cue_rows, expected_heights, first_scale, triangulate_marks
from passerby.solver.evidence import Evidence, gather_evidence
from passerby.solver.least_squares import Result, Stopping
from passerby.solver.pairs import PairHypothesis, judged_guesses, pair_hypotheses
from passerby.solver.people_state import Noise, PeopleState, Priors
from passerby.solver.refinement import (
    AGREE_SIGMAS,
    Knowledge,
    Model,
    RigState,
    adjust,
    build_model,
    learn_noise,
    rig_of,
    wholeness,
)
from passerby.solver.scale import ScaleCues
from passerby.solver.standing import standing_instants

Floats = NDArray[np.float64]

# Descents from different trees that end with at least this share of the best one's agreeing sightings are rivals of it, and
# rivals are the same rig when no two cameras stand to each other by more than this angle differently.
_RIVAL_SHARE = 0.97
_RIVAL_ANGLE = np.deg2rad(4.0)
# Noise that is learnt from what agrees within a tolerance is too small where that is narrow: rounds go on, by so many at most,
# while it grows by more than this factor.
_GROWTH, _MORE_ROUNDS = 1.15, 4
# A coarse descent stops here; the optimum needs more evidence anyhow.
_COARSE = Stopping(15, 1e-4)


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
    """Rounds of agreement, adjustment and learnt noise on all of the evidence; some more while the noise learnt still grows."""
    max_iterations: int = 60
    """Iterations of the adjustment in each round."""
    tolerance: float = 1e-6
    """Relative decrease of the cost at which a round has converged."""
    refine_time: bool = False
    """Whether each camera's clock has an unknown error; takes observations whose frame rate is known."""

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


@dataclass(frozen=True, eq=False)
class Start:
    """All that is known before the first descent."""

    rig: Rig
    evidence: Evidence
    levels: list[Level | None]
    hypotheses: list[PairHypothesis]
    knowledge: Knowledge

    @classmethod
    def prepare(
        cls, rig: Rig, observations: Observations, cues: ScaleCues, options: PeopleOptions, rng: np.random.Generator,
        guesses: Sequence[PairHypothesis] = (),
    ) -> Start:  # fmt: skip
        """Gather the evidence, level each camera, and guess at all pairs; `guesses` are more of the same."""
        evidence = gather_evidence(
            rig, observations, rng, max_sightings=options.max_sightings, max_joints=options.max_joints,
            moving=options.refine_time,
        )  # fmt: skip
        mean, sd = expected_heights(cues, evidence.identities)
        body_m = float(np.median(mean)) if len(mean) else cues.population.mean_m
        levels = [level_of(evidence, c, body_m, rng) for c in range(len(rig))]
        focal = np.array([camera.lens.focal for camera in rig])
        hypotheses = pair_hypotheses(evidence, levels, focal, body_m, rng)
        hypotheses += judged_guesses(guesses, evidence, focal, body_m)
        return cls(rig, evidence, levels, hypotheses, Knowledge(mean, sd, Priors(), cue_rows(cues, rig)))


@dataclass(frozen=True, eq=False)
class Choice:
    """The rough rig that most sightings agree with, and what competes with it."""

    state: RigState
    tree: str
    agreeing: int
    candidates: list[dict[str, Any]]
    doubts: list[str]


@dataclass(frozen=True, eq=False)
class Fit:
    """The optimum."""

    model: Model
    result: Result[PeopleState]
    noise: Noise
    stance: Floats
    rounds: list[dict[str, Any]] = field(default_factory=list)


def level_of(evidence: Evidence, camera: int, body_m: float, rng: np.random.Generator) -> Level | None:
    """The vertical and the height of one camera from its own people, as tall as `body_m`; None where there are too few."""
    s = evidence.sightings.take(evidence.sightings.camera == camera)
    span, foot = body_m * (s.top_fraction - s.bottom_fraction), body_m * s.bottom_fraction
    return level_camera(s.top, s.bottom, s.top_tangent, s.extent_px, span, foot, rng)


def choose(start: Start, options: PeopleOptions, rng: np.random.Generator) -> Choice:
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
    return Choice(best[2], best[1], best[0], [{"tree": name, "agreeing": count} for count, name, _ in found], doubts)


def _rescaled(start: Start, R: Floats, centre: Floats) -> RigState:
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


def descend(start: Start, state: RigState, options: PeopleOptions, rng: np.random.Generator) -> Fit:
    """Rounds on all of the evidence: who agrees, where is the optimum, how noisy is it, who stands."""
    evidence = start.evidence
    noise, stance, share = Noise(), np.ones(len(evidence.person)), 0.15
    whole: Floats | None = None
    rounds: list[dict[str, Any]] = []
    growing, number = False, 0
    while True:
        last = number >= options.rounds - 1 and not (growing and number < options.rounds - 1 + _MORE_ROUNDS)
        part = number == 0 and not last
        blocks = np.sort(rng.permutation(len(evidence.person))[: options.learning_people]) if part else None
        joints = np.sort(rng.permutation(evidence.n_joints)[: options.learning_joints]) if part else None
        model = build_model(
            evidence, state, noise, start.knowledge, share=share, blocks=blocks, joints=joints, stance=stance, whole=whole,
            rename=number > 0,
        )  # fmt: skip
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
        judged = wholeness(model, result.state, len(evidence.sightings))
        whole = judged.weight
        before, noise = noise, learn_noise(model, result, judged.broken)
        growing = len(model.rows) > 0 and _typical(noise, model) > _GROWTH * _typical(before, model)
        stance = _stance(model, result.state, len(evidence.person))
        share = AGREE_SIGMAS * max(noise.centre if len(model.rows) else 0.0, noise.joint if evidence.n_joints else 0.0)
        number += 1
    return Fit(model, result, noise, stance, rounds)


def _typical(noise: Noise, model: Model) -> float:
    """What a box of middling size is off by, pixels."""
    return float(np.hypot(noise.box_px, noise.centre * np.median(model.problem.scale_px)))


def _stance(model: Model, state: PeopleState, n_blocks: int) -> Floats:
    """(N,) who may be standing, over all person-instants of the evidence."""
    out = np.ones(n_blocks)
    person = model.problem.person
    if len(person):
        extent = state.people[:, 3] - state.people[:, 2]
        out[model.blocks] = standing_instants(extent, state.heights[person], person)
    return out
