"""Uncertainty of the adjusted cameras: their covariance from the reduced system.

The world may be turned about the vertical and moved along the ground without a change of any residual. The covariance is that
of the rig after the best such placement on the camera centres (inner constraints: Teunissen 1985, *Generalized Inverses,
Adjustment, the Datum Problem and S-Transformations*), so that no camera is a reference. The parts that no evidence constrains
(`gauge`) have infinite sigmas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import PoseSigma
from passerby.solver.adjustment_problem import AdjustmentProblem
from passerby.solver.cue_terms import LENGTH
from passerby.solver.evidence import Evidence
from passerby.solver.gauge import SCALE, TILT_X, TILT_Y, VAGUE, Free, held_system, placement_freedoms, similarity_freedoms
from passerby.solver.lens_unknowns import LENS_PARTS, LensPart, LensUnknowns
from passerby.solver.optimizer.least_squares import NormalEquations, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import JOINT, TIME, UPRIGHT, PeopleProblem
from passerby.solver.systematic import ConsiderParameters

COMPLETE = 10
"""Number of parameters of a complete camera: six of the pose, four of the lens."""

CHUNK_INSTANTS = 40
"""Length of a stretch in instants: residuals of one person in one camera count as independent between stretches."""

OUTLYING, LEAST_REDUNDANCY, LEAST_STANCE = 3.0, 0.25, 0.1
"""Limits for the noise of feet and standing heights, in units of the given noise: largest residual, smallest redundancy, and
smallest estimated noise."""

USUAL_EFFECT, USUAL_COUNTS = 2.6, 10.0
"""Design effect of most recordings that are long enough to show it, and its weight as a number of sums over stretches. The fit
itself absorbs the common errors of few stretches (docs/results/limits.md)."""

MODEL_EXCESS = 1.4
"""Factor on the design effect for errors that last longer than a stretch. Errors of the shape over their sigmas on 110
simulated scenes of boxes (seeds 4711 to 4741, 4901 to 4979), root mean square: 1.18 with it, 1.25 without; of one person
during 12 s (26 scenes) 1.6 and 1.9."""

TIME_EXCESS = 1.6
"""Factor on the sigmas of clocks: errors of gait and lean follow the walking direction, as those of a late clock do. Errors
over sigmas, root mean square, without it: 1.5 in 27 scenes of the three presets (seeds as above). The sums of residuals along
the motion over stretches do not show it."""


@dataclass(frozen=True, eq=False)
class RigCovariance:
    """Uncertainty of the cameras, (C, 6, 6) each: centre (metres, world), then rotation vector (radians, camera frame)."""

    metric: Floats
    """Covariance after the best placement along the ground; it includes the errors of scale, vertical and ground."""
    shape: Floats
    """Covariance after the best similarity: relative poses of the cameras."""
    vertical_deg: float
    """One sigma of the angle between the rig's vertical and the true one."""
    scale: float
    """Relative one sigma of all lengths."""
    inflation: float
    """Factor on the covariance for the correlation of residuals in time (design effect)."""
    distances: Floats
    """(C, C) one sigma of the distance between two cameras, metres, the error of the scale included."""
    time_s: Floats | None = None
    """(C,) one sigma of the cameras' clocks relative to the first camera's, seconds; None where they were not refined."""
    lens: Floats | None = None
    """(C, L) one sigma of the lenses' unknowns; None where they were not refined."""
    free: Free = field(default_factory=Free)
    """Parts that no evidence constrains; their sigmas are infinite."""
    together: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(6 C, 6 C) joint covariance of all cameras, as `shape`; 0 along free directions, whose true variance is infinite."""
    complete: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(10 C, 10 C) covariance of complete cameras, intrinsics included, in the world of the adjustment: for each camera the
    centre, the rotation vector, the logarithm of the focal length, the principal point (pixels) and the first distortion
    coefficient."""

    def sigma(self, camera: int) -> PoseSigma:
        """Return one camera's one-sigma figures in the metric world."""
        n = len(self.complete) // COMPLETE
        blocks = self.complete.reshape(n, COMPLETE, n, COMPLETE)
        own = np.array(blocks[camera, :, camera]) if n else None
        if own is not None:  # only the covariance of the pose includes the error of the scale
            own[:6, :6] = self.metric[camera]
        return PoseSigma.from_covariance(self.metric[camera], own)

    def shape_sigma(self, camera: int) -> PoseSigma:
        """Return one camera's one-sigma figures within the rig, relative to the other cameras."""
        return PoseSigma.from_covariance(self.shape[camera])


