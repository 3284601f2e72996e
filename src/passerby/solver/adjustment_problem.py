"""The problem of one round of the refinement: the sightings that agree with a rig, their noise, and prior knowledge."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import NORMAL_BY_MAD
from passerby.geometry.ray_consensus import reassign_outliers, vote_points
from passerby.geometry.triangulation import PointObservations
from passerby.people.model import HEIGHT_PER_CENTRE, Noise, Priors
from passerby.people.sightings import Sightings
from passerby.solver.cue_terms import CueRows
from passerby.solver.cues import settle_cues, unusual_people
from passerby.solver.evidence import Evidence
from passerby.solver.lens_unknowns import LensModel
from passerby.solver.occlusion import Wholeness, weight_truncated_boxes
from passerby.solver.optimizer.least_squares import NormalEquations, Result, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import JOINT, PeopleProblem

# A sighting agrees within so many sigmas of its centre: the Cauchy loss deals with what is nearer.
AGREE_SIGMAS = 6.0
GROUPS_COUNT_MORE = 10.0
"""Residuals follow one another, and count as if they did not: so does what is known of groups (as `JOINED_FOOT_SHIFT_SD`)."""
# A box cannot know its height better than this many times its centre: the difference of two edges against their mean. What a
# detector does to people's heights is not white either (over PETS2009 and simulated scenes 2 to 3 measured best).
MIN_HEIGHT_RATIO = 2.5
# Where many edges are broken, those that are broken by little pass for whole, and they err to one side: a box is shortened by
# all that it misses, its centre moved by half. Twice the ratio is reached at this share of broken edges
# (rendered videos, a background's boxes, 18 % broken: 0.49 degrees and 1.0 % of scale instead of 0.73 and 4.3; a network's, 8 %
# broken, 0.59 and 2.0 % instead of 0.61 and 2.2).
BROKEN_FOR_DOUBLE = 0.1
MIN_FOR_NOISE = 20
SIZES = 6
# How far people's visible lengths spread around their standing heights, as a logarithm, where some crouch.
POSTURE_SD = 0.15


@dataclass(frozen=True, eq=False)
class RigState:
    """What is known of the cameras between rounds."""

    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    heights: Floats
    """(P,) standing heights."""
    slack: Floats
    globals: Floats
    time: Floats
    """(C,) errors of the clocks, seconds (`AdjustmentState`)."""
    lens: Floats
    """(C, L) by how much lenses differ from the stated ones (`AdjustmentState`)."""
    lengths: Floats
    """(K, 6) the ends of known lengths (`AdjustmentState`)."""

    @classmethod
    def start(cls, R: Floats, centre: Floats, height_mean: Floats, priors: Priors, marks: Floats, lens: Floats) -> RigState:
        """A first state: people as tall as expected, no slack, clocks as stated."""
        none = np.zeros(len(R))
        shift = np.array([priors.foot_shift])
        return cls(R, centre, height_mean.copy(), none, shift, none, lens, marks.reshape(-1, 6))


@dataclass(frozen=True, eq=False)
class AdjustmentProblem:
    """The problem of one round, and the rows of the evidence that are in it."""

    problem: PeopleProblem
    state: AdjustmentState
    rows: Ints
    """Rows of the evidence's sightings, in the problem's order."""
    renamed: int
    """How many of them show another person than their identity says."""
    blocks: Ints
    """Person-instants of the evidence, in the problem's order."""
    joint_rows: Ints
    joints: Ints
    joint_kind: Ints
    """(J,) which joint of the body each joint of the problem is."""

    def near(self, before: AdjustmentProblem, found: AdjustmentState) -> AdjustmentProblem:
        """The same, begun at the solution `found` of an earlier round with people and joints whose sightings are the same."""
        people, joints = self.state.people.copy(), self.state.joints.copy()
        here, there = _common(*((one.blocks, one.problem.sightings.block, one.rows) for one in (self, before)))
        people[here] = found.people[there]
        here, there = _common(*((one.joints, one.problem.joints.point, one.joint_rows) for one in (self, before)))
        joints[here] = found.joints[there]
        return replace(self, state=replace(self.state, people=people, joints=joints))


def _common(now: tuple[Ints, Ints, Ints], before: tuple[Ints, Ints, Ints]) -> tuple[Ints, Ints]:
    """Places in two lists of person-instants, or joints, of those that have the same sightings in both.

    Args:
        now: (N,) unique numbers in the evidence, (M,) place of each sighting in that list, and (M,) its row of the evidence.
        before: the same of the other list.
    """
    _, here, there = np.intersect1d(now[0], before[0], assume_unique=True, return_indices=True)
    same = np.ones(len(here), dtype=bool)
    for power in (0, 1, 2):  # number of the rows, their sum and the sum of their squares
        sums = [np.bincount(at, rows.astype(np.float64) ** power, len(listed)) for listed, at, rows in (now, before)]
        same &= sums[0][here] == sums[1][there]
    return here[same], there[same]


