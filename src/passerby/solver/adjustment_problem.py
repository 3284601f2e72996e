"""Problem of one round of the refinement: the sightings that agree with a rig, their noise, and prior knowledge."""

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

# Distance in sigmas of its centre within which a sighting agrees; nearer outliers are handled by the Cauchy loss.
AGREE_SIGMAS = 6.0
GROUPS_COUNT_MORE = 10.0
"""Factor on the weight of the prior on groups. Residuals are correlated in time, but are weighted as independent; the weight of
the prior is increased accordingly (as in `JOINED_FOOT_SHIFT_SD`)."""
# Smallest ratio of the noise of a box's height to that of its centre: the height is the difference of two edges, the centre
# their mean. The errors that a detector makes in people's heights are not white either (over PETS2009 and simulated scenes 2 to
# 3 measured best).
MIN_HEIGHT_RATIO = 2.5
# Where many edges are broken, slightly broken ones count as whole, and their errors have one direction: the height of a box is
# wrong by the whole missing part, its centre by half of it. The minimum ratio grows, and doubles at this share of broken edges
# (rendered videos, a background's boxes, 18 % broken: 0.49 degrees and 1.0 % of scale instead of 0.73 and 4.3; a network's, 8 %
# broken: 0.59 and 2.0 % instead of 0.61 and 2.2).
BROKEN_FOR_DOUBLE = 0.1
MIN_FOR_NOISE = 20
SIZES = 6
# Standard deviation of the logarithm of people's visible lengths over their standing heights, where some people crouch.
POSTURE_SD = 0.15


@dataclass(frozen=True, eq=False)
class RigState:
    """Values of the shared unknowns and of the standing heights between rounds."""

    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    heights: Floats
    """(P,) standing heights, metres."""
    slack: Floats
    globals: Floats
    time: Floats
    """(C,) errors of the clocks, seconds (`AdjustmentState`)."""
    lens: Floats
    """(C, L) differences of the lenses from the stated ones (`AdjustmentState`)."""
    lengths: Floats
    """(K, 6) ends of the known lengths, metres (`AdjustmentState`)."""

    @classmethod
    def start(cls, R: Floats, centre: Floats, height_mean: Floats, priors: Priors, marks: Floats, lens: Floats) -> RigState:
        """Return a first state: people as tall as expected, no slack, clocks as stated."""
        none = np.zeros(len(R))
        shift = np.array([priors.foot_shift])
        return cls(R, centre, height_mean.copy(), none, shift, none, lens, marks.reshape(-1, 6))


@dataclass(frozen=True, eq=False)
class AdjustmentProblem:
    """The problem of one round, its start, and the rows of the evidence that are in it."""

    problem: PeopleProblem
    state: AdjustmentState
    rows: Ints
    """Rows of the evidence's sightings, in the problem's order."""
    renamed: int
    """Number of these rows that were assigned to another person than their identity states."""
    blocks: Ints
    """Person-instants of the evidence, in the problem's order."""
    joint_rows: Ints
    joints: Ints
    joint_kind: Ints
    """(J,) body joint (its number in the files) of each joint of the problem."""

    def near(self, before: AdjustmentProblem, found: AdjustmentState) -> AdjustmentProblem:
        """Return the same problem with a better start: people and joints with unchanged sightings start at `found`.

        Args:
            before: problem of an earlier round.
            found: its solution.
        """
        people, joints = self.state.people.copy(), self.state.joints.copy()
        here, there = _common(*((one.blocks, one.problem.sightings.block, one.rows) for one in (self, before)))
        people[here] = found.people[there]
        here, there = _common(*((one.joints, one.problem.joints.point, one.joint_rows) for one in (self, before)))
        joints[here] = found.joints[there]
        return replace(self, state=replace(self.state, people=people, joints=joints))


def _common(now: tuple[Ints, Ints, Ints], before: tuple[Ints, Ints, Ints]) -> tuple[Ints, Ints]:
    """Find the person-instants, or joints, that have the same sightings in two lists: their places (K,), (K,) in both.

    Args:
        now: (N,) unique numbers in the evidence, (M,) place of each sighting in that list, and (M,) its row of the evidence.
        before: the same of the other list.
    """
    _, here, there = np.intersect1d(now[0], before[0], assume_unique=True, return_indices=True)
    same = np.ones(len(here), dtype=bool)
    for power in (0, 1, 2):  # compares the number of the rows, their sum and the sum of their squares
        sums = [np.bincount(at, rows.astype(np.float64) ** power, len(listed)) for listed, at, rows in (now, before)]
        same &= sums[0][here] == sums[1][there]
    return here[same], there[same]


