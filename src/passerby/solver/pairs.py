"""Hypotheses of the relative pose of two cameras, by two routes.

*Ground*: both cameras are levelled by their own people (`geometry.single_view`), so that they differ by a motion of the plane
only; two matched people determine it. *Epipolar*: the essential matrix of highest and lowest points (or of joints), its
baseline scaled by the people's height. The routes fail in different cases: the first where a camera's vertical is poor, the
second where all points are far away or on one plane. Both are kept, and third cameras decide between them (`pose_graph`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.geometry.groups import cauchy_weights
from passerby.geometry.rotations import fit_plane_similarity
from passerby.geometry.single_view import Level
from passerby.geometry.triangulation import PointObservations, triangulate_two_views
from passerby.geometry.two_view import PairHypothesis, estimate_relative_pose
from passerby.people.sightings import Sightings
from passerby.solver.evidence import Evidence

MIN_MATCHES = 8
MAX_MATCHES = 600
ALL_PAIRS_UP_TO = 12
"""Number of cameras up to which all pairs are compared. In larger rigs, it is the number of partners of each camera; then the
time grows with the number of cameras."""
FORESTS = 3
"""Number of spanning forests, weighted by shared sightings, whose pairs are compared too. They give several connections between
groups, which third cameras can confirm."""
_GROUND_TRIALS = 400
# Sigma of a ground position, as a share of its distance and in metres: box noise, stance, and the remaining tilt of the level.
_GROUND_SHARE, _GROUND_FLOOR_M = 0.06, 0.15
SHOWN_SHARE = 0.4
"""Approximate share of a body's height that joints show of people who are not seen whole: from the hips to the head. All pairs
must use the same length; its value has little influence."""


def pair_hypotheses(
    evidence: Evidence, levels: list[Level | None], focal: Floats, person_height_m: float, rng: np.random.Generator
) -> list[PairHypothesis]:
    """Compute the hypotheses of the pairs of cameras that saw the same people at the same instants: of all pairs in small rigs,
    of `compared_pairs` in large ones.

    Args:
        evidence: sightings with identities.
        levels: one per camera, None where it could not be found.
        focal: (C,) focal lengths, pixels.
        person_height_m: expected standing height, metres.
        rng: draws samples.
    """
    out: list[PairHypothesis] = []
    for a, b in compared_pairs(shared_blocks(evidence)):
        out += _pair(evidence, levels, focal, person_height_m, a, b, rng)
    return out


def shared_blocks(evidence: Evidence) -> Ints:
    """Count the person-instants and joints (C, C) that each two cameras share."""
    n, s, j = evidence.n_cameras, evidence.sightings, evidence.joints
    total = np.zeros((n, n), np.int64)
    for camera, block in ((s.camera, s.block), (j.camera, j.point)):
        if len(block):
            there = np.zeros((n, int(block.max()) + 1), np.float32)
            there[camera, block] = 1.0
            total += (there @ there.T).astype(np.int64)
    return total


def compared_pairs(shared: Ints) -> list[tuple[int, int]]:
    """Return the pairs (a, b), a < b, for which hypotheses are computed.

    With up to `ALL_PAIRS_UP_TO` cameras these are all pairs. In larger rigs, they are the partners of each camera that share
    most with it, and pairs that connect groups of cameras.

    Args:
        shared: (C, C) number of sightings that each two cameras share.
    """
    n = len(shared)
    if n <= ALL_PAIRS_UP_TO:
        return [(a, b) for a in range(n) for b in range(a + 1, n)]
    weight = np.triu(shared, 1)
    both = weight + weight.T
    chosen = np.zeros((n, n), bool)
    partners = np.argsort(-both, axis=1, kind="stable")[:, :ALL_PAIRS_UP_TO]
    chosen[np.arange(n)[:, None], partners] = True
    rest = weight.copy()
    for _ in range(FORESTS):
        # Weights are inverted, so that the minimum spanning forest is the maximum one. Pairs that share nothing are no edges.
        forest = minimum_spanning_tree(csr_array(np.where(rest > 0, rest.max() + 1.0 - rest, 0.0))).toarray() > 0
        chosen |= forest
        rest[forest] = 0
    chosen = (chosen | chosen.T) & (both > 0)
    return [(int(a), int(b)) for a, b in zip(*np.nonzero(np.triu(chosen, 1)), strict=True)]


def verify_guesses(
    guesses: Sequence[PairHypothesis], evidence: Evidence, focal: Floats, person_height_m: float
) -> list[PairHypothesis]:
    """Return given hypotheses with inliers and matches counted on the evidence, as for those of `pair_hypotheses`.

    A hypothesis of cameras that share no sightings of whole people is left out: no evidence would connect the two.
    """
    s = evidence.sightings
    out = []
    for h in guesses:
        rows_a, rows_b = shared_rows(s.camera, s.block, h.a, h.b)
        if len(rows_a):
            out.append(_judged(h, s.take(rows_a), s.take(rows_b), focal, person_height_m))
    return out


def shared_rows(camera: Ints, block: Ints, a: int, b: int) -> tuple[Ints, Ints]:
    """Return the rows (K,) of camera a and (K,) of camera b that show the same blocks, in the same order."""
    rows_a, rows_b = np.flatnonzero(camera == a), np.flatnonzero(camera == b)
    _, in_a, in_b = np.intersect1d(block[rows_a], block[rows_b], assume_unique=True, return_indices=True)
    return rows_a[in_a], rows_b[in_b]


def _pair(
    evidence: Evidence,
    levels: list[Level | None],
    focal: Floats,
    person_height_m: float,
    a: int,
    b: int,
    rng: np.random.Generator,
) -> list[PairHypothesis]:
    s = evidence.sightings
    rows_a, rows_b = shared_rows(s.camera, s.block, a, b)
    if len(rows_a) > MAX_MATCHES:
        pick = np.sort(rng.choice(len(rows_a), MAX_MATCHES, replace=False))
        rows_a, rows_b = rows_a[pick], rows_b[pick]
    at_a, at_b = s.take(rows_a), s.take(rows_b)
    out = []
    level_a, level_b = levels[a], levels[b]
    if len(at_a) >= MIN_MATCHES and level_a is not None and level_b is not None:
        found = _by_ground(at_a, at_b, level_a, level_b, rng)
        if found is not None:
            out.append(PairHypothesis(a, b, *found, "ground", 0, len(at_a)))
    if len(at_a) >= MIN_MATCHES and not evidence.n_joints:
        angle = _threshold(at_a, focal[a]) + _threshold(at_b, focal[b])
        rays_a, rays_b = np.concatenate([at_a.top, at_a.bottom]), np.concatenate([at_b.top, at_b.bottom])
        found = _by_epipolar(rays_a, rays_b, angle, at_a, at_b, person_height_m, rng)
        if found is not None:
            out.append(PairHypothesis(a, b, *found, "epipolar", 0, len(at_a)))
    j = evidence.joints
    joint_a, joint_b = shared_rows(j.camera, j.point, a, b)
    if len(joint_a) >= 3 * MIN_MATCHES:
        if len(joint_a) > 3 * MAX_MATCHES:
            pick = np.sort(rng.choice(len(joint_a), 3 * MAX_MATCHES, replace=False))
            joint_a, joint_b = joint_a[pick], joint_b[pick]
        angle = float(np.median(j.sigma_px[joint_a]) / focal[a] + np.median(j.sigma_px[joint_b]) / focal[b]) * 0.02
        found = _by_epipolar(j.bearing[joint_a], j.bearing[joint_b], angle, at_a, at_b, person_height_m, rng)
        if found is not None and not len(at_a):
            found = _by_extents(found, j.take(joint_a), j.take(joint_b), focal[[a, b]], person_height_m)
        if found is not None:
            out.append(PairHypothesis(a, b, *found, "joints", 0, len(joint_a)))
    return [_judged(h, at_a, at_b, focal, person_height_m) for h in out]


def _threshold(at: Sightings, focal: float) -> float:
    """Return the largest epipolar error of an inlier in one camera, radians: 4 % of the median extent, plus a pixel."""
    return float(0.04 * np.median(at.extent_px) / focal) + 1.0 / focal


def _by_ground(
    at_a: Sightings, at_b: Sightings, level_a: Level, level_b: Level, rng: np.random.Generator
) -> tuple[Floats, Floats] | None:
    """Fit the plane motion that moves most people of camera a to those of camera b: two-point RANSAC, then reweighted fits.

    Returns the relative pose (R_ba (3, 3), t_ba (3,) in metres); None without enough positions.
    """
    ground_a, ground_b = level_a.ground_positions(at_a.bottom), level_b.ground_positions(at_b.bottom)
    good = np.isfinite(ground_a).all(axis=1) & np.isfinite(ground_b).all(axis=1)
    ground_a, ground_b = ground_a[good], ground_b[good]
    if len(ground_a) < MIN_MATCHES:
        return None
    sigma = _GROUND_FLOOR_M + _GROUND_SHARE * (np.linalg.norm(ground_a, axis=1) + np.linalg.norm(ground_b, axis=1))
    first, second = rng.integers(len(ground_a), size=(2, _GROUND_TRIALS))
    a = ground_a[:, 0] + 1j * ground_a[:, 1]
    b = ground_b[:, 0] + 1j * ground_b[:, 1]
    span = a[second] - a[first]
    turn = np.divide(b[second] - b[first], span, out=np.zeros_like(span), where=np.abs(span) > 1e-9)
    # Two people must be far enough apart to give a direction, and about equally far apart in both cameras.
    sound = (np.abs(span) > 2 * sigma[first]) & (np.abs(turn) > 0.6) & (np.abs(turn) < 1.6)
    if not sound.any():
        return None
    turn, anchor = turn[sound] / np.abs(turn[sound]), first[sound]
    shift = b[anchor] - turn * a[anchor]
    miss = np.abs(turn[:, None] * a[None, :] + shift[:, None] - b[None, :]) / sigma
    best = int(np.argmin(np.log1p(miss**2).sum(axis=1)))
    weight = cauchy_weights(miss[best] ** 2)
    for _ in range(10):
        fit = fit_plane_similarity(ground_a, ground_b, weight / sigma**2, with_scale=False)
        weight = cauchy_weights((np.linalg.norm(fit.apply(ground_a) - ground_b, axis=1) / sigma) ** 2)
    c, s = np.cos(fit.yaw), np.sin(fit.yaw)
    turn_level = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    R_lb = level_b.R_lc
    # The levelled frames have their origins at the cameras; camera a's ground lies its own height below.
    shift_level = np.array([*fit.translation, level_a.height - level_b.height])
    return R_lb.T @ turn_level @ level_a.R_lc, R_lb.T @ shift_level


def _by_epipolar(
    rays_a: Floats,
    rays_b: Floats,
    angle: float,
    at_a: Sightings,
    at_b: Sightings,
    person_height_m: float,
    rng: np.random.Generator,
) -> tuple[Floats, Floats] | None:
    """Estimate the relative pose from matched rays (essential matrix), with the baseline scaled by the people's height."""
    try:
        view = estimate_relative_pose(
            rays_a, rays_b, threshold=angle, rng=rng, max_points=1000, min_iterations=200, max_iterations=3000
        )
    except EvidenceError:
        return None
    bodies = body_lengths(at_a, at_b, view.R_ba, view.t_ba)
    if bodies is None:
        return view.R_ba, view.t_ba
    return view.R_ba, view.t_ba * person_height_m / bodies


