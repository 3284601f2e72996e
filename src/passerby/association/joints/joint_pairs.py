"""The relative pose of two cameras, from the joints of people who move but do not walk.

Every joint is a correspondence if both tracklets show one person. So every two tracklets seen at one time are a hypothesis: the
essential matrix of their simultaneous joints. A good fit is no proof: two people who stand still in the same posture have the
same shape, and some relative pose explains them as one. *Time* is the proof: joints of one person fit at the same moment, but
not with a delay. Joints of two people fit equally well or badly at any delay. So each hypothesis is compared with the same
hypothesis delayed, for which the pose is estimated again. Its *gain* is the part of the misfit with the delay that vanishes
without it. Without movement there is no gain, and no registration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.association.joints.joint_tracks import GRID_S, JointTracks, mirrored_order
from passerby.common.arrays import Bools, Floats
from passerby.common.errors import EvidenceError
from passerby.geometry.rotations import angle_between, direction_angle
from passerby.geometry.two_view import epipolar_errors, essential_matrix, estimate_relative_pose, judge_pose

TOLERANCE = 0.04
"""Largest epipolar error of a joint that agrees, as a share of the body's size in the picture."""
MIN_SAMPLES, MIN_RAYS = 20, 40
"""Least numbers of common samples (a twentieth of a second each) and of common joints. Fewer samples show too little movement;
fewer joints show no shape."""
MOST_TRACKLETS = 10
"""Largest number of tracklets of each camera that are tried: those seen longest."""
SCREEN_SAMPLES, FULL_SAMPLES = 12, 60
"""Numbers of common samples, evenly spread, on which all hypotheses and the best hypotheses are tried."""
TRIED = 6
"""Number of best hypotheses that are tried in full."""
DELAYS = (0.25, -0.25, 0.45, -0.45)
"""Shares of the common time by which a hypothesis is delayed, to measure how well different people would fit."""
MIN_SCORE, MIN_GAIN = 0.65, 0.5
"""Least score and gain of a registration. In 144 simulated cases (still or moving, one or three in view, for 1.5 and 6 s) the
gain of two different people was at most 0.33, and that of one person who waves and bends 0.6 and more; in four real cameras
one person's was 0.59 to 0.85."""
MAX_RUNNER_UP = 0.6
"""Largest gain of a hypothesis that contradicts the best one, as a share of the best one's gain."""
ALSO_SCORE = 0.5
"""Score from which other tracklets are one person under a pose that was estimated without them."""
RIVAL_ANGLE = np.deg2rad(15.0)
"""Hypotheses whose rotations differ by more, or whose baselines differ by more than twice this, contradict each other."""


@dataclass(frozen=True, eq=False)
class SamePerson:
    """Two tracklets that show one person according to a relative pose."""

    i: int
    j: int
    """Tracklets of the first and of the second camera."""
    mirrored: bool
    """Whether left and right are exchanged in one of the two."""
    score: float
    """Share of the joints that agree, weighted by the smallness of their errors; 0 to 1."""
    seconds: float
    """Time for which both tracklets are seen together."""


@dataclass(frozen=True, eq=False)
class JointRegistration:
    """The relative pose on which the joints of two cameras agree: `x_b = R_ba x_a + t_ba`."""

    a: int
    b: int
    R_ba: Floats
    t_ba: Floats
    """(3,) unit length."""
    score: float
    gain: float
    """Part of the misfit of delayed joints that vanishes without the delay, 0 to 1."""
    runner_up: float
    """Gain of the best hypothesis that contradicts this one, as a share of this one's."""
    people: tuple[SamePerson, ...]
    joints: int
    """Number of simultaneous joints that agree."""
    lag_s: float
    """Assumed time of camera b's clock minus that of camera a's, seconds."""
    used: bool


@dataclass(frozen=True, eq=False)
class _Common:
    """The simultaneous joints of two tracklets: n samples of J joints."""

    rays_a: Floats
    rays_b: Floats
    """(n, J, 3) unit rays, each in its camera's frame, as in `rays_a`."""
    both: Bools
    """(n, J) whether both cameras found the joint."""
    size: float
    """Mean of the body's angular sizes in both cameras, radians."""
    seconds: float
    """Time for which both tracklets are seen together."""

    def __len__(self) -> int:
        return len(self.both)

    def delayed(self, shift: int, found: tuple[Bools, Bools]) -> _Common:
        """Return the correspondences with camera b's samples `shift` later than camera a's."""
        a, b = (slice(None, -shift), slice(shift, None)) if shift > 0 else (slice(-shift, None), slice(None, shift))
        return _Common(self.rays_a[a], self.rays_b[b], found[0][a] & found[1][b], self.size, self.seconds)


