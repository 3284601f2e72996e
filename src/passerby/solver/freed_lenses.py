"""A part of the stated lenses freed: where people put it, and whether they fit better with it there.

The step of a score test (`lens_scores`) is that of a linear model at an optimum which the wrong lens has spoilt: poses, slack
and learnt noise have taken it up. Here the adjustment goes on with rays of the changed lens, its noise learnt anew, and the
next step is taken there, until the lens stays where it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Rig
from passerby.geometry.reprojection import PointObservations
from passerby.geometry.rotations import rotation_between
from passerby.people.model import Noise
from passerby.solver.evidence import Evidence
from passerby.solver.initialisation import Fit, Initialisation
from passerby.solver.lens_scores import LensHypothesis, LensScore, farthest, plausible, score_lenses
from passerby.solver.lens_unknowns import LENS_PARTS, LensPart, LensUnknowns
from passerby.solver.optimizer.least_squares import Stopping
from passerby.solver.refinement import (
    AGREE_SIGMAS,
    AdjustmentProblem,
    PriorKnowledge,
    build_problem,
    learn_noise,
    minimise_problem,
    occlusion_weights,
    rig_of,
)
from passerby.solver.uncertainty import design_effect

LONGEST_STEP: Mapping[LensPart, float] = MappingProxyType({"focal": 0.25, "principal_point": 0.12, "distortion": 0.1})
"""As of `farthest`: after a longer step the observations of a camera agree with nobody until its pose has followed, which they
have to drag. A lens of twice the focal length, freed at once, kept a third of them."""
FAR_SHARE, FAR_GAIN = 0.15, 12.0
"""Within which share of its extent an observation agrees while steps are that long or gain so much, as in the first round of a
fit: noise that is learnt from what agrees within a narrow tolerance keeps it narrow."""
PEOPLE, JOINTS = 1500, 6000
"""Person-instants and joints of a refit, spread evenly over all: those in between are much like their neighbours."""
LEAST_ROUNDS, MOST_ROUNDS = 2, 10
"""Of agreement, descent, learnt noise and one step of the lens; at least so many after the last that was too long."""
GROWTH = 1.01
"""Rounds go on while more than this factor more observations agree in each: those of a camera that was far off come back."""
SETTLED_GAIN = 2.0
"""A freed lens has settled where another step would gain less, of twice the log likelihood."""
JOINTS_OF_A_BODY = 17
_STOPPING = Stopping(12, 1e-4)
_UNKNOWNS = LensUnknowns(LENS_PARTS)


@dataclass(frozen=True, eq=False)
class FreedLens:
    """An optimum with lenses other than the stated ones."""

    changes: dict[LensHypothesis, tuple[float, ...]]
    """Where the free parts are, as `LensScore.change`."""
    scores: tuple[LensScore, ...]
    """Of all hypotheses there, the likeliest first; a free part's own step is what is left of it."""
    agreeing: Floats
    """(C,) share of the observations of each camera that agree."""
    people: Ints
    """(C,) people who do, each instant counted."""

    def score_of(self, hypothesis: LensHypothesis) -> LensScore:
        """The score of one hypothesis."""
        return next(score for score in self.scores if score.hypothesis == hypothesis)


def refit_freed(
    start: Initialisation, fit: Fit, first: LensScore, known: Mapping[LensHypothesis, Sequence[float]] | None = None
) -> FreedLens:
    """Go on from an optimum that holds all lenses, with parts of some free.

    Args:
        start: what the optimum was computed from, no lens refined.
        fit: the optimum.
        first: what is free, and where it goes first.
        known: what is free besides, and where it is.
    """
    evidence = start.evidence
    blocks, joints = _spread(len(evidence.person), PEOPLE), _spread(evidence.n_joints, JOINTS)
    state, noise, whole, before = rig_of(fit.result.state), fit.noise, None, start.rig
    changes = {hypothesis: np.array(change) for hypothesis, change in (known or {}).items()}
    changes[first.hypothesis] = np.zeros(len(first.change))
    steps, far, near, agreed = {first.hypothesis: first}, True, 0, 0
    for _ in range(MOST_ROUNDS):
        moved = {h: change + _shortened(start.rig, steps[h]) if h in steps else change for h, change in changes.items()}
        if not all(plausible(start.rig, hypothesis, change) for hypothesis, change in moved.items()):
            break
        changes = moved
        rig, seen, knowledge = _with_lenses(start, changes)
        state, before = replace(state, R=_turned(state.R, before, rig)), rig
        model = build_problem(
            seen, state, noise, knowledge, share=max(_tolerance(seen, noise), FAR_SHARE if far else 0.0), blocks=blocks,
            joints=joints, stance=fit.stance, whole=whole, rename=True,
        )  # fmt: skip
        result = minimise_problem(model, _STOPPING)
        state = rig_of(result.state)
        judged = occlusion_weights(model, result.state, len(evidence.sightings))
        whole, noise = judged.weight, learn_noise(model, result, judged.broken)
        problem = replace(model.problem, noise=noise)
        inflation = design_effect(model, seen, problem.terms(result.state, jacobians=False))
        scores = score_lenses(rig, problem, result.state, inflation)
        steps = {score.hypothesis: score for score in scores if score.hypothesis in changes}
        before_it, agreed = agreed, len(model.rows) + len(model.joint_rows)
        near = 0 if far else near + 1
        if near >= LEAST_ROUNDS and agreed <= GROWTH * before_it and all(step.gain < SETTLED_GAIN for step in steps.values()):
            break
        far = any(_shortening(start.rig, step) < 1 or step.gain > FAR_GAIN for step in steps.values())
    put = {hypothesis: tuple(change.tolist()) for hypothesis, change in changes.items()}
    return FreedLens(put, tuple(scores), *_agreeing(model, evidence, blocks, joints))