@dataclass(frozen=True, eq=False)
class PriorKnowledge:
    """What holds in all rounds: priors, cues, and what is expected of each person."""

    height_mean: Floats
    height_sd: Floats
    priors: Priors = field(default_factory=Priors)
    cues: CueRows | None = None
    lens_core: Floats | None = None
    """(C, L) scales of what is stated of the lenses; None where they are not refined."""
    lens_weight: Floats = field(default_factory=lambda: np.ones(()))
    """How many times more that counts (`PeopleProblem`)."""
    lens_normal: bool = False
    """Whether the scales are standard deviations (`PeopleProblem`)."""
    lens_groups: tuple[tuple[int, ...], ...] = ()
    """Cameras of one model (`PeopleProblem`)."""
    lens_far: Floats | None = None
    """(C, L) how the tails of the scales' distributions fall (`PeopleProblem`)."""
    lens_model: LensModel | None = None
    """The lenses whose unknowns these are (`PeopleProblem`)."""
    groups: tuple[tuple[int, ...], ...] = ()
    """Cameras that were rigs by themselves before (`PeopleProblem`)."""
    height_spread: Floats | None = None
    """(P,) how much people differ if only their population is known, as a share; NaN for all others."""
    unusual: NDArray[np.bool_] | None = None
    """(P,) people of the population who are far taller or shorter than most: their stature says nothing of the scale."""

    @property
    def height_weight_sd(self) -> Floats:
        """(P,) `height_sd`, and for unusual people as much as their height."""
        return self.height_sd if self.unusual is None else np.where(self.unusual, self.height_mean, self.height_sd)

    def judged(self, heights: Floats, seen: Ints) -> PriorKnowledge:
        """The same with who is unusual by the rig: (P,) heights, metres, and who of them were seen."""
        if self.height_spread is None:
            return self
        known = np.isin(np.arange(len(heights)), seen) & np.isfinite(self.height_spread)
        return replace(self, unusual=unusual_people(heights, known, self.height_spread))


def middle_rays(s: Sightings) -> tuple[Floats, Floats]:
    """Rays (M, 3) and tangents (M, 2, 3) to the middles of the sightings."""
    ray = s.top + s.bottom
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    tangent = 0.5 * (s.top_tangent + s.bottom_tangent)
    # A tangent is orthogonal to its ray; the mean of two nearly is.
    tangent = tangent - np.einsum("mki,mi->mk", tangent, ray)[:, :, None] * ray[:, None, :]
    return ray, tangent


def _on_time(ray: Floats, tangent: Floats, velocity: Floats | None, seconds: Floats) -> Floats:
    """Rays (M, 3) to where the points would have been seen had the clocks not been wrong by `seconds` (M,)."""
    if velocity is None or not seconds.any():
        return ray
    moved = -velocity * seconds[:, None]
    # The ray that misses the old one by these pixels: the least change of it that the tangent turns into them.
    gram = tangent @ tangent.transpose(0, 2, 1)
    on_time = ray + (tangent.transpose(0, 2, 1) @ np.linalg.solve(gram, moved[:, :, None]))[:, :, 0]
    return np.asarray(on_time / np.linalg.norm(on_time, axis=1, keepdims=True))


