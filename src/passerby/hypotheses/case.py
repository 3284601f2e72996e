"""The base model: a part of the observations around the optimum, with every stated lens free within its known accuracy.

All alternatives are compared on the same observations with the same noise. They differ only in the priors that they change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Pose, Rig
from passerby.core.synchronisation import USUAL_FPS
from passerby.hypotheses.alternatives import LENS, stated_scales
from passerby.solver.adjustment_problem import AGREE_SIGMAS, build_problem, rig_of
from passerby.solver.cue_terms import CueRows
from passerby.solver.initialisation import people_for_all
from passerby.solver.lens_unknowns import LensModel
from passerby.solver.optimizer.least_squares import NormalEquations, Stopping, minimise
from passerby.solver.people import PeopleSolution
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import JOINT, UPRIGHT, PeopleProblem

PEOPLE, JOINTS, OF_CAMERA = 1500, 4000, 200
"""Largest numbers of person-instants and joints that are compared, evenly spread: the errors of those in between are nearly the
same. In large rigs there are more, so that each camera has `OF_CAMERA` observations on average."""
STRETCH_S = 10.0
"""Errors of one person within this time, seconds, form one block; those of different blocks are taken as independent."""
WIDE_SHARE = 0.15
"""Tolerance of agreement, as a share of a person's extent. It is that of the first round of a fit, so that people at the edge
of an image with a wrong lens are not left out."""
RAY_ROUNDS = 4
"""Largest number of times that rays of cues are computed again with the estimated lenses; those of people are exact."""
_FITTING, _PREDICTING = Stopping(20, 1e-5), Stopping(10, 1e-4)
_NEAR_OPTIMUM = Stopping(2, 1e-5)
"""Limit of the fit without a fifth of the blocks, which starts at the optimum of all: a few Newton steps are enough."""


def blocks_of(instant: Ints, person: Ints, per_second: float) -> tuple[Ints, int]:
    """Assign each of N observations to a block: one person during one stretch of time.

    Stretches have the length `STRETCH_S`; the last one may be shorter.

    Args:
        instant: (N,) instants.
        person: (N,) identities.
        per_second: instants a second.

    Returns:
        (N,) block of each observation, and the number of blocks.
    """
    since = instant - instant.min(initial=np.iinfo(np.int64).max)
    keys = np.column_stack([since // max(1.0, STRETCH_S * per_second), person]).astype(np.int64)
    blocks, block = np.unique(keys, axis=0, return_inverse=True)
    return block.reshape(-1), len(blocks)


@dataclass(frozen=True, eq=False)
class Case:
    """A problem with its state, and the block of each of its observations."""

    stated: Rig
    """Lenses as stated."""
    problem: PeopleProblem
    state: AdjustmentState
    instant_block: Ints
    """(N,) block of each person-instant."""
    joint_block: Ints
    """(J,) block of each joint."""
    n_blocks: int

    @classmethod
    def of(cls, solution: PeopleSolution) -> Case | None:
        """Build the base model around a solution, not yet fitted; None if it lacks observations or has free lenses."""
        start, fit = solution.start, solution.fit
        if start is None or fit is None or solution.covariance is None or start.unknowns.parts:
            return None
        evidence, noise = start.evidence, fit.noise
        whole = np.ones(len(evidence.sightings))
        if fit.model.problem.whole is not None:
            whole[fit.model.rows] = fit.model.problem.whole
        share = AGREE_SIGMAS * max(noise.centre if len(fit.model.rows) else 0.0, noise.joint if evidence.n_joints else 0.0)
        people = _spread(len(evidence.person), people_for_all(evidence, PEOPLE, OF_CAMERA))
        model = build_problem(
            evidence, rig_of(fit.result.state), noise, start.knowledge, share=max(share, WIDE_SHARE),
            blocks=people, joints=_spread(evidence.n_joints, JOINTS), stance=fit.stance, whole=whole, rename=True,
        )  # fmt: skip
        if not len(model.rows) and not len(model.joint_rows):
            return None
        block, n_blocks = blocks_of(
            np.concatenate([evidence.frame[model.blocks], evidence.joint_frame[model.joints]]),
            np.concatenate([evidence.person[model.blocks], evidence.joint_person[model.joints]]), solution.fps or USUAL_FPS,
        )  # fmt: skip
        first = np.zeros((len(start.rig), LENS.size))
        rows = len(model.rows) + len(model.joint_rows)
        every = max(len(fit.model.rows) + len(fit.model.joint_rows), rows)
        weight = max(1.0, solution.covariance.inflation * rows / every)
        problem = replace(
            model.problem, lens_core=stated_scales(start.rig), lens_weight=np.array(weight), lens_normal=True, lens_groups=(),
            lens_model=LensModel(LENS, start.rig),
        )  # fmt: skip
        problem = _with_rays_of_cues(problem, start.rig, first)
        problem = replace(
            problem, sightings=LENS.sightings(problem.sightings, start.rig, first),
            joints=LENS.points(problem.joints, start.rig, first),
        )  # fmt: skip
        n = len(model.blocks)
        return cls(start.rig, problem, replace(model.state, lens=first), block[:n], block[n:], n_blocks)

    def with_problem(self, problem: PeopleProblem) -> Case:
        """Return the case with another problem for the same observations."""
        return replace(self, problem=problem)

    def fitted(self) -> Case:
        """Return the case at its optimum."""
        problem, state = self.problem, self.state
        for _ in range(RAY_ROUNDS):
            before = state.lens
            state = minimise(problem, state, _FITTING).state
            if problem.cues is None or LENS.settled(state.lens - before):
                break
            problem = _with_rays_of_cues(problem, self.stated, state.lens)
        return replace(self, problem=problem, state=state)

    def rig(self) -> Rig:
        """Return the cameras with the estimated lenses and poses."""
        rig = LENS.rig(self.stated, self.state.lens)
        poses = (Pose.from_centre(R, centre) for R, centre in zip(self.state.R, self.state.centre, strict=True))
        return Rig(tuple(replace(camera, pose=pose) for camera, pose in zip(rig, poses, strict=True)))

    def lens_covariance(self) -> Floats:
        """Return the covariance (C L, C L) of all lenses at the optimum, for observations that are taken as independent."""
        H = NormalEquations(self.problem.layout, self.problem.terms(self.state, jacobians=True)).reduce().H
        scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-12))
        # Gauge freedoms of the rig have no information: the pseudo-inverse keeps them fixed.
        inverse = np.linalg.pinv(H * scale[:, None] * scale, rcond=1e-10, hermitian=True) * scale[:, None] * scale
        of_camera = (np.arange(self.problem.n_cameras) + 1) * self.problem.camera_size - self.problem.n_lens
        at = (of_camera[:, None] + np.arange(self.problem.n_lens)).ravel()
        return np.asarray(inverse[np.ix_(at, at)])

    def lens_sigma(self) -> Floats:
        """Return one standard deviation (C, L) of the lenses' unknowns, with the correlation of the observations."""
        variance = np.diag(self.lens_covariance()) * float(np.mean(self.problem.lens_weight))
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)).reshape(self.state.lens.shape))

    def costs(self) -> Floats:
        """Return the robust cost (B,) of each block: of its observations, and of the statures of its people."""
        out = np.zeros(self.n_blocks)
        problem = self.problem
        for term in problem.terms(self.state, jacobians=True):
            squared = np.einsum("mk,mk->m", term.residual, term.residual)
            cost = 0.5 * squared if term.loss is None else term.loss.cost(squared)
            if term.block is not None and term.family in (UPRIGHT, JOINT):
                block = (self.instant_block if term.family == UPRIGHT else self.joint_block)[term.block]
                out += np.bincount(block, cost, self.n_blocks)
            elif term.group is not None and len(problem.person):  # statures: divided among the instants of a person
                instants = np.bincount(problem.person, minlength=len(cost))
                share = cost[problem.person] / instants[problem.person]
                out += np.bincount(self.instant_block, share, self.n_blocks)
        return out

    def without(self, held_out: Bools) -> Case:
        """Return the case without the held-out blocks (B,), at its optimum; this case has to be at its optimum."""
        part = self._part(~held_out[self.instant_block], ~held_out[self.joint_block])
        return replace(part, state=minimise(part.problem, part.state, _NEAR_OPTIMUM).state)

    def predicted(self, fitted: Case, held_out: Bools) -> Floats:
        """Return the robust cost (B,) of each held-out block, nats; all but its own people is fixed as in `fitted`.

        Args:
            fitted: the case without these blocks, at its optimum.
            held_out: (B,) whether a block is held out; the cost of the others is 0.
        """
        part = self._part(held_out[self.instant_block], held_out[self.joint_block])
        shared = fitted.state
        state = replace(
            part.state, R=shared.R, centre=shared.centre, slack=shared.slack, globals=shared.globals, time=shared.time,
            lens=shared.lens,
        )  # fmt: skip
        problem = _with_rays_of_cues(part.problem, self.stated, shared.lens)
        held = np.zeros(problem.layout.n_shared, dtype=bool)
        return replace(part, problem=problem, state=minimise(problem, state, _PREDICTING, free=held).state).costs()

    def _part(self, instants: Bools, joints: Bools) -> Case:
        """Return the case with some of the person-instants (N,) and joints (J,)."""
        p, s = self.problem, self.state
        rows, joint_rows = instants[p.sightings.block], joints[p.joints.point]
        number, joint_number = np.cumsum(instants) - 1, np.cumsum(joints) - 1
        seen, points = p.sightings.take(rows), p.joints.take(joint_rows)
        problem = replace(
            p, sightings=replace(seen, block=number[seen.block]), joints=replace(points, point=joint_number[points.point]),
            person=p.person[instants], stance_weight=p.stance_weight[instants], n_joints=int(joints.sum()),
            whole=None if p.whole is None else p.whole[rows],
            expected_px=None if p.expected_px is None else p.expected_px[rows],
        )  # fmt: skip
        state = replace(s, people=s.people[instants], joints=s.joints[joints])
        return replace(
            self, problem=problem, state=state, instant_block=self.instant_block[instants], joint_block=self.joint_block[joints]
        )


