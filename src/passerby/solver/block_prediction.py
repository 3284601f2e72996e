"""Compare optima by what they predict of people who had no part in them.

People's errors are alike for seconds: a gait, a posture, a bag. Two optima are therefore compared over *blocks*, one person
during ten seconds each: each optimum is refitted without a fifth of the blocks, then these are fitted with the cameras held,
so that only what belongs to the people themselves is free. What another optimum costs less in a block is its gain there, in
nats; the mean gain over its standard error among blocks says whether it is one.

Everything that is compared has the same observations, with the same noise. Inflation factors are not needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.solver.adjustment_problem import AdjustmentProblem, RigState, build_problem, rig_of
from passerby.solver.evidence import Evidence
from passerby.solver.initialisation import Initialisation
from passerby.solver.optimizer.least_squares import Stopping, Term, minimise
from passerby.solver.person_model import JOINT
from passerby.solver.refinement import Fit

STRETCH_S = 10.0
"""Seconds of a person that make one block; less in recordings that have not `FOLDS` of them."""
FOLDS = 5
PEOPLE, JOINTS = 1500, 6000
"""Person-instants and joints that are compared, spread evenly over all: those in between are much like their neighbours."""
_EVERYTHING = 1e3
"""Share of its extent within which an observation agrees where what agrees was chosen before."""
_STOPPING = Stopping(15, 1e-6)


@dataclass(frozen=True, eq=False)
class HeldOutBlocks:
    """The observations that optima are compared by, and the block of each person-instant and joint."""

    sightings: Ints
    """Rows of the evidence's sightings."""
    joint_sightings: Ints
    """Rows of the evidence's sightings of joints."""
    people: Ints
    """Person-instants of the evidence, ascending."""
    joints: Ints
    """Joints of the evidence, ascending."""
    of_people: Ints
    """The block of each of these person-instants, 0 to B - 1."""
    of_joints: Ints
    """The block of each of these joints."""
    fold: Ints
    """(B,) the fold that each block is held out with, 0 to `FOLDS` - 1."""
    share: float
    """Of the evidence's observations."""


@dataclass(frozen=True)
class Prediction:
    """How much better one optimum predicts held-out people than another."""

    gain: float
    """Over all blocks, nats."""
    sigma: float
    """Standard error of `gain`, from its scatter between blocks."""
    blocks: int

    @property
    def sigmas(self) -> float:
        """The gain in its standard errors; 0 where there are too few blocks for one."""
        return self.gain / self.sigma if self.sigma > 0 else 0.0


