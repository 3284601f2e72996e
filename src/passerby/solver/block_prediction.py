"""Comparison of optima by their prediction of people who were left out of the fit.

Errors of people are correlated for seconds: a gait, a posture, a bag. Two optima are therefore compared over *blocks*, each of
one person during ten seconds. Each optimum is refitted without a fifth of the blocks. Then these blocks are fitted with the
cameras held, so that only the people's own unknowns are free. The difference of the costs of two optima in a block is the gain
there, in nats. The mean gain over its standard error between blocks shows whether the gain is significant.

All optima are compared on the same observations, with the same noise. Inflation factors are not needed.
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
"""Duration of a block of one person, seconds; shorter in recordings that are shorter than `FOLDS` blocks."""
FOLDS = 5
PEOPLE, JOINTS = 1500, 6000
"""Largest numbers of person-instants and joints that are compared, evenly spread; those between are similar to neighbours."""
_EVERYTHING = 1e3
"""Tolerance of agreement, as a share of the extent, so wide that all observations agree: they were selected before."""
_STOPPING = Stopping(15, 1e-6)


@dataclass(frozen=True, eq=False)
class HeldOutBlocks:
    """The observations on which optima are compared, and the block of each person-instant and joint."""

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
    """Share of the evidence's observations that are compared."""


@dataclass(frozen=True)
class Prediction:
    """Gain of one optimum over another in the prediction of held-out people."""

    gain: float
    """Sum over all blocks, nats."""
    sigma: float
    """Standard error of `gain`, from its scatter between blocks."""
    blocks: int

    @property
    def sigmas(self) -> float:
        """The gain in units of its standard error; 0 where there are too few blocks to estimate it."""
        return self.gain / self.sigma if self.sigma > 0 else 0.0


def held_out_blocks(evidence: Evidence, fits: Sequence[Fit], fps: float) -> HeldOutBlocks:
    """Divide the evidence that several optima share into blocks.

    Args:
        evidence: evidence of all optima.
        fits: optima; observations that agree with at least one of them are compared.
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
    """Return the robust cost (B,) of each block in nats, with cameras that were fitted without its fold.

    Args:
        fit: the optimum, from which each refit starts.
        blocks: the blocks that are held out.
        like: the optimum that noise, stance and wholeness are taken from; the same for all optima that are compared.
    """
    start, knowledge = fit.start, fit.start.knowledge
    # The weight of the priors of lenses corrects for correlated observations; a sample of the observations is less correlated.
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
    """Return the gain of an optimum over another, from the costs (B,) of the same blocks under both."""
    gain = (before - after)[(before > 0) & (after > 0)]
    if len(gain) < FOLDS:
        return Prediction(float(gain.sum()), 0.0, len(gain))
    return Prediction(float(gain.sum()), float(np.std(gain, ddof=1) * np.sqrt(len(gain))), len(gain))


def _problem(start: Initialisation, rig: RigState, blocks: HeldOutBlocks, which: Bools, like: Fit) -> AdjustmentProblem:
    """Build the problem of all observations of the blocks in the mask `which` (B,)."""
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
    # The noise refers to the extent: the observed extent is the same for all optima, the expected one is not.
    return replace(made, problem=replace(made.problem, expected_px=None))


def _costs(model: AdjustmentProblem, terms: Sequence[Term], blocks: HeldOutBlocks) -> Iterator[tuple[Ints, Floats]]:
    """Yield the block and the robust cost of each row of the terms of people and joints."""
    of_people = blocks.of_people[np.searchsorted(blocks.people, model.blocks)]
    of_joints = blocks.of_joints[np.searchsorted(blocks.joints, model.joints)]
    for term in terms:
        if term.block is not None:
            squared = np.einsum("mk,mk->m", term.residual, term.residual)
            cost = 0.5 * squared if term.loss is None else term.loss.cost(squared)
            yield (of_joints if term.family == JOINT else of_people)[term.block], cost


def _spread(count: int, most: int) -> Ints:
    """Return indices below `count`, evenly spread, at most `most` of them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.zeros(0, np.int64)