def prior_precision(problem: PeopleProblem) -> Floats:
    """Return the precision matrix (C L, C L) of the priors of the lenses."""
    core, common = problem.lens_core, problem.lens_common
    assert core is not None
    precision = np.diag((core**-2.0).ravel())
    for unknown in [] if common is None else np.flatnonzero(common):
        assert common is not None
        at = np.arange(len(core)) * core.shape[1] + unknown
        precision[np.ix_(at, at)] = np.linalg.inv(np.diag(core[:, unknown] ** 2) + common[unknown] ** 2)
    return np.asarray(precision * problem.lens_weight)


def _with_rays_of_cues(problem: PeopleProblem, stated: Rig, lens: Floats) -> PeopleProblem:
    """Recompute the rays of the cues for lenses that differ from the stated ones by `lens` (C, L)."""
    cues: CueRows | None = problem.cues
    if cues is not None and cues.marks is not None:
        cues = replace(cues, marks=LENS.points(cues.marks, stated, lens))
    if cues is not None and cues.plan is not None:
        cues = replace(cues, plan=replace(cues.plan, rays=LENS.points(cues.plan.rays, stated, lens)))
    return replace(problem, cues=cues)


def _spread(count: int, most: int) -> Ints:
    """Return indices below `count`, at most `most` of them, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.zeros(0, np.int64)
