"""Test of the cameras for motion in one window of time, relative to the rig and to all earlier footage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, fdtri

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.people.held_cameras import GroundPlane, fit_people
from passerby.people.resection import FEWEST_CLUSTERS, centre_first, cluster_robust_covariance, weak_prior
from passerby.people.scores import Scores, cluster_scores
from passerby.people.sightings import Sightings, poses_of

MODEL_M, MODEL_DEG = 0.01, 0.05
"""One sigma in each direction by which people seem to move a camera at rest: added to the rig's own sigmas."""
UNKNOWN_M, UNKNOWN_DEG = 0.05, 0.3
"""One sigma in each direction of a rig that states no sigmas."""
CLEAR_DEG, CLEAR_M = 3.0, 0.5
"""If only larger moves in a usual direction would be noticed, there is no result for a camera."""
POWER = 1.645
"""Distance above the threshold, in sigmas, of a move that is noticed in 95 % of the cases."""
LOUD, LESS = 0.1, 2.0
"""Share of a window's stretches, without which the score may be lower than the threshold by `LESS` at most. In 24 quiet hours
the largest score of all but one was 3.7; it was 7.1 in one where a person was half hidden for some seconds."""
TAILS = 3.0
"""Largest number of degrees of freedom of the statistic for each stretch in the window."""
POOLED = 150.0
"""Largest weight of earlier windows, as a number of clusters: the scatter changes with the people."""
GRID_S = 1.0
INFLATION = 6.0
"""Divisor of gains in likelihood, since the scores of neighbouring seconds are correlated."""
WORSE = 4.0
"""A time may be the right one if twice its loss in log likelihood is at most this: about 95 % of the cases."""


@dataclass(frozen=True, eq=False)
class MotionTest:
    """Test of one camera in one window."""

    camera: int
    score: float
    """Minus the decimal logarithm of the probability of such a large statistic without a move; 0 if unknown."""
    clusters: int
    shift: Floats
    """(6,) the move that fits best, to first order."""
    smallest_m: tuple[float, float]
    """Shift that is noticed in 95 % of the cases, metres, along the middle one of three directions at right angles and along
    the worst one; infinite if unknown."""
    smallest_deg: tuple[float, float]
    """Turn that is noticed in 95 % of the cases, about the middle one of three axes and about the worst one."""
    scatter: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) sum of the clusters' whitened scatter; `clusters` times the unit matrix if their errors are as stated."""

    @property
    def is_clear(self) -> bool:
        """Whether the test is sensitive enough for a result (`CLEAR_M`, `CLEAR_DEG`)."""
        return self.smallest_m[0] <= CLEAR_M and self.smallest_deg[0] <= CLEAR_DEG


@dataclass(frozen=True, eq=False)
class Baseline:
    """Knowledge of C cameras before a window: shifts of their poses from those of the rig, and the usual scatter."""

    information: Floats
    """(6 C, 6 C) information on the shifts."""
    gradient: Floats
    """(6 C,) information times the shifts."""
    scatter: Floats
    """(C, 6, 6) sums of whitened scatter."""
    clusters: Floats
    """(C,) number of clusters in these sums."""

    @classmethod
    def of_rig(cls, rig: Rig, names: Sequence[str], share: float = 1.0) -> Baseline:
        """Return the baseline before any footage: a share of the rig's own sigmas, and `model_covariance`."""
        n = len(names)
        information = np.zeros((6 * n, 6 * n))
        for index, name in enumerate(names):
            own = slice(6 * index, 6 * index + 6)
            information[own, own] = np.linalg.inv(rig_covariance_of(rig, name, share))
        return cls(information, np.zeros(6 * n), np.zeros((n, 6, 6)), np.zeros(n))

    def estimate(self) -> tuple[Floats, Floats]:
        """Return the shifts (6 C,) and their covariance (6 C, 6 C)."""
        covariance: Floats = np.asarray(np.linalg.inv(self.information), dtype=np.float64)
        return covariance @ self.gradient, covariance

    def with_quiet(self, scores: Scores) -> Baseline:
        """Add the information of clusters of quiet time."""
        if not len(scores):
            return self
        inflation = self._inflation()
        return Baseline(
            self.information + scores.information.sum(axis=0) / inflation,
            self.gradient + scores.gradient.sum(axis=0) / inflation, self.scatter, self.clusters,
        )  # fmt: skip

    def with_estimate(self, shift: Floats, information: Floats) -> Baseline:
        """Add an estimate of the cameras in quiet time: shifts (6 C,) and their information (6 C, 6 C)."""
        return replace(self, information=self.information + information, gradient=self.gradient + information @ shift)

    def _inflation(self) -> float:
        """Return the ratio of the scores' variance to the stated one, over all directions and cameras; with a usual prior."""
        total = float(np.trace(self.scatter, axis1=1, axis2=2).sum()) + 6 * 30 * 4.0
        return max(1.0, total / (6 * (float(self.clusters.sum()) + 30)))

    def with_scatter(self, tests: Sequence[MotionTest]) -> Baseline:
        """Add the scatter of a quiet window."""
        scatter, clusters = self.scatter.copy(), self.clusters.copy()
        for test in tests:
            scatter[test.camera] += test.scatter
            clusters[test.camera] += test.clusters
        shrink = np.minimum(1.0, POOLED / np.maximum(clusters, 1.0))
        return Baseline(self.information, self.gradient, scatter * shrink[:, None, None], clusters * shrink)

    def replaced(self, camera: int, covariance: Floats) -> Baseline:
        """Replace the knowledge of a camera's old pose by a new pose with a covariance (6, 6)."""
        own = np.arange(6 * camera, 6 * camera + 6)
        rest = np.setdiff1d(np.arange(len(self.gradient)), own)
        information, gradient = np.zeros_like(self.information), np.zeros_like(self.gradient)
        if len(rest):
            cross = np.linalg.solve(self.information[np.ix_(own, own)], self.information[np.ix_(own, rest)])
            information[np.ix_(rest, rest)] = self.information[np.ix_(rest, rest)] - self.information[np.ix_(rest, own)] @ cross
            gradient[rest] = self.gradient[rest] - cross.T @ self.gradient[own]
        information[np.ix_(own, own)] = np.linalg.inv(covariance + model_covariance())
        return Baseline(information, gradient, self.scatter, self.clusters)


