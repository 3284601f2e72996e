"""What one window of time says: has a camera moved, measured against the rig and against all that was seen before."""

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
"""One sigma in each direction by which people seem to move a camera that stands still: added to the rig's own sigmas."""
UNKNOWN_M, UNKNOWN_DEG = 0.05, 0.3
"""The same of a rig that states no sigmas."""
CLEAR_DEG, CLEAR_M = 3.0, 0.5
"""Where a move in a usual direction must be larger than either to be seen, nothing is said of a camera."""
POWER = 1.645
"""Of a move that is seen in 95 % of the cases: so many sigmas above the threshold."""
LOUD, LESS = 0.1, 2.0
"""Of a window's stretches, without which the score must still come within so much of the threshold. In 24 quiet hours the
largest score of all but one was 3.7; it was 7.1 in one where a person was half hidden for some seconds."""
TAILS = 3.0
"""Degrees of freedom of the statistic for each stretch in the window, at most."""
POOLED = 150.0
"""Clusters of earlier windows that count, at most: scatter changes with the people."""
GRID_S = 1.0
INFLATION = 6.0
"""Scores of neighbouring seconds are alike: a gain in likelihood counts for so much less than it says."""
WORSE = 4.0
"""Twice the loss in likelihood up to which a moment may be the right one: about 95 % of the cases."""


@dataclass(frozen=True, eq=False)
class MotionTest:
    """One camera in one window."""

    camera: int
    score: float
    """Minus the decimal logarithm of how likely so much is where nothing moved; 0 if unknown."""
    clusters: int
    shift: Floats
    """(6,) the move that fits best, to first order."""
    smallest_m: tuple[float, float]
    """The shift that is seen in 95 % of the cases, in the middle one of three directions at right angles and in the worst one;
    infinite if unknown."""
    smallest_deg: tuple[float, float]
    """The turn that is, about the middle one of three axes and about the worst one."""
    scatter: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) how the clusters scattered, summed; unit matrix times `clusters` where they err as stated."""

    @property
    def is_clear(self) -> bool:
        """Whether something can be said of the camera."""
        return self.smallest_m[0] <= CLEAR_M and self.smallest_deg[0] <= CLEAR_DEG


@dataclass(frozen=True, eq=False)
class Baseline:
    """What is known of C cameras before a window: where they seem to be, relative to the rig's poses, and the usual scatter."""

    information: Floats
    """(6 C, 6 C)"""
    gradient: Floats
    """(6 C,)"""
    scatter: Floats
    """(C, 6, 6) sums of whitened scatter,"""
    clusters: Floats
    """(C,) and of how many clusters."""

    @classmethod
    def of_rig(cls, rig: Rig, names: Sequence[str], share: float = 1.0) -> Baseline:
        """Nothing seen so far: that share of the rig's own sigmas, and what people add."""
        n = len(names)
        information = np.zeros((6 * n, 6 * n))
        for index, name in enumerate(names):
            own = slice(6 * index, 6 * index + 6)
            information[own, own] = np.linalg.inv(rig_covariance_of(rig, name, share))
        return cls(information, np.zeros(6 * n), np.zeros((n, 6, 6)), np.zeros(n))

    def estimate(self) -> tuple[Floats, Floats]:
        """(6 C,) shifts and (6 C, 6 C) covariance."""
        covariance: Floats = np.asarray(np.linalg.inv(self.information), dtype=np.float64)
        return covariance @ self.gradient, covariance

    def with_quiet(self, scores: Scores) -> Baseline:
        """With clusters of quiet time."""
        if not len(scores):
            return self
        inflation = self._inflation()
        return Baseline(
            self.information + scores.information.sum(axis=0) / inflation,
            self.gradient + scores.gradient.sum(axis=0) / inflation, self.scatter, self.clusters,
        )  # fmt: skip

    def with_estimate(self, shift: Floats, information: Floats) -> Baseline:
        """With where the cameras seemed to be in quiet time: (6 C,) shifts and their information (6 C, 6 C)."""
        return replace(self, information=self.information + information, gradient=self.gradient + information @ shift)

    def _inflation(self) -> float:
        """How much more the scores scatter than stated, over all directions and cameras; to begin with, as usual."""
        total = float(np.trace(self.scatter, axis1=1, axis2=2).sum()) + 6 * 30 * 4.0
        return max(1.0, total / (6 * (float(self.clusters.sum()) + 30)))

    def with_scatter(self, tests: Sequence[MotionTest]) -> Baseline:
        """With the scatter of a quiet window."""
        scatter, clusters = self.scatter.copy(), self.clusters.copy()
        for test in tests:
            scatter[test.camera] += test.scatter
            clusters[test.camera] += test.clusters
        shrink = np.minimum(1.0, POOLED / np.maximum(clusters, 1.0))
        return Baseline(self.information, self.gradient, scatter * shrink[:, None, None], clusters * shrink)

    def replaced(self, camera: int, covariance: Floats) -> Baseline:
        """After a camera was given a new pose with a covariance (6, 6): what was known of its old one is forgotten."""
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
    """(6, 6) covariance of a rig's camera: its own sigmas, or a share of them, and what people add."""
    sigma = rig[name].sigma
    if sigma is None or not np.isfinite(sigma.position_m + sigma.orientation_deg):
        known = np.diag(np.repeat([UNKNOWN_M**2, np.radians(UNKNOWN_DEG) ** 2], 3))
    elif (own := sigma.with_lens_known) is None:
        known = np.diag(np.repeat([sigma.position_m**2 / 3, np.radians(sigma.orientation_deg) ** 2 / 3], 3))
    else:
        known = np.asarray(own)
    return np.asarray(share**2 * known + model_covariance())