@dataclass(frozen=True, eq=False)
class PriorKnowledge:
    """Knowledge that all rounds share: priors, cues, and the expected height of each person."""

    height_mean: Floats
    height_sd: Floats
    priors: Priors = field(default_factory=Priors)
    cues: CueRows | None = None
    lens_core: Floats | None = None
    """(C, L) scales of the priors on the lenses (`PeopleProblem`); None where they are not refined."""
    lens_weight: Floats = field(default_factory=lambda: np.ones(()))
    """Factor on the weight of these priors (`PeopleProblem`)."""
    lens_normal: bool = False
    """Whether the scales are standard deviations (`PeopleProblem`)."""
    lens_groups: tuple[tuple[int, ...], ...] = ()
    """Cameras of one model (`PeopleProblem`)."""
    lens_far: Floats | None = None
    """(C, L) standard deviations of the additional normal priors on the lenses (`PeopleProblem`)."""
    lens_model: LensModel | None = None
    """The lenses whose unknowns these are (`PeopleProblem`)."""
    groups: tuple[tuple[int, ...], ...] = ()
    """Groups of cameras that were separate rigs before (`PeopleProblem`)."""
    height_spread: Floats | None = None
    """(P,) standard deviation of heights, as a share, for people of the population; NaN for people of stated height."""
    unusual: NDArray[np.bool_] | None = None
    """(P,) whether a person of the population is far taller or shorter than most; such heights do not determine the scale."""

    @property
    def height_weight_sd(self) -> Floats:
        """(P,) `height_sd`, for unusual people replaced by `height_mean`, metres."""
        return self.height_sd if self.unusual is None else np.where(self.unusual, self.height_mean, self.height_sd)

    def judged(self, heights: Floats, seen: Ints) -> PriorKnowledge:
        """Return the same knowledge with unusual people marked, from heights (P,) in metres and the numbers of seen people."""
        if self.height_spread is None:
            return self
        known = np.isin(np.arange(len(heights)), seen) & np.isfinite(self.height_spread)
        return replace(self, unusual=unusual_people(heights, known, self.height_spread))


def middle_rays(s: Sightings) -> tuple[Floats, Floats]:
    """Return the rays (M, 3) and tangents (M, 2, 3) to the middles of the sightings."""
    ray = s.top + s.bottom
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    tangent = 0.5 * (s.top_tangent + s.bottom_tangent)
    # A tangent must be orthogonal to its ray; the mean of two tangents is so only approximately.
    tangent = tangent - np.einsum("mki,mi->mk", tangent, ray)[:, :, None] * ray[:, None, :]
    return ray, tangent


def _on_time(ray: Floats, tangent: Floats, velocity: Floats | None, seconds: Floats) -> Floats:
    """Return the rays (M, 3) corrected for time offsets `seconds` (M,) of the cameras' clocks."""
    if velocity is None or not seconds.any():
        return ray
    moved = -velocity * seconds[:, None]
    # The smallest change of the ray that moves its image by these pixels.
    gram = tangent @ tangent.transpose(0, 2, 1)
    on_time = ray + (tangent.transpose(0, 2, 1) @ np.linalg.solve(gram, moved[:, :, None]))[:, :, 0]
    return np.asarray(on_time / np.linalg.norm(on_time, axis=1, keepdims=True))


def build_problem(
    evidence: Evidence, rig: RigState, noise: Noise, knowledge: PriorKnowledge, *, share: float,
    blocks: Ints | None = None, joints: Ints | None = None, stance: Floats | None = None, rename: bool = False,
    whole: Floats | None = None,
) -> AdjustmentProblem:  # fmt: skip
    """Select the sightings that agree with a rig, and build the problem and its start from them.

    Args:
        evidence: all sightings.
        rig: current estimate of cameras and people.
        noise: weights of the residuals.
        knowledge: priors and cues.
        share: tolerance of agreement, as a share of the sightings' extent.
        blocks: person-instants to use; all when None.
        joints: joints to use; all when None.
        rename: whether sightings that disagree with their person may be assigned to another one of the same instant.
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
    """Predict the extents (M,) in pixels, from the lowest to the highest point, of people who stand upright.

    Args:
        s: sightings.
        centre: (C, 3) camera centres, metres.
        points: (N, 3) middles of the blocks' people, metres.
        heights: (N,) standing heights of these people, metres.
    """
    reach = points[s.block] - centre[s.camera]
    distance = np.maximum(np.linalg.norm(reach, axis=1), 0.1)
    # A vertical length is seen foreshortened by the sine of its angle with the ray; the tangent's rows are pixels a radian.
    across = np.sqrt(np.maximum(1 - (reach[:, 2] / distance) ** 2, 0.05))
    _, tangent = middle_rays(s)
    pixels = np.linalg.norm(tangent[:, 1], axis=1) / distance
    return np.asarray(pixels * across * ((s.top_fraction - s.bottom_fraction) * heights[s.block]))


def _expected_extents(s: Sightings, person: Ints, rig: RigState, points: Floats, noise: Noise) -> Floats:
    """Return the expected extents (M,) of the people in the sightings, pixels.

    The observed extent is noisy. A person who stands where the rays of all cameras meet has a known extent, but may be bent.
    The result is the mean of both logarithms, weighted by their variances.

    Args:
        s: sightings that agree.
        person: (N,) person of each block.
        rig: current estimate of cameras and people.
        points: (N, 3) middles of the blocks, metres.
        noise: noise of the observed extents.
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
    """Select the joints that agree: sightings renumbered, positions (J, 3), and rows and joints (J,) of the evidence."""
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
    # `sigma_px` of the evidence holds the person's extent; the noise of a joint is a share of it.
    share_px = noise.joint * o.sigma_px[rows]
    if noise.kinds is not None:
        share_px = share_px * noise.kinds[o.camera[rows], evidence.joint_kind[o.point[rows]]]
    sigma = np.hypot(noise.floor_px, share_px)
    taken = replace(o.take(rows), point=number[o.point[rows]], sigma_px=sigma)
    return taken, consensus.points[used], rows, used