def rig_covariance_of(rig: Rig, name: str, share: float = 1.0) -> Floats:
    """Return the covariance (6, 6) of a rig's camera: its own sigmas, or a share of them, and `model_covariance`."""
    sigma = rig[name].sigma
    if sigma is None or not np.isfinite(sigma.position_m + sigma.orientation_deg):
        known = np.diag(np.repeat([UNKNOWN_M**2, np.radians(UNKNOWN_DEG) ** 2], 3))
    elif (own := sigma.with_lens_known) is None:
        known = np.diag(np.repeat([sigma.position_m**2 / 3, np.radians(sigma.orientation_deg) ** 2 / 3], 3))
    else:
        known = np.asarray(own)
    return np.asarray(share**2 * known + model_covariance())


def model_covariance() -> Floats:
    """Return the covariance (6, 6) of the shift by which people seem to move a camera at rest."""
    return np.diag(np.repeat([MODEL_M**2, np.radians(MODEL_DEG) ** 2], 3))


def run_motion_tests(window: Scores, baseline: Baseline, freed: Sequence[int], threshold: float) -> list[MotionTest]:
    """Test each camera that is not freed.

    The statistic is the shift that the people give the camera, with the others fixed. The uncertainty of the others is added
    to the noise.

    Args:
        window: clusters of the window.
        baseline: knowledge before the window.
        freed: cameras that have moved in any case: their poses are fitted, so that they give no evidence on the others.
        threshold: threshold of the score, on which the smallest noticed move depends.
    """
    shift, covariance = baseline.estimate()
    information = window.information.sum(axis=0)
    free = np.concatenate([np.arange(6 * c, 6 * c + 6) for c in freed]).astype(np.int64) if freed else np.zeros(0, np.int64)
    gradient = window.at(shift)
    cross = np.zeros((0, information.shape[0]))
    if len(free):
        normal = information[np.ix_(free, free)] + np.kron(np.eye(len(freed)), centre_first(weak_prior()))
        cross = np.linalg.solve(normal, information[free])
        fitted = np.linalg.solve(normal, gradient[:, free].sum(axis=0))
        gradient = gradient - window.information[:, :, free] @ fitted
    found = []
    for camera in range(window.counts.shape[1]):
        if camera not in freed:
            found.append(_test(window, baseline, camera, information, gradient, covariance, free, cross, threshold))
    return found