def build_problem(
    evidence: Evidence, rig: RigState, noise: Noise, knowledge: PriorKnowledge, *, share: float,
    blocks: Ints | None = None, joints: Ints | None = None, stance: Floats | None = None, rename: bool = False,
    whole: Floats | None = None,
) -> AdjustmentProblem:  # fmt: skip
    """The sightings that agree under a rig, as a problem with a state to start from.

    Args:
        evidence: all sightings.
        rig: cameras and people so far.
        noise: weights of the residuals.
        knowledge: priors and cues.
        share: tolerance of agreement, as a share of the sightings' extent.
        blocks: person-instants to use; all when None.
        joints: joints to use; all when None.
        rename: whether sightings that disagree with their person may go to another one of the same instant.
        stance: (N,) weight of standing for each person-instant of the evidence; all 1 when None.
        whole: (M,) weight of each sighting of the evidence (`occlusion_weights`); all 1 when None.
    """
    s, n_blocks = evidence.sightings, len(evidence.person)
    ray, tangent = middle_rays(s)
    ray = _on_time(ray, tangent, s.velocity, rig.time[s.camera])
    beyond_px = AGREE_SIGMAS * (noise.box_px - Noise().box_px)
    tolerance = 2.0 + share * s.extent_px + np.where(s.has_foot > 0, beyond_px, 0.0)
    typical = float(np.median(knowledge.height_mean)) if len(knowledge.height_mean) else 1.7
    middle = 0.5 * typical * float(np.median(s.top_fraction + s.bottom_fraction)) if len(s) else 0.0
    candidate = np.ones(len(s), bool) if blocks is None else np.isin(s.block, blocks)
    c = np.flatnonzero(candidate)
    consensus = vote_points(
        s.camera[c], s.block[c], ray[c], tangent[c], tolerance[c], n_blocks, rig.R, rig.centre, height=(middle, 0.25 * typical)
    )
    block = np.where(consensus.inlier, s.block[c], -1)
    if rename:
        block = reassign_outliers(
            consensus, s.camera[c], s.block[c], evidence.frame[s.block[c]], evidence.frame, ray[c], tangent[c], tolerance[c],
            rig.R, rig.centre,
        )  # fmt: skip
    rows, block = c[block >= 0], block[block >= 0]
    used = np.unique(block)
    number = np.full(n_blocks, -1)
    number[used] = np.arange(len(used))
    sightings = s.take(rows)
    sightings = replace(sightings, block=number[block])
    joint_problem, joint_points, joint_rows, joint_used = _agreeing_joints(evidence, rig, noise, share, joints)
    person = evidence.person[used]
    expected = _expected_extents(sightings, person, rig, consensus.points[used], noise)
    cues = settle_cues(knowledge.cues, rig.R, rig.centre, rig.heights, knowledge.height_mean, knowledge.height_weight_sd)
    problem = PeopleProblem(
        evidence.n_cameras, sightings, joint_problem, person, len(joint_used),
        knowledge.height_mean, knowledge.height_weight_sd,
        np.ones(len(used)) if stance is None else stance[used], noise, knowledge.priors, cues,
        None if whole is None else whole[rows], expected, knowledge.lens_core,
        knowledge.lens_weight, knowledge.lens_normal, knowledge.lens_groups, lens_far=knowledge.lens_far,
        lens_model=knowledge.lens_model, groups=knowledge.groups, group_weight=GROUPS_COUNT_MORE,
    )  # fmt: skip
    people = np.column_stack([consensus.points[used, :2], np.zeros(len(used)), rig.heights[person]])
    state = AdjustmentState(
        rig.R, rig.centre, rig.slack, rig.globals, rig.heights, people, joint_points, rig.time, rig.lens, rig.lengths
    )  # fmt: skip
    renamed = int(np.count_nonzero(s.block[rows] != block))
    return AdjustmentProblem(problem, state, rows, renamed, used, joint_rows, joint_used, evidence.joint_kind[joint_used])


def standing_extents(s: Sightings, centre: Floats, points: Floats, heights: Floats) -> Floats:
    """(M,) pixels from the lowest to the highest point of people who stand upright.

    Args:
        s: sightings.
        centre: (C, 3) of the cameras, metres.
        points: (N, 3) the middles of the blocks' people, metres.
        heights: (N,) of these people, standing, metres.
    """
    reach = points[s.block] - centre[s.camera]
    distance = np.maximum(np.linalg.norm(reach, axis=1), 0.1)
    # A vertical length is seen foreshortened by the sine of its angle with the ray; the tangent's rows are pixels a radian.
    across = np.sqrt(np.maximum(1 - (reach[:, 2] / distance) ** 2, 0.05))
    _, tangent = middle_rays(s)
    pixels = np.linalg.norm(tangent[:, 1], axis=1) / distance
    return np.asarray(pixels * across * ((s.top_fraction - s.bottom_fraction) * heights[s.block]))


def _expected_extents(s: Sightings, person: Ints, rig: RigState, points: Floats, noise: Noise) -> Floats:
    """(M,) pixels that the people seen have, as far as that is known beforehand.

    What was seen is noisy; a person who stands where the rays of all cameras meet has a known extent, but may be bent. The mean
    of both logarithms, weighed by their variances.

    Args:
        s: sightings that agree.
        person: (N,) person of each block.
        rig: cameras and people so far.
        points: (N, 3) where the blocks' middles are, metres.
        noise: of what was seen.
    """
    if not len(s):
        return np.zeros(0)
    standing = np.clip(standing_extents(s, rig.centre, points, rig.heights[person]), 0.25 * s.extent_px, 4.0 * s.extent_px)
    seen_variance = (HEIGHT_PER_CENTRE * noise.box_px / standing) ** 2 + noise.height**2
    by_posture = seen_variance / (seen_variance + POSTURE_SD**2)
    return np.asarray(standing**by_posture * s.extent_px ** (1 - by_posture))