def _by_extents(
    found: tuple[Floats, Floats], at_a: PointObservations, at_b: PointObservations, focal: Floats, person_height_m: float
) -> tuple[Floats, Floats]:
    """Return the relative pose with its baseline scaled by the extents of joints, where no person is seen whole.

    Without this scale, each pair's baseline would have the length 1, and a third camera would start too far from its true pose
    for any descent. In a room with joints of heads, trunks, arms or legs only (terrace, seed 3, three cameras), one of the
    three was lost.
    """
    R_ba, t_ba = found
    point = triangulate_two_views(at_a.bearing, at_b.bearing, R_ba, t_ba)
    reach_a, reach_b = np.linalg.norm(point, axis=1), np.linalg.norm(point @ R_ba.T + t_ba, axis=1)
    # `sigma_px` of the evidence holds the person's extent in the image.
    length = 0.5 * (reach_a * at_a.sigma_px / focal[0] + reach_b * at_b.sigma_px / focal[1])
    front = np.isfinite(length) & (np.einsum("ni,ni->n", point, at_a.bearing) > 0)
    if not front.any():
        return found
    return R_ba, t_ba * SHOWN_SHARE * person_height_m / max(float(np.median(length[front])), 1e-9)


def body_lengths(at_a: Sightings, at_b: Sightings, R_ba: Floats, t_ba: Floats) -> float | None:
    """Return the length, in units of the baseline, of a whole standing body: the 65 % quantile over the matched people.

    None with too few people. People crouch, sit and bend, but they do not become longer: the standing length is near the upper
    end of the observed lengths, not at their mean.
    """
    if len(at_a) < MIN_MATCHES:
        return None
    top = triangulate_two_views(at_a.top, at_b.top, R_ba, t_ba)
    bottom = triangulate_two_views(at_a.bottom, at_b.bottom, R_ba, t_ba)
    share = np.maximum(at_a.top_fraction - at_a.bottom_fraction, 0.3)
    length = np.linalg.norm(top - bottom, axis=1) / share
    front = (np.einsum("ni,ni->n", top, at_a.top) > 0) & np.isfinite(length)
    if np.count_nonzero(front) < MIN_MATCHES:
        return None
    return float(np.quantile(length[front], 0.65))