def _test(
    window: Scores, baseline: Baseline, camera: int, information: Floats, gradient: Floats, covariance: Floats,
    free: NDArray[np.int64], cross: Floats, threshold: float,
) -> MotionTest:  # fmt: skip
    """Test one camera."""
    own = np.arange(6 * camera, 6 * camera + 6)
    rows = np.flatnonzero(_find_shared_clusters(window, camera, free))
    nothing = MotionTest(camera, 0.0, len(rows), np.zeros(6), (np.inf, np.inf), (np.inf, np.inf))
    if len(rows) < FEWEST_CLUSTERS:
        return nothing
    score = gradient[np.ix_(rows, own)] - gradient[np.ix_(rows, free)] @ cross[:, own]
    of_cluster = window.information[np.ix_(rows, own, own)] - np.einsum(
        "fi,kfj->kij", cross[:, own], window.information[np.ix_(rows, free, own)]
    )
    sensitivity = information[own] - cross[:, own].T @ information[free]
    normal = sensitivity[:, own] + centre_first(weak_prior())
    pull = score.sum(axis=0)
    shift = np.linalg.solve(normal, pull)
    residual = score - of_cluster @ shift
    noise, freedom, scatter = cluster_robust_covariance(
        residual, normal, (baseline.scatter[camera], float(baseline.clusters[camera]))
    )
    # A sum of few stretches has longer tails than a normal variable, also if the scatter is well known.
    freedom = min(freedom, TAILS * len(rows))
    noise = noise + sensitivity @ covariance @ sensitivity.T
    whole = score_of(_length(pull, noise), freedom)
    # A person who is half hidden for some seconds must not decide: the few stretches with most weight are left out at once.
    loudest = np.argsort(score @ np.linalg.solve(noise, pull))[-max(1, round(LOUD * len(rows))) :]
    rest = score_of(_length(pull - score[loudest].sum(axis=0), noise), freedom)
    limit = limit_of(threshold, freedom)
    power = normal @ np.linalg.solve(noise, normal)
    needed = (np.sqrt(limit) + POWER) ** 2
    metres, radians = (np.sqrt(needed / np.linalg.eigvalsh(power[part, part])) for part in (slice(0, 3), slice(3, 6)))
    worst_m, usual_m = metres[:2].tolist()
    worst_deg, usual_deg = np.degrees(radians[:2]).tolist()
    score_told = min(whole, rest + LESS)
    return MotionTest(camera, score_told, len(rows), shift, (usual_m, worst_m), (usual_deg, worst_deg), scatter)


def _find_shared_clusters(window: Scores, camera: int, free: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether each cluster (K,) has sightings by a camera and by another one that is not free."""
    others = np.delete(window.counts, [camera, *np.unique(free // 6).tolist()], axis=1)
    return np.asarray((window.counts[:, camera] > 0) & (others.sum(axis=1) > 0))


def _length(pull: Floats, noise: Floats) -> float:
    """Return the squared length of a pull (6,) relative to its covariance (6, 6)."""
    return float(pull @ np.linalg.solve(noise, pull))


def score_of(statistic: float, freedom: float, size: int = 6) -> float:
    """Return the score of Hotelling's T squared in `size` dimensions, whose covariance has `freedom` degrees of freedom."""
    left = max(freedom - size + 1.0, 1.0)
    return float(-np.log10(max(fdtrc(size, left, statistic * left / (size * freedom)), 1e-300)))


def limit_of(threshold: float, freedom: float, size: int = 6) -> float:
    """Return the statistic at which the score reaches the threshold."""
    left = max(freedom - size + 1.0, 1.0)
    return float(fdtri(size, left, 1 - 10.0**-threshold) * size * freedom / left)


@dataclass(frozen=True)
class ChangePoint:
    """A time, and the limits between which it lies."""

    seconds: float
    from_s: float
    until_s: float


def estimate_change_point(
    rig: Rig, seen: Sightings, camera: str, baseline: Baseline, ground: GroundPlane
) -> ChangePoint | None:
    """Estimate the time at which a camera moved that moved once in the footage; None if no person was seen by two cameras.

    For each time, the likelihood ratio of a new pose from then on to the old pose is computed. The other cameras are fixed as
    the baseline has them.
    """
    index = seen.names.index(camera)
    own = slice(6 * index, 6 * index + 6)
    rotation, centre = poses_of(rig, seen.names)
    if not (np.bincount(seen.block, minlength=seen.n_blocks) > 1).any():
        return None
    scores = cluster_scores(seen, fit_people(seen, rotation, centre, ground=ground), GRID_S)
    pull, information = scores.at(baseline.estimate()[0])[:, own], scores.information[:, own, own]
    times, first = np.unique(scores.start_s, return_index=True)
    # Sums from each time to the end.
    late_pull = np.cumsum(np.add.reduceat(pull, first, axis=0)[::-1], axis=0)[::-1]
    late = np.cumsum(np.add.reduceat(information, first, axis=0)[::-1], axis=0)[::-1] + centre_first(weak_prior())
    gain: Floats = (late_pull * np.linalg.solve(late, late_pull[:, :, None])[:, :, 0]).sum(axis=1) / INFLATION
    best = int(np.argmax(gain))
    likely = np.flatnonzero(gain >= gain[best] - WORSE)
    # The lower limit is one instant earlier: the camera may have moved after it.
    return ChangePoint(
        float(times[best]), float(times[max(likely[0] - 1, 0)]), float(times[min(likely[-1] + 1, len(times) - 1)])
    )