def model_covariance() -> Floats:
    """(6, 6) covariance of what people seem to move a camera by."""
    return np.diag(np.repeat([MODEL_M**2, np.radians(MODEL_DEG) ** 2], 3))


def run_motion_tests(window: Scores, baseline: Baseline, freed: Sequence[int], threshold: float) -> list[MotionTest]:
    """Each camera's test that is not freed.

    A camera is tested by how far the people ask it to go, given the others; what is not known of the others counts as noise.

    Args:
        window: clusters.
        baseline: what was known before.
        freed: cameras that have moved anyhow: wherever they fit best, they say nothing of the others.
        threshold: of the score; what would be seen depends on it.
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
    """One camera's."""
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
    # However well the scatter is known, a sum of few stretches has longer tails than a normal variable.
    freedom = min(freedom, TAILS * len(rows))
    noise = noise + sensitivity @ covariance @ sensitivity.T
    whole = score_of(_length(pull, noise), freedom)
    # A person half hidden for a while must not decide for all: the few stretches with most weight are left out in turn.
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
    """(K,) the clusters in which a camera and another one that is not free have a part."""
    others = np.delete(window.counts, [camera, *np.unique(free // 6).tolist()], axis=1)
    return np.asarray((window.counts[:, camera] > 0) & (others.sum(axis=1) > 0))


def _length(pull: Floats, noise: Floats) -> float:
    """Squared length of a pull (6,) in its own covariance."""
    return float(pull @ np.linalg.solve(noise, pull))


def score_of(statistic: float, freedom: float, size: int = 6) -> float:
    """Of Hotelling's T squared in so many dimensions, the covariance of which has so many degrees of freedom."""
    left = max(freedom - size + 1.0, 1.0)
    return float(-np.log10(max(fdtrc(size, left, statistic * left / (size * freedom)), 1e-300)))


def limit_of(threshold: float, freedom: float, size: int = 6) -> float:
    """The statistic at which the score reaches the threshold."""
    left = max(freedom - size + 1.0, 1.0)
    return float(fdtri(size, left, 1 - 10.0**-threshold) * size * freedom / left)


@dataclass(frozen=True)
class ChangePoint:
    """A time, and what it lies between."""

    seconds: float
    from_s: float
    until_s: float


def estimate_change_point(
    rig: Rig, seen: Sightings, camera: str, baseline: Baseline, ground: GroundPlane
) -> ChangePoint | None:
    """When a camera moved that moved once in the footage; None if no person was seen by two cameras.

    Of each moment: how much better one new pose from then on explains what was seen than the old one (a likelihood ratio, the
    other cameras held where the baseline has them).
    """
    index = seen.names.index(camera)
    own = slice(6 * index, 6 * index + 6)
    rotation, centre = poses_of(rig, seen.names)
    if not (np.bincount(seen.block, minlength=seen.n_blocks) > 1).any():
        return None
    scores = cluster_scores(seen, fit_people(seen, rotation, centre, ground=ground), GRID_S)
    pull, information = scores.at(baseline.estimate()[0])[:, own], scores.information[:, own, own]
    times, first = np.unique(scores.start_s, return_index=True)
    # From each time to the end.
    late_pull = np.cumsum(np.add.reduceat(pull, first, axis=0)[::-1], axis=0)[::-1]
    late = np.cumsum(np.add.reduceat(information, first, axis=0)[::-1], axis=0)[::-1] + centre_first(weak_prior())
    gain: Floats = (late_pull * np.linalg.solve(late, late_pull[:, :, None])[:, :, 0]).sum(axis=1) / INFLATION
    best = int(np.argmax(gain))
    likely = np.flatnonzero(gain >= gain[best] - WORSE)
    # The camera was still where it had been at the instant before.
    return ChangePoint(
        float(times[best]), float(times[max(likely[0] - 1, 0)]), float(times[min(likely[-1] + 1, len(times) - 1)])
    )