def rig_covariance(
    terms: Sequence[Term], problem: PeopleProblem, state: AdjustmentState, inflation: float, scale_sigma: float,
    lens_sigma: Floats | None = None, held: ConsiderParameters | None = None, of_joints: float | None = None,
    estimated: Sequence[LensPart] = (),
) -> RigCovariance:  # fmt: skip
    """Compute the covariance of all cameras.

    Args:
        terms: linearised residuals at the optimum, in units of their true noise.
        problem: the person model.
        state: the optimum.
        inflation: design effect of the sightings: factor on the covariance because they are not independent; it does not
            apply to priors.
        scale_sigma: relative standard deviation of the scale, from all cues, with the error common to all people.
        lens_sigma: (C, L) one sigma of the lenses' unknowns, the last of each camera's; None where they are not refined.
        held: parts of the lenses that the adjustment does not estimate; None where lenses are exact.
        of_joints: the inflation of joints, where it is known separately; else None.
        estimated: parts of the lenses that are among the unknowns, in their order.
    """
    weighted = partial(downweight, inflation=inflation, of_joints=of_joints)
    own_terms = [weighted(term) for term in terms]
    H, size, n_cameras = NormalEquations(problem.layout, own_terms).reduce().H, problem.layout.camera_size, len(state.R)
    system, free = held_system(H, state, size)
    inverse = system.inverse()
    constraint = placement_freedoms(state, len(H), size)
    freedom = np.linalg.inv(system.constraint.T @ constraint)
    # The covariance that the constraint itself adds along the freedoms (Teunissen 1985) is not uncertainty of the cameras.
    covariance = inverse - constraint @ (freedom @ freedom.T) @ constraint.T
    by_boxes = ConsiderParameters.of_boxes(problem, state).moved(inverse, problem, terms, weighted)
    covariance = covariance + by_boxes @ by_boxes.T
    if lens_sigma is not None:
        covariance = _with_lens_sigmas(covariance, lens_sigma, size)
    cameras = covariance[np.ix_(system.own, system.own)]
    freedoms = similarity_freedoms(state, system.fixed)
    along = freedoms.along
    of_freedoms = along @ cameras @ along.T
    free = _with_vague(_with_unfixed(free, problem, scale_sigma), of_freedoms)
    # The adjustment contains the spread of single heights, but not the errors common to all people and boxes.
    beyond = 0.0 if free.scale else max(scale_sigma**2 - of_freedoms[SCALE, SCALE], 0.0)
    by_lenses = np.zeros((len(H), 0)) if held is None else held.moved(inverse, problem, terms, weighted)
    complete = _complete(covariance, by_lenses, held, system.own, size, estimated)
    covariance = covariance + by_lenses @ by_lenses.T
    cameras = covariance[np.ix_(system.own, system.own)]
    of_freedoms = along @ cameras @ along.T
    metric = cameras + beyond * np.outer(freedoms.moves[:, SCALE], freedoms.moves[:, SCALE])
    keep = np.eye(len(cameras)) - freedoms.moves @ along
    shape = keep @ cameras @ keep.T
    tilt = max(of_freedoms[TILT_X, TILT_X] + of_freedoms[TILT_Y, TILT_Y], 0.0)
    lost = np.isin(np.arange(n_cameras), free.cameras)
    distances = _distance_sigmas(metric, state.centre)
    distances[(lost[:, None] | lost | free.scale) & ~np.eye(n_cameras, dtype=bool)] = np.inf
    return RigCovariance(
        np.array([_with_free(b, free.position(c), free.orientation(c)) for c, b in enumerate(_blocks(metric, n_cameras))]),
        np.array([_with_free(b, lost[c], lost[c]) for c, b in enumerate(_blocks(shape, n_cameras))]),
        np.inf if free.vertical else float(np.degrees(np.sqrt(tilt))),
        np.inf if free.scale else float(np.sqrt(max(of_freedoms[SCALE, SCALE] + beyond, 0.0))), inflation, distances,
        _time_sigmas(covariance, size, n_cameras) if size - state.lens.shape[1] > TIME else None, lens_sigma, free,
        shape, complete,
    )  # fmt: skip