def _judged(h: PairHypothesis, at_a: Sightings, at_b: Sightings, focal: Floats, person_height_m: float) -> PairHypothesis:
    """Return the hypothesis with its inliers, counted equally for all routes: people whose middles meet at a plausible size."""
    if len(at_a) == 0:
        return PairHypothesis(h.a, h.b, h.R_ba, h.t_ba, h.route, h.matches, h.matches)
    middle_a, middle_b = at_a.top + at_a.bottom, at_b.top + at_b.bottom
    middle_a /= np.linalg.norm(middle_a, axis=1, keepdims=True)
    middle_b /= np.linalg.norm(middle_b, axis=1, keepdims=True)
    point = triangulate_two_views(middle_a, middle_b, h.R_ba, h.t_ba)
    in_b = point @ h.R_ba.T + h.t_ba
    reach_a, reach_b = np.linalg.norm(point, axis=1), np.linalg.norm(in_b, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        miss_a = np.arccos(np.clip((point * middle_a).sum(axis=1) / reach_a, -1, 1))
        miss_b = np.arccos(np.clip((in_b * middle_b).sum(axis=1) / reach_b, -1, 1))
        size_a, size_b = at_a.extent_px / focal[h.a], at_b.extent_px / focal[h.b]
        met = (miss_a < 0.15 * size_a + 2 / focal[h.a]) & (miss_b < 0.15 * size_b + 2 / focal[h.b])
        tall = np.minimum(reach_a * size_a, reach_b * size_b) / person_height_m
        met &= (tall > 0.35) & (np.maximum(reach_a * size_a, reach_b * size_b) / person_height_m < 2.0)
    return PairHypothesis(h.a, h.b, h.R_ba, h.t_ba, h.route, int(np.count_nonzero(met)), len(at_a))
