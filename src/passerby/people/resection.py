"""Pose of one camera from people that other cameras see too, with a covariance that allows for lasting errors.

It is used where one camera is measured again while the other cameras are held: has this camera moved, and where is it now?
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, PoseSigma, Rig
from passerby.core.observations import Observations
from passerby.geometry.groups import compute_cut_cauchy_weights
from passerby.geometry.rotations import exp_rotation, log_rotation
from passerby.people.held_cameras import FittedPeople, GroundPlane, fit_people
from passerby.people.scores import Scores, cluster_scores
from passerby.people.sightings import Sightings, gather_sightings, poses_of

CENTRE_SD_M, TURN_SD = 2.0, np.deg2rad(30.0)
"""Standard deviations, metres and radians, of the weak prior on a camera's move; larger moves are rare. The prior holds a pose
that people do not determine."""
STEPS, STILL = 8, 1e-5
"""Largest number of steps; the iteration stops at steps below this many metres and radians."""
LOSS, BEYOND = 3.0, 25.0
"""Scale of the Cauchy loss in sigmas, and the squared residual in sigmas beyond which a sighting shows another person."""
WIDENING, ROUNDS = 64.0, 16
"""First factor on that scale where bodies are solved again for each pose, and the largest number of steps then. In a camera
that was turned by ten degrees people are some 80 sigmas off."""
MOST_TURN = 0.5
"""Largest turn of a camera in one step, radians, where bodies are solved again for each pose."""
FEWEST_CLUSTERS = 6
"""Number of clusters (stretches of people) below which their scatter does not determine the sigma."""
USUAL_INFLATION = 6.0
"""Ratio of the scores' variance to their formal variance, assumed where there are too few scores to measure it: 4 to 7 in the
worst direction of simulated and real footage."""
USUAL_WORTH = 6.0
"""Number of clusters that `USUAL_INFLATION` counts for."""
LASTING = 1.33
"""Factor on the variance for errors that the scatter of 6 s stretches does not show: a bag on one side or a gait lasts as long
as the person is seen."""


class PoseEquations(Protocol):
    """Equations of a pose from sightings or their clusters. Unknowns: rotation vector in the camera's frame, then centre."""

    def summed(self) -> tuple[Floats, Floats]:
        """Return the gradient (6,) of half the robust cost, uphill, and the information (6, 6): how fast the gradient grows."""
        ...


Equations = TypeVar("Equations", bound=PoseEquations)


@dataclass(frozen=True, eq=False)
class PoseFit(Generic[Equations]):
    """Pose at which the robust cost is least."""

    pose: Pose
    normal: Floats
    """(6, 6) information, including that of `weak_prior`."""
    equations: Equations
    """Equations at the pose."""


def fit_pose(
    start: Pose, equations_at: Callable[[Pose, float], Equations], *, widening: float = 1.0, steps: int = STEPS,
    most_turn: float = np.inf,
) -> PoseFit[Equations]:  # fmt: skip
    """Fit a pose near `start` to sightings, by Gauss-Newton with a robust loss whose scale decreases from step to step.

    Args:
        start: where the search begins; a weak prior holds the pose to it.
        equations_at: returns the equations of a pose, for a factor on the usual scale of the loss.
        widening: first factor on the usual scale of the loss; it is halved at each step, down to 1.
        steps: largest number of steps.
        most_turn: largest turn in one step, radians.
    """
    prior, pose = weak_prior(), start
    for step in range(steps + 1):
        scale = max(1.0, widening / 2.0**step)
        equations = equations_at(pose, scale)
        gradient, information = equations.summed()
        found = PoseFit(pose, prior + information, equations)
        if step == steps:
            break
        away = np.concatenate([log_rotation(pose.R_cw @ start.R_cw.T), pose.centre - start.centre])
        delta = -np.linalg.solve(found.normal, gradient + prior @ away)
        if scale == 1.0 and np.abs(delta).max() < STILL:
            break
        if (turn := float(np.linalg.norm(delta[:3]))) > most_turn:
            delta = delta * (most_turn / turn)
        pose = Pose.from_centre(exp_rotation(delta[:3]) @ pose.R_cw, pose.centre + delta[3:])
    return found


def weak_prior() -> Floats:
    """Return the information (6, 6) of the prior on an unknown move; its first and last three rows differ only in the unit."""
    return np.diag(np.repeat([1 / TURN_SD**2, 1 / CENTRE_SD_M**2], 3))


@dataclass(frozen=True, eq=False)
class Resection:
    """Pose of a camera from one stretch of time."""

    camera: str
    pose: Pose
    sigma: PoseSigma
    """Standard deviations of the new pose, relative to the other cameras, which are held."""
    shift: Floats
    """(6,) change from the rig's pose to the new one: centre (metres, world) and rotation vector (radians, camera frame)."""
    covariance: Floats
    """(6, 6) of `shift`."""
    statistic: float
    """Squared Mahalanobis length of `shift` by `covariance`; 6 is expected where the camera did not move."""
    clusters: int
    """Number of clusters (stretches of people) that it uses."""
    sightings: int
    cost: float
    """Half the sum of the weighted squared residuals after the fit, bodies eliminated."""

    @property
    def metres(self) -> float:
        """Distance by which the camera centre moved, metres."""
        return float(np.linalg.norm(self.shift[:3]))

    @property
    def degrees(self) -> float:
        """Angle by which the camera turned, degrees."""
        return float(np.degrees(np.linalg.norm(self.shift[3:])))