def _agreeing_joints(
    evidence: Evidence, rig: RigState, noise: Noise, share: float, joints: Ints | None
) -> tuple[PointObservations, Floats, Ints, Ints]:
    """Joints that agree: their sightings renumbered, their positions, the rows and the joints of the evidence."""
    o = evidence.joints
    candidate = np.ones(len(o.camera), bool) if joints is None else np.isin(o.point, joints)
    c = np.flatnonzero(candidate)
    seen = o.take(c)
    ray = _on_time(seen.bearing, seen.tangent, seen.velocity, rig.time[seen.camera])
    consensus = vote_points(
        seen.camera, seen.point, ray, seen.tangent, 2.0 + share * seen.sigma_px, evidence.n_joints, rig.R, rig.centre
    )
    rows = c[consensus.inlier]
    used = np.unique(o.point[rows])
    number = np.full(evidence.n_joints, -1)
    number[used] = np.arange(len(used))
    # `sigma_px` of the evidence holds the person's extent; the noise says what share of it a joint is off by.
    share_px = noise.joint * o.sigma_px[rows]
    if noise.kinds is not None:
        share_px = share_px * noise.kinds[o.camera[rows], evidence.joint_kind[o.point[rows]]]
    sigma = np.hypot(noise.floor_px, share_px)
    taken = replace(o.take(rows), point=number[o.point[rows]], sigma_px=sigma)
    return taken, consensus.points[used], rows, used


def rig_of(state: AdjustmentState) -> RigState:
    """What the next round starts from."""
    return RigState(
        state.R, state.centre, state.heights, state.slack, state.globals, state.time, state.lens, state.lengths
    )  # fmt: skip


def occlusion_weights(model: AdjustmentProblem, state: AdjustmentState, n_sightings: int) -> Wholeness:
    """How whole the people are in each of the evidence's `n_sightings`; those that are not in the model count as whole."""
    problem = replace(model.problem, whole=None)
    s = problem.sightings
    box = s.has_foot > 0
    weight = np.ones(n_sightings)
    if not box.any():
        return Wholeness(weight, 0.0)
    centre, height = (term.residual for term in problem.terms(state, jacobians=False)[:2])
    share = problem.centre_sigma() / problem.scale_px
    # Boxes of one scene are comparable once each is measured by its own noise.
    typical = (share / np.median(share[box]))[box]
    middle = centre[box, 1] * share[box] / typical
    half = 0.5 * height[box, 0] * problem.height_sigma()[box] / typical
    judged = weight_truncated_boxes(middle - half, middle + half)
    weight[model.rows[box]] = judged.weight
    return Wholeness(weight, judged.broken)


def learn_noise(model: AdjustmentProblem, result: Result[AdjustmentState], broken: float = 0.0) -> Noise:
    """The sightings' noise from their residuals, each divided by the root of its redundancy.

    The redundancy is the share of a residual that the fit does not absorb (Foerstner 1979); medians keep outliers out. Boxes
    whose noise is all rounding keep the floor. `broken` is the share of broken edges that `occlusion_weights` found.
    """
    problem, noise = model.problem, model.problem.noise
    terms = problem.terms(result.state, jacobians=True)
    normal = result.normal
    s = problem.sightings
    box = s.has_foot > 0
    if np.count_nonzero(box) >= 30:
        V_inverse = np.asarray(np.linalg.inv(normal.families[0].V), dtype=np.float64)
        box_px, centre = _box_noise(problem, terms[0], V_inverse, box)
        factor = _whitened_scale(terms[1], V_inverse, box)[0]
        typical = float(np.median(problem.scale_px[box]))
        least_ratio = MIN_HEIGHT_RATIO * (1 + min(broken / BROKEN_FOR_DOUBLE, 1.0))
        total = factor * np.hypot(HEIGHT_PER_CENTRE * noise.box_px / typical, noise.height)
        height = float(np.sqrt(max(total**2 - (HEIGHT_PER_CENTRE * box_px / typical) ** 2, 1e-6)))
        noise = replace(noise, box_px=box_px, centre=centre, height=max(height, least_ratio * centre), broken=broken)
    if problem.n_joints and len(problem.joints.camera) >= 30:
        noise = _learn_joints(model, next(t for t in terms if t.family == JOINT and t.by_block is not None), normal)
    return noise