def held_out_blocks(evidence: Evidence, fits: Sequence[Fit], fps: float) -> HeldOutBlocks:
    """The blocks of evidence that some optima share.

    Args:
        evidence: of all optima.
        fits: optima; what agrees with one of them is compared.
        fps: time steps a second.
    """
    people, joints = _spread(len(evidence.person), PEOPLE), _spread(evidence.n_joints, JOINTS)
    s, o = evidence.sightings, evidence.joints
    agreeing = np.zeros(len(s), dtype=bool)
    agreeing_joints = np.zeros(len(o.camera), dtype=bool)
    for fit in fits:
        own = s.block[fit.model.rows] == fit.model.blocks[fit.model.problem.sightings.block]
        agreeing[fit.model.rows[own]] = True
        agreeing_joints[fit.model.joint_rows] = True
    agreeing &= np.isin(s.block, people)
    agreeing_joints &= np.isin(o.point, joints)
    who = np.concatenate([evidence.identities[evidence.person[people]], evidence.joint_person[joints]])
    when = np.concatenate([evidence.frame[people], evidence.joint_frame[joints]])
    span = float(np.ptp(when)) + 1 if len(when) else 1.0
    stretch = ((when - min(when, default=0)) // min(STRETCH_S * fps, span / FOLDS)).astype(np.int64)
    key, block = np.unique(np.column_stack([who, stretch]), axis=0, return_inverse=True)
    number = np.unique(key[:, 0], return_inverse=True)[1]
    used, seen = int(agreeing.sum() + agreeing_joints.sum()), len(s) + len(o.camera)
    return HeldOutBlocks(
        np.flatnonzero(agreeing), np.flatnonzero(agreeing_joints), people, joints, block.ravel()[: len(people)],
        block.ravel()[len(people) :], (number + key[:, 1]) % FOLDS, used / max(seen, 1),
    )  # fmt: skip


def predicted_costs(fit: Fit, blocks: HeldOutBlocks, like: Fit) -> Floats:
    """(B,) robust cost of each block in nats, by cameras that were fitted without its fold.

    Args:
        fit: the optimum, where each refit begins.
        blocks: what is held out.
        like: the optimum that noise, stance and wholeness are taken from, the same for all that are compared.
    """
    start, knowledge = fit.start, fit.start.knowledge
    # Priors of lenses count as much more as observations follow one another, which fewer of them do less.
    weight = np.maximum(knowledge.lens_weight * blocks.share, 1.0)
    fitted = replace(start, knowledge=replace(knowledge, lens_weight=weight))
    alone = replace(start, knowledge=replace(knowledge, cues=None))
    costs = np.zeros(len(blocks.fold))
    for fold in range(FOLDS):
        kept = _problem(fitted, rig_of(fit.result.state), blocks, blocks.fold != fold, like)
        cameras = rig_of(minimise(kept.problem, kept.state, _STOPPING).state)
        held = _problem(alone, replace(cameras, lengths=np.zeros((0, 6))), blocks, blocks.fold == fold, like)
        nothing = np.zeros(held.problem.layout.n_shared, dtype=bool)
        found = minimise(held.problem, held.state, _STOPPING, free=nothing).state
        for block, cost in _costs(held, held.problem.terms(found, jacobians=True), blocks):
            np.add.at(costs, block, cost)
    return costs


def compare_predictions(before: Floats, after: Floats) -> Prediction:
    """What an optimum gains over another, by the costs (B,) of the same blocks under both."""
    gain = (before - after)[(before > 0) & (after > 0)]
    if len(gain) < FOLDS:
        return Prediction(float(gain.sum()), 0.0, len(gain))
    return Prediction(float(gain.sum()), float(np.std(gain, ddof=1) * np.sqrt(len(gain))), len(gain))


def _problem(start: Initialisation, rig: RigState, blocks: HeldOutBlocks, which: Bools, like: Fit) -> AdjustmentProblem:
    """The observations of some blocks (B,), whatever agrees."""
    evidence, model = start.evidence, like.model
    whole = np.ones(len(evidence.sightings))
    if model.problem.whole is not None:
        whole[model.rows] = model.problem.whole
    shown = replace(
        evidence, sightings=evidence.sightings.take(blocks.sightings), joints=evidence.joints.take(blocks.joint_sightings)
    )  # fmt: skip
    made = build_problem(
        shown, rig, like.noise, start.knowledge, share=_EVERYTHING, blocks=blocks.people[which[blocks.of_people]],
        joints=blocks.joints[which[blocks.of_joints]], stance=like.stance, whole=whole[blocks.sightings],
    )  # fmt: skip
    # The extent that a rig expects of people sets the noise: what was seen is the same for all optima.
    return replace(made, problem=replace(made.problem, expected_px=None))


def _costs(model: AdjustmentProblem, terms: Sequence[Term], blocks: HeldOutBlocks) -> Iterator[tuple[Ints, Floats]]:
    """The block of each row of the terms about people and joints, and its robust cost."""
    of_people = blocks.of_people[np.searchsorted(blocks.people, model.blocks)]
    of_joints = blocks.of_joints[np.searchsorted(blocks.joints, model.joints)]
    for term in terms:
        if term.block is not None:
            squared = np.einsum("mk,mk->m", term.residual, term.residual)
            cost = 0.5 * squared if term.loss is None else term.loss.cost(squared)
            yield (of_joints if term.family == JOINT else of_people)[term.block], cost


def _spread(count: int, most: int) -> Ints:
    """Indices below `count`, at most so many, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.zeros(0, np.int64)