def _shortened(rig: Rig, step: LensScore) -> Floats:
    """The step, no longer than poses can follow."""
    return _shortening(rig, step) * np.array(step.change)


def _shortening(rig: Rig, step: LensScore) -> float:
    """Factor on a step that poses cannot follow; 1 where they can."""
    return min(1.0, LONGEST_STEP[step.hypothesis.part] / max(farthest(rig, step.hypothesis, step.change), 1e-12))


def _with_lenses(start: Initialisation, changes: dict[LensHypothesis, Floats]) -> tuple[Rig, Evidence, PriorKnowledge]:
    """The rig, what it saw and what is marked in its images, with other lenses than the stated ones."""
    moved = np.zeros((len(start.rig), _UNKNOWNS.size))
    for hypothesis, change in changes.items():
        columns = np.arange(_UNKNOWNS.size)[_UNKNOWNS.columns_of(hypothesis.part)]
        along = columns if hypothesis.axis is None else columns[hypothesis.axis : hypothesis.axis + 1]
        moved[np.ix_(np.array(hypothesis.cameras), along)] += change
    rig, cues = _UNKNOWNS.rig(start.rig, moved), start.knowledge.cues
    lenses = {c: (start.rig.cameras[c].lens, rig.cameras[c].lens) for c in np.flatnonzero(moved.any(axis=1)).tolist()}
    s = start.evidence.sightings
    top, top_tangent = _rays_through(lenses, s.camera, s.top, s.top_tangent)
    bottom, bottom_tangent = _rays_through(lenses, s.camera, s.bottom, s.bottom_tangent)
    s = replace(s, top=top, top_tangent=top_tangent, bottom=bottom, bottom_tangent=bottom_tangent)
    if cues is not None and cues.marks is not None:
        cues = replace(cues, marks=_points_through(lenses, cues.marks))
    if cues is not None and cues.plan is not None:
        cues = replace(cues, plan=replace(cues.plan, rays=_points_through(lenses, cues.plan.rays)))
    evidence = replace(start.evidence, sightings=s, joints=_points_through(lenses, start.evidence.joints))
    return rig, evidence, replace(start.knowledge, cues=cues)


def _points_through(lenses: Mapping[int, tuple[Lens, Lens]], o: PointObservations) -> PointObservations:
    """Observations of points with the rays that other lenses give their pixels."""
    bearing, tangent = _rays_through(lenses, o.camera, o.bearing, o.tangent)
    return replace(o, bearing=bearing, tangent=tangent)


def _rays_through(
    lenses: Mapping[int, tuple[Lens, Lens]], camera: Ints, rays: Floats, tangents: Floats
) -> tuple[Floats, Floats]:
    """Rays (M, 3) and tangents (M, 2, 3) of the same pixels by other lenses; the old ones where a lens cannot have seen them.

    Args:
        lenses: of each camera that has another one, the old and the new one.
        camera: (M,) of the rays.
        rays: (M, 3) by the old lenses.
        tangents: (M, 2, 3) by the old lenses.
    """
    rays, tangents = np.array(rays), np.array(tangents)
    for c, (old, new) in lenses.items():
        rows = np.flatnonzero(camera == c)
        found = new.bearings(old.project_rays(rays[rows]))
        good = np.isfinite(found).all(axis=1)
        rays[rows[good]], tangents[rows[good]] = found[good], new.tangents(found[good])
    return rays, tangents


def _turned(R: Floats, before: Rig, after: Rig) -> Floats:
    """(C, 3, 3) world to camera, after lenses changed: what is seen in the middles of the images stays where it is."""
    out = np.array(R)
    for c, (old, new) in enumerate(zip(before, after, strict=True)):
        middle = np.array([old.lens.size], dtype=np.float64) / 2
        a, b = old.lens.bearings(middle)[0], new.lens.bearings(middle)[0]
        if np.isfinite(a + b).all() and not np.array_equal(a, b):
            out[c] = rotation_between(a, b) @ out[c]
    return out


def _agreeing(model: AdjustmentProblem, evidence: Evidence, blocks: Ints, joints: Ints) -> tuple[Floats, Ints]:
    """(C,) share of each camera's observations of some person-instants and joints that agree, and whom they show: people, or
    where there are only joints, as many bodies.
    """
    n, s, o = evidence.n_cameras, evidence.sightings, evidence.joints
    upright = np.bincount(model.problem.sightings.camera, minlength=n)
    joint = np.bincount(model.problem.joints.camera, minlength=n)
    seen = np.bincount(s.camera[np.isin(s.block, blocks)], minlength=n)
    seen += np.bincount(o.camera[np.isin(o.point, joints)], minlength=n)
    return (upright + joint) / np.maximum(seen, 1), np.maximum(upright, joint // JOINTS_OF_A_BODY)


def _tolerance(evidence: Evidence, noise: Noise) -> float:
    """Within which share of its extent an observation agrees."""
    boxes, joints = len(evidence.sightings) > 0, evidence.n_joints > 0
    return AGREE_SIGMAS * max(noise.centre if boxes else 0.0, noise.joint if joints else 0.0)


def _spread(count: int, most: int) -> Ints:
    """Indices below `count`, at most so many, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.zeros(0, np.int64)