@dataclass(frozen=True, eq=False)
class _Fit:
    i: int
    j: int
    mirrored: bool
    R_ba: Floats
    t_ba: Floats
    score: float
    gain: float = 0.0


def register_joints(
    a: int, b: int, in_a: JointTracks, in_b: JointTracks, rng: np.random.Generator, lag_steps: int = 0
) -> JointRegistration | None:
    """Register two cameras by the joints of their people.

    Args:
        a: number of the first camera.
        b: number of the second camera.
        in_a: joints of the first camera.
        in_b: joints of the second camera.
        rng: drives RANSAC.
        lag_steps: time of the second camera's clock minus that of the first, in steps of the grid.

    Returns:
        The best registration, not `used` where it does not stand out; None where no two tracklets are seen together.
    """
    if in_a.names != in_b.names:
        return None
    fits = _screened(in_a, in_b, rng, lag_steps)
    full = [fit for fit in (_tried(in_a, in_b, fit, rng, lag_steps) for fit in fits[:TRIED]) if fit is not None]
    if not full:
        return None
    best = max(full, key=lambda fit: (fit.gain if fit.score >= MIN_SCORE else fit.gain - 1.0, fit.score))
    rival = max((fit.gain for fit in full if _contradict(fit, best)), default=0.0)
    sure = best.score >= MIN_SCORE and best.gain >= MIN_GAIN
    runner_up = max(rival, 0.0) / best.gain if best.gain > 0 else 1.0
    people = _people(in_a, in_b, best, lag_steps) if sure else []
    pooled = _pooled(in_a, in_b, best, people, rng, lag_steps) if sure and len(people) > 1 else best
    joints = sum(round(one.score * one.seconds / GRID_S * len(in_a.names)) for one in people)
    return JointRegistration(
        a, b, pooled.R_ba, pooled.t_ba, best.score, best.gain, min(runner_up, 1.0), tuple(people), joints,
        lag_steps * GRID_S, sure and runner_up < MAX_RUNNER_UP,
    )  # fmt: skip


def _contradict(fit: _Fit, other: _Fit) -> bool:
    """Check whether two hypotheses contradict each other."""
    return bool(angle_between(fit.R_ba, other.R_ba) > RIVAL_ANGLE or direction_angle(fit.t_ba, other.t_ba) > 2 * RIVAL_ANGLE)


def _common(
    in_a: JointTracks, in_b: JointTracks, i: int, j: int, swap: bool, most: int, lag_steps: int
) -> tuple[_Common, tuple[Bools, Bools]] | None:
    """Return simultaneous joints of two tracklets, at most `most` samples, and masks of those that each camera found."""
    rows_a, rows_b = in_a.rows(i), in_b.rows(j)
    _, at_a, at_b = np.intersect1d(in_a.step[rows_a], in_b.step[rows_b] - lag_steps, return_indices=True)
    if len(at_a) < MIN_SAMPLES:
        return None
    seconds = len(at_a) * GRID_S
    pick = np.unique(np.linspace(0, len(at_a) - 1, min(most, len(at_a))).round().astype(np.int64))
    at_a, at_b = at_a[pick] + rows_a.start, at_b[pick] + rows_b.start
    rays_b, found_b = in_b.rays[at_b], in_b.found[at_b]
    if swap:
        order = mirrored_order(in_b.names)
        rays_b, found_b = rays_b[:, order], found_b[:, order]
    size = 0.5 * float(np.median(in_a.size[at_a]) + np.median(in_b.size[at_b]))
    return _Common(in_a.rays[at_a], rays_b, in_a.found[at_a] & found_b, size, seconds), (in_a.found[at_a], found_b)


def _fitted(common: _Common, rng: np.random.Generator, *, rounds: int) -> tuple[Floats, Floats, float] | None:
    """Estimate the relative pose from simultaneous joints; return it and its score, the share of them that agree."""
    rays_a, rays_b = common.rays_a[common.both], common.rays_b[common.both]
    if len(rays_a) < MIN_RAYS:
        return None
    try:
        view = estimate_relative_pose(
            rays_a, rays_b, threshold=TOLERANCE * common.size, rng=rng, min_iterations=rounds // 5, max_iterations=rounds
        )
    except EvidenceError:
        return None
    return view.R_ba, view.t_ba, view.score / len(rays_a)


def _longest(tracks: JointTracks) -> list[int]:
    """Return the tracklets that are seen longest."""
    tracklet, count = np.unique(tracks.tracklet, return_counts=True)
    order = np.argsort(-count, kind="stable")[:MOST_TRACKLETS]
    return [int(tracklet[k]) for k in order if count[k] >= MIN_SAMPLES]