def rig_of(state: AdjustmentState) -> RigState:
    """Return the part of a state from which the next round starts."""
    return RigState(
        state.R, state.centre, state.heights, state.slack, state.globals, state.time, state.lens, state.lengths
    )  # fmt: skip


def occlusion_weights(model: AdjustmentProblem, state: AdjustmentState, n_sightings: int) -> Wholeness:
    """Return the probability that each of the evidence's `n_sightings` shows a whole person; 1 for those not in the model."""
    problem = replace(model.problem, whole=None)
    s = problem.sightings
    box = s.has_foot > 0
    weight = np.ones(n_sightings)
    if not box.any():
        return Wholeness(weight, 0.0)
    centre, height = (term.residual for term in problem.terms(state, jacobians=False)[:2])
    share = problem.centre_sigma() / problem.scale_px
    # Boxes of one scene are comparable when each is divided by its own noise.
    typical = (share / np.median(share[box]))[box]
    middle = centre[box, 1] * share[box] / typical
    half = 0.5 * height[box, 0] * problem.height_sigma()[box] / typical
    judged = weight_truncated_boxes(middle - half, middle + half)
    weight[model.rows[box]] = judged.weight
    return Wholeness(weight, judged.broken)


def learn_noise(model: AdjustmentProblem, result: Result[AdjustmentState], broken: float = 0.0) -> Noise:
    """Estimate the sightings' noise from their residuals, each divided by the root of its redundancy.

    The redundancy is the share of a residual that the fit does not absorb (Foerstner 1979). Medians make the estimate robust.
    Boxes whose noise is only rounding keep the lower limit. `broken` is the share of broken edges from `occlusion_weights`.
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
    """Estimate the noise of the centres of boxes: a part in pixels, and a part as a share of the size.

    The variance is assumed linear in the squared size. It is fitted by weighted non-negative least squares to boxes in `SIZES`
    classes of size.
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
    # With one class of size, only one number can be estimated: then all noise is a share of the size.
    design = np.column_stack([np.full(len(v), float(len(v) > 1)), h])
    (more, share), _ = nnls(design * w[:, None], np.maximum(v - base**2, 0.0) * w)
    return float(np.hypot(base, np.sqrt(more))), float(np.sqrt(max(share, 1e-6)))


def _learn_joints(model: AdjustmentProblem, term: Term, normal: NormalEquations) -> Noise:
    """Estimate the noise of joints: one share for all, and a factor for each joint of the body in each camera.

    Detectors find eyes better than hips, and a hip better from the front than from the side. The logarithm of each factor is
    the mean of two: from the camera's own residuals of that joint, and from those of all cameras.
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
    """Return the robust sigma (k,) of whitened residuals over the root of their redundancy; 1 if the noise was correct."""
    assert term.by_block is not None
    assert term.block is not None
    assert term.loss is not None
    residual, J, block = term.residual[use], term.by_block[use], term.block[use]
    weight = term.loss.weight(np.einsum("mk,mk->m", residual, residual))[:, None]
    leverage = np.einsum("mki,mij,mkj->mk", J, V_inverse[block], J) * weight
    redundancy = np.clip(1 - leverage, 0.05, 1.0)
    return np.asarray(NORMAL_BY_MAD * np.median(np.abs(residual) / np.sqrt(redundancy), axis=0))


def _rescaled(share: float, floor: float, factor: float) -> float:
    """Return the share whose noise, together with the floor, is `factor` times the previous one; at least a thousandth."""
    total = np.hypot(share, floor) * factor
    return float(np.sqrt(max(total**2 - floor**2, 1e-6)))