def _complete(
    covariance: Floats, by_lenses: Floats, held: ConsiderParameters | None, own: Ints, size: int, estimated: Sequence[LensPart]
) -> Floats:
    """Return the covariance (10 C, 10 C) of complete cameras: the centre, the rotation vector, the logarithm of the focal
    length, the principal point (pixels), the first distortion coefficient.

    Args:
        covariance: (n, n) of the shared unknowns, without the effect of the held lenses.
        by_lenses: (n, K) changes of the shared unknowns by the errors of the held lenses.
        held: parts of the lenses that the adjustment does not estimate; None where lenses are exact.
        own: (6 C,) indices of the poses' unknowns.
        size: number of a camera's unknowns; those of its lens are the last.
        estimated: parts of the lenses that are among the unknowns.
    """
    n = len(own) // 6
    unknowns = LensUnknowns(tuple(estimated))
    select = np.zeros((n, COMPLETE, len(covariance)))
    select[:, :6] = np.eye(len(covariance))[own].reshape(n, 6, -1)
    for part in unknowns.parts:
        columns, rows = unknowns.columns_of(part), LensUnknowns(LENS_PARTS).columns_of(part)
        for c in range(n):
            first = (c + 1) * size - unknowns.size
            select[c, 6 + rows.start : 6 + rows.stop, first + columns.start : first + columns.stop] = np.eye(
                rows.stop - rows.start
            )
    flat = select.reshape(n * COMPLETE, -1)
    lenses = np.zeros((n, COMPLETE, by_lenses.shape[1]))
    if held is not None:
        lenses[:, 6:] = held.root.reshape(n, COMPLETE - 6, -1)
    moved = flat @ by_lenses + lenses.reshape(n * COMPLETE, -1)
    return np.asarray(flat @ covariance @ flat.T + moved @ moved.T)


def _with_unfixed(free: Free, problem: PeopleProblem, scale_sigma: float) -> Free:
    """Return the free parts, extended by those that no kind of evidence present can determine.

    Where rays barely meet, the rounding of an elimination can hide a null vector; and an infinite sigma of the scale times a
    variance of 0 is NaN.
    """
    nothing = problem.cues is None and not len(problem.sightings)
    return replace(
        free, scale=free.scale or nothing or not np.isfinite(scale_sigma), vertical=free.vertical or nothing,
        ground=free.ground or nothing,
    )  # fmt: skip


def _with_vague(free: Free, of_freedoms: Floats) -> Free:
    """Return the free parts, extended by those with a sigma above `VAGUE` in the covariance of the freedoms (7, 7)."""
    tilt = of_freedoms[TILT_X, TILT_X] + of_freedoms[TILT_Y, TILT_Y]
    return replace(
        free, scale=free.scale or bool(of_freedoms[SCALE, SCALE] > VAGUE**2), vertical=free.vertical or bool(tilt > VAGUE**2)
    )


def _with_free(block: Floats, position: bool, orientation: bool) -> Floats:
    """Return the covariance (6, 6) of a pose with infinite variances where its position or its orientation is unknown."""
    rows = np.repeat([position, orientation], 3)
    if not rows.any():
        return block
    kept = np.where(rows[:, None] | rows, 0.0, block)
    kept[rows, rows] = np.inf
    return np.asarray(kept)