def _screened(in_a: JointTracks, in_b: JointTracks, rng: np.random.Generator, lag_steps: int) -> list[_Fit]:
    """Fit all hypotheses on few samples, and return them with the best score first."""
    fits = []
    for i in _longest(in_a):
        for j in _longest(in_b):
            for swap in (False, True):
                found = _common(in_a, in_b, i, j, swap, SCREEN_SAMPLES, lag_steps)
                fit = None if found is None else _fitted(found[0], rng, rounds=300)
                if fit is not None:
                    fits.append(_Fit(i, j, swap, *fit))
    return sorted(fits, key=lambda fit: -fit.score)


def _tried(in_a: JointTracks, in_b: JointTracks, fit: _Fit, rng: np.random.Generator, lag_steps: int) -> _Fit | None:
    """Fit a hypothesis on more samples, and compare it with its delayed versions; return None where no pose is found."""
    found = _common(in_a, in_b, fit.i, fit.j, fit.mirrored, FULL_SAMPLES, lag_steps)
    assert found is not None
    common, each = found
    best = _fitted(common, rng, rounds=1000)
    if best is None:
        return None
    delayed = []
    for share in DELAYS:
        shift = round(share * len(common)) or 1
        other = _fitted(common.delayed(shift, each), rng, rounds=1000)
        delayed.append(0.0 if other is None else other[2])
    misfit = 1.0 - max(delayed)
    gain = 1.0 - (1.0 - best[2]) / misfit if misfit > 0 else 0.0
    return _Fit(fit.i, fit.j, fit.mirrored, *best, gain)


def _people(in_a: JointTracks, in_b: JointTracks, fit: _Fit, lag_steps: int) -> list[SamePerson]:
    """Find pairs of tracklets that are one person under a pose, the most significant first."""
    found = []
    for i, j in _together(in_a, in_b, lag_steps):
        own = (i, j) == (fit.i, fit.j)
        best: SamePerson | None = None
        for swap in (fit.mirrored,) if own else (False, True):
            both = _common(in_a, in_b, i, j, swap, SCREEN_SAMPLES, lag_steps)
            score = 0.0 if both is None else _score(fit, both[0])
            if both is not None and (score >= ALSO_SCORE or own) and (best is None or score > best.score):
                best = SamePerson(i, j, swap, score, both[0].seconds)
        if best is not None:
            found.append(best)
    return sorted(found, key=lambda one: -one.score * one.seconds)


def _together(in_a: JointTracks, in_b: JointTracks, lag_steps: int) -> list[tuple[int, int]]:
    """Return pairs of tracklets whose times overlap by at least `MIN_SAMPLES` samples."""
    spans = []
    for tracks, lag in ((in_a, 0), (in_b, lag_steps)):
        tracklet, first, count = np.unique(tracks.tracklet, return_index=True, return_counts=True)
        spans.append((tracklet, tracks.step[first] - lag, tracks.step[first + count - 1] - lag))
    (of_a, start_a, end_a), (of_b, start_b, end_b) = spans
    overlap = np.minimum(end_a[:, None], end_b) - np.maximum(start_a[:, None], start_b) + 1
    return [(int(of_a[i]), int(of_b[j])) for i, j in np.argwhere(overlap >= MIN_SAMPLES)]


def _score(fit: _Fit, common: _Common) -> float:
    """Return the score of simultaneous joints under a known pose."""
    rays_a, rays_b = common.rays_a[common.both], common.rays_b[common.both]
    if not len(rays_a):
        return 0.0
    # Most pairs of different people are rejected by the errors alone, at low cost.
    error = epipolar_errors(essential_matrix(fit.R_ba, fit.t_ba), rays_a, rays_b) / (TOLERANCE * common.size)
    if np.maximum(1.0 - error**2, 0.0).mean() < ALSO_SCORE:
        return 0.0
    return judge_pose(fit.R_ba, fit.t_ba, rays_a, rays_b, TOLERANCE * common.size).score / len(rays_a)


def _pooled(
    in_a: JointTracks, in_b: JointTracks, best: _Fit, people: Sequence[SamePerson], rng: np.random.Generator, lag_steps: int
) -> _Fit:
    """Estimate the pose from the joints of all people; return the best pair's pose where both contradict each other."""
    parts = [_common(in_a, in_b, one.i, one.j, one.mirrored, FULL_SAMPLES, lag_steps) for one in people]
    commons = [part[0] for part in parts if part is not None]
    joined = _Common(
        np.concatenate([part.rays_a for part in commons]), np.concatenate([part.rays_b for part in commons]),
        np.concatenate([part.both for part in commons]), float(np.mean([part.size for part in commons])), 0.0,
    )  # fmt: skip
    fit = _fitted(joined, rng, rounds=1000)
    if fit is None:
        return best
    pooled = _Fit(best.i, best.j, best.mirrored, *fit)
    return best if _contradict(pooled, best) else pooled