def _box_noise(problem: PeopleProblem, term: Term, V_inverse: Floats, box: NDArray[np.bool_]) -> tuple[float, float]:
    """What the centres of boxes are off by: pixels at any size, and a share of the size; from boxes of `SIZES` sizes.

    The variance is taken to be linear in the squared size; non-negative least squares, weighed by what is known of each size.
    """
    base = Noise().box_px
    before = np.hypot(problem.noise.box_px, problem.noise.centre * problem.scale_px)
    boxes = np.flatnonzero(box)
    by_size = boxes[np.argsort(problem.scale_px[boxes], kind="stable")]
    variance, square, weight = [], [], []
    for rows in np.array_split(by_size, min(SIZES, max(len(boxes) // (2 * MIN_FOR_NOISE), 1))):
        use = np.zeros(len(box), bool)
        use[rows] = True
        scale = np.sqrt(np.mean(_whitened_scale(term, V_inverse, use) ** 2)) * float(np.median(before[use]))
        variance.append(scale**2)
        square.append(float(np.median(problem.scale_px[use])) ** 2)
        weight.append(np.sqrt(np.count_nonzero(use)) / scale**2)
    v, h, w = np.array(variance), np.array(square), np.array(weight)
    # One size tells one number: then all is taken to be a share of it.
    design = np.column_stack([np.full(len(v), float(len(v) > 1)), h])
    (more, share), _ = nnls(design * w[:, None], np.maximum(v - base**2, 0.0) * w)
    return float(np.hypot(base, np.sqrt(more))), float(np.sqrt(max(share, 1e-6)))


def _learn_joints(model: AdjustmentProblem, term: Term, normal: NormalEquations) -> Noise:
    """The noise of joints: one share for all, and a factor for each joint of the body in each camera.

    Detectors find eyes better than hips, and a hip better from the front than from the side: half of each factor's logarithm
    comes from the camera's own residuals of that joint, half from all cameras'.
    """
    problem, noise = model.problem, model.problem.noise
    V_inverse = np.asarray(np.linalg.inv(normal.families[JOINT].V), dtype=np.float64)
    every = np.ones(len(term.residual), bool)
    kind = model.joint_kind[problem.joints.point]
    scale = float(np.sqrt(np.mean(_whitened_scale(term, V_inverse, every) ** 2)))
    n_kinds = int(kind.max()) + 1 if noise.kinds is None else noise.kinds.shape[1]
    before = np.ones((problem.n_cameras, n_kinds)) if noise.kinds is None else noise.kinds
    factor = np.ones((problem.n_cameras, n_kinds))
    for k in np.unique(kind):
        of_kind = kind == k
        common = np.sqrt(np.mean(_whitened_scale(term, V_inverse, of_kind) ** 2)) if of_kind.sum() >= MIN_FOR_NOISE else scale
        for c in range(problem.n_cameras):
            own = of_kind & (problem.joints.camera == c)
            here = np.sqrt(np.mean(_whitened_scale(term, V_inverse, own) ** 2)) if own.sum() >= MIN_FOR_NOISE else common
            factor[c, k] = np.sqrt(common * here) / scale
    typical = float(np.median(problem.joints.sigma_px) / noise.joint)
    return replace(
        noise, joint=_rescaled(noise.joint, noise.floor_px / typical, scale), kinds=np.clip(before * factor, 0.2, 5.0)
    )


def _whitened_scale(term: Term, V_inverse: Floats, use: NDArray[np.bool_]) -> Floats:
    """(k,) robust standard deviation of whitened residuals over their redundancy: 1 where the noise was guessed right."""
    assert term.by_block is not None
    assert term.block is not None
    assert term.loss is not None
    residual, J, block = term.residual[use], term.by_block[use], term.block[use]
    weight = term.loss.weight(np.einsum("mk,mk->m", residual, residual))[:, None]
    leverage = np.einsum("mki,mij,mkj->mk", J, V_inverse[block], J) * weight
    redundancy = np.clip(1 - leverage, 0.05, 1.0)
    return np.asarray(NORMAL_BY_MAD * np.median(np.abs(residual) / np.sqrt(redundancy), axis=0))


def _rescaled(share: float, floor: float, factor: float) -> float:
    """The share whose noise, with the floor, is `factor` times the one before; never below a thousandth."""
    total = np.hypot(share, floor) * factor
    return float(np.sqrt(max(total**2 - floor**2, 1e-6)))