def _distance_sigmas(metric: Floats, centre: Floats) -> Floats:
    """Return the sigmas (C, C) of the cameras' distances, from the covariance of all poses (6 C, 6 C) and centres (C, 3)."""
    n = len(centre)
    of_centres = metric.reshape(n, 6, n, 6)[:, :3, :, :3]
    own = of_centres[np.arange(n), :, np.arange(n)]
    # Covariance of the difference of two centres: both covariances minus the cross-covariances.
    between = own[:, None] + own[None] - of_centres.transpose(0, 2, 1, 3) - of_centres.transpose(2, 0, 1, 3)
    apart = centre[:, None] - centre[None]
    line = apart / np.maximum(np.linalg.norm(apart, axis=-1), 1e-12)[..., None]
    return np.asarray(np.sqrt(np.maximum(np.einsum("abi,abij,abj->ab", line, between, line), 0.0)))


def _with_lens_sigmas(covariance: Floats, sigma: Floats, size: int) -> Floats:
    """Enlarge the covariance so that lenses have at least the sigmas `sigma` (C, L); all other unknowns follow by their
    regression on the lenses.
    """
    added = np.zeros_like(covariance)
    places = np.arange(1, len(sigma) + 1)[:, None] * size - sigma.shape[1] + np.arange(sigma.shape[1])
    for at, sd in zip(places.ravel(), sigma.ravel(), strict=True):
        along = covariance[:, at] / covariance[at, at]
        added += max(sd**2 - covariance[at, at], 0.0) * np.outer(along, along)
    return covariance + added


def _time_sigmas(covariance: Floats, size: int, n_cameras: int) -> Floats:
    """Return the sigmas (C,) of the clocks relative to the first camera's; their mean is held, so single ones mean little."""
    clocks = np.arange(n_cameras) * size + TIME
    against_first = np.eye(n_cameras)
    against_first[:, 0] -= 1.0
    variance = np.diag(against_first @ covariance[np.ix_(clocks, clocks)] @ against_first.T)
    return np.asarray(TIME_EXCESS * np.sqrt(np.maximum(variance, 0.0)))


def downweight(term: Term, inflation: float, of_joints: float | None = None) -> Term:
    """Return the term with its robust weights; those of people and joints, correlated in time, are divided by `inflation`.

    `of_joints` is the inflation of joints, where it is known separately.
    """
    squared = np.einsum("mk,mk->m", term.residual, term.residual)
    weight = term.loss.weight(squared) if term.loss is not None else np.ones(len(squared))
    if term.block is not None and term.family != LENGTH:
        weight = weight / (inflation if of_joints is None or term.family != JOINT else of_joints)
    return replace(_scaled(term, np.sqrt(weight)), loss=None)


def _scaled(term: Term, root: Floats) -> Term:
    """Return the term with its rows multiplied by `root` (M,)."""

    def scaled(J: Floats | None) -> Floats | None:
        return None if J is None else J * root.reshape(-1, *[1] * (J.ndim - 1))

    return replace(
        term, residual=term.residual * root[:, None], by_camera=scaled(term.by_camera),
        by_block=scaled(term.by_block), by_group=scaled(term.by_group), by_globals=scaled(term.by_globals),
        by_shared=scaled(term.by_shared),
    )  # fmt: skip


def add_learnt_stance(terms: Sequence[Term], normal: NormalEquations) -> list[Term]:
    """Return the terms, those of feet and standing heights rescaled from the given noise to the estimated noise.

    The given noise allows for kerbs, slopes and people who do not stand upright. Where feet stay on one plane, the ground is
    less uncertain, where they do not, more. The estimate is the root mean square of the residuals, with outliers limited, over
    the root of their redundancy (Foerstner 1979), which is 0.75 to 0.99 in simulated scenes.
    """
    out = []
    for term in terms:
        of_stance = term.family == UPRIGHT and term.camera is None and term.block is not None and term.loss is not None
        if of_stance and len(term.residual):
            assert term.by_block is not None
            V_inverse = np.linalg.inv(normal.families[UPRIGHT].V)[term.block]
            absorbed = np.einsum("mki,mij,mkj->m", term.by_block, V_inverse, term.by_block)
            redundancy = float(np.mean(np.clip(1.0 - absorbed, 0.0, 1.0)))
            square = float(np.mean(np.minimum(term.residual[:, 0] ** 2, OUTLYING**2)))
            factor = 1.0 / np.sqrt(max(square / max(redundancy, LEAST_REDUNDANCY), LEAST_STANCE**2))
            term = _scaled(term, np.full(len(term.residual), factor))
        out.append(term)
    return out