def resect(
    rig: Rig, observations: Observations, camera: str, *, from_s: float = -np.inf, until_s: float = np.inf,
    without: tuple[str, ...] = (), ground: GroundPlane | None = None,
) -> Resection | None:  # fmt: skip
    """Compute the pose of one camera from people that other cameras see too.

    Args:
        rig: all other cameras are held.
        observations: people with identities over all cameras, at common instants (`association.instants.common_instants`).
        camera: name of the camera.
        from_s: times in [from, until) are used, by the observations' clock: frame 1 is at 0 s, or at the clock's offset.
        until_s: see `from_s`.
        without: names of cameras that are not used, such as others that have moved.
        ground: ground under the feet; z = 0 where None.

    Returns:
        The pose; None where people are too few (fewer than `FEWEST_CLUSTERS` stretches of 6 s).
    """
    seen = gather_sightings(rig, observations).between(from_s, until_s)
    return resect_observations(rig, seen, camera, without=without, ground=ground)


def resect_observations(
    rig: Rig, seen: Sightings, camera: str, *, without: tuple[str, ...] = (), ground: GroundPlane | None = None,
    heights: dict[int, float] | None = None,
) -> Resection | None:  # fmt: skip
    """Do the same as `resect`, from sightings. `heights` are people's heights in metres, where known from elsewhere."""
    seen = seen.without(np.isin(seen.names, without))
    index = seen.names.index(camera)
    rotation, centre = poses_of(rig, seen.names)
    # Heights of bodies come from the other cameras only: a camera whose pose is far off would spoil them.
    apart = np.arange(len(seen.names)) == index
    if heights is None and (~apart[seen.camera]).any():
        heights = fit_people(seen.without(apart), rotation, centre, ground=ground).heights

    def equations_at(pose: Pose, wide: float) -> _Clusters:
        def weights_of(lengths: Floats) -> Floats:
            return compute_cut_cauchy_weights((lengths / wide) ** 2, LOSS, BEYOND)

        rotation[index], centre[index] = pose.R_cw, pose.centre
        people = fit_people(seen, rotation, centre, ground=ground, heights=heights, weights_of=weights_of)
        return _Clusters.of(cluster_scores(seen, people), index, people)

    start = Pose.from_centre(rotation[index].copy(), centre[index].copy())
    fit = fit_pose(start, equations_at, widening=WIDENING, steps=ROUNDS, most_turn=MOST_TURN)
    clusters = fit.equations
    if len(clusters.gradient) < FEWEST_CLUSTERS:
        return None
    inverse = np.linalg.inv(fit.normal)
    covariance = centre_first(inverse @ cluster_robust_covariance(clusters.gradient, fit.normal)[0] @ inverse)
    shift = np.concatenate([fit.pose.centre - start.centre, log_rotation(fit.pose.R_cw @ start.R_cw.T)])
    return Resection(
        camera, fit.pose, PoseSigma.from_covariance(covariance), shift, covariance,
        float(shift @ np.linalg.solve(covariance, shift)), len(clusters.gradient), int(np.count_nonzero(seen.camera == index)),
        clusters.cost,
    )  # fmt: skip


CENTRE_FIRST = [3, 4, 5, 0, 1, 2]


def centre_first(matrix: Floats) -> Floats:
    """Reorder a matrix (6, 6) from rotation vector and centre to the order of `PoseSigma` and `Scores`: centre first."""
    return np.asarray(matrix[np.ix_(CENTRE_FIRST, CENTRE_FIRST)])


@dataclass(frozen=True, eq=False)
class _Clusters:
    """The K clusters that contain sightings by one camera, linearised about its pose."""

    gradient: Floats
    """(K, 6) gradient of half the robust cost, uphill."""
    information: Floats
    """(K, 6, 6) information: how fast the gradient grows."""
    cost: float
    """Half the sum of the weighted squared residuals of all sightings, bodies eliminated."""

    @classmethod
    def of(cls, scores: Scores, index: int, people: FittedPeople) -> _Clusters:
        """Select the clusters and the parameters of the camera with number `index`."""
        own = 6 * index + np.array(CENTRE_FIRST)
        scores = scores.take(scores.counts[:, index] > 0)
        cost = float(0.5 * (people.weight[:, None] * people.equations.residual**2).sum())
        return cls(-scores.gradient[:, own], scores.information[:, own[:, None], own], cost)

    def summed(self) -> tuple[Floats, Floats]:
        """Return the sums over all clusters: gradient (6,) and information (6, 6)."""
        return self.gradient.sum(axis=0), self.information.sum(axis=0)


def cluster_robust_covariance(
    residual: Floats, normal: Floats, before: tuple[Floats, float] | None = None
) -> tuple[Floats, float, Floats]:
    """Estimate the covariance of a sum of cluster scores from their scatter.

    In the frame in which the formal covariance, `normal`, is the unit matrix, the scatter is averaged with that of
    `USUAL_WORTH` usual clusters. Otherwise a few people who walk the same way would seem to determine the pose too well. (The
    sandwich estimator of White, *Econometrica* 1980, by clusters: Liang and Zeger, *Biometrika* 1986.)

    Args:
        residual: (K, 6) scores after the fit.
        normal: (6, 6) their summed information.
        before: summed scatter (6, 6) of other windows, and its number of clusters.

    Returns:
        (6, 6) covariance; its degrees of freedom; (6, 6) summed scatter of these clusters, for other windows.
    """
    lower = np.linalg.cholesky(normal)
    white = np.linalg.solve(lower, residual.T)
    n, (pooled, more) = len(residual), before or (np.zeros_like(normal), 0.0)
    # Whitened by the sum of n informations, the sum of n squares is the share of one cluster: n times it is the scatter of all.
    scatter = n * LASTING * white @ white.T * (n / max(n - 3.0, 1.0))
    total = n + more + USUAL_WORTH
    inflation = (scatter + pooled + USUAL_WORTH * USUAL_INFLATION * np.eye(len(normal))) / total
    return lower @ inflation @ lower.T, total - 3.0, scatter