def _blocks(covariance: Floats, n_cameras: int) -> Floats:
    return np.array([covariance[c * 6 : c * 6 + 6, c * 6 : c * 6 + 6] for c in range(n_cameras)])


def design_effect(model: AdjustmentProblem, evidence: Evidence, terms: list[Term]) -> float:
    """Estimate the design effect: the factor on the covariance because residuals are not independent.

    A person's gait, clothes and posture shift the boxes of one camera in the same way for a while. The ratio of the variance of
    sums over such stretches to that of single residuals measures the effect (Kish 1965); 1 where all are independent. Few
    stretches show little of it, because cameras and people are fitted to them; there the usual value is used (`USUAL_EFFECT`).
    """
    s = model.problem.sightings
    if len(s) == 0:
        return _joint_inflation(model)
    instant = np.unique(evidence.frame, return_inverse=True)[1]
    blocks = model.blocks[s.block]
    stretch = instant[blocks] // CHUNK_INSTANTS
    key = np.column_stack([s.camera, evidence.person[blocks], stretch])
    seen = max(1.0, max(_design_effect(term, key) for term in terms[:2]))
    left = sums_left(key)
    return MODEL_EXCESS * (left * seen + USUAL_COUNTS * USUAL_EFFECT) / (left + USUAL_COUNTS)


def sums_left(key: Ints) -> int:
    """Count the sums over stretches that the fit does not absorb: two per stretch, minus two per place, minus six per camera.

    A place is one person during one stretch of time.

    Args:
        key: (M, 3) camera, person and stretch of time of each sighting.
    """
    stretches, places, cameras = (len(np.unique(some, axis=0)) for some in (key, key[:, 1:], key[:, 0]))
    return max(2 * stretches - 2 * places - 6 * cameras, 0)


def joint_design_effect(model: AdjustmentProblem, evidence: Evidence, terms: Sequence[Term]) -> float | None:
    """Estimate the design effect of joints: the larger of two, by stretches of one joint, and by kind of joint and camera.

    A detector has an error of a joint that depends on pose and view, for seconds or throughout. None where there are no joints.
    """
    joints = model.problem.joints
    if not len(joints.camera):
        return None
    term = next(term for term in terms if term.family == JOINT and term.block is not None)
    point = model.joints[joints.point]
    kind, whose = evidence.joint_kind[point], evidence.joint_person[point]
    stretch = np.unique(evidence.joint_frame, return_inverse=True)[1][point] // CHUNK_INSTANTS
    keys = np.column_stack([joints.camera, kind, whose, stretch]), np.column_stack([joints.camera, kind])
    return MODEL_EXCESS * max(1.0, *(_design_effect(term, key) for key in keys))


def _joint_inflation(model: AdjustmentProblem) -> float:
    """Return the design effect without sightings of people: `MODEL_EXCESS` for each 2000 joint sightings, at least once."""
    return MODEL_EXCESS * float(max(1, len(model.problem.joints.camera) // 2000))


def _design_effect(term: Term, key: Ints) -> float:
    squared = np.einsum("mk,mk->m", term.residual, term.residual)
    weight = term.loss.weight(squared) if term.loss is not None else np.ones(len(squared))
    weighted = term.residual * weight[:, None]
    _, group = np.unique(key, axis=0, return_inverse=True)
    sums = np.array([np.bincount(group.ravel(), column) for column in weighted.T])
    return float((sums**2).sum() / max((weighted**2).sum(), 1e-12))
