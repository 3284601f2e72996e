"""One camera's pose by people whom other cameras see too, with a covariance that allows for errors that last.

For what is measured anew while the other cameras stay as they are: has this camera moved, and where is it now?
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
"""Cameras are seldom moved by more: it holds a pose that people do not fix."""
STEPS, STILL = 8, 1e-5
"""Steps at most, and metres and radians below which no more are made."""
LOSS, BEYOND = 3.0, 25.0
"""Scale of the Cauchy loss in sigmas, and the square of the sigmas beyond which a sighting shows another person."""
WIDENING, ROUNDS = 64.0, 16
"""Times that scale, from which a pose is sought where bodies are solved anew with it, and steps at most: a camera that was
turned by ten degrees sees people some 80 sigmas off."""
MOST_TURN = 0.5
"""Radians that a camera turns in one step where its bodies are solved anew with it."""
FEWEST_CLUSTERS = 6
"""Stretches of people below which scatter tells nothing of the sigma."""
USUAL_INFLATION = 6.0
"""How many times their formal variance scores have, where there are too few to tell: 4 to 7 in the worst direction of simulated
and real footage."""
USUAL_WORTH = 6.0
"""Clusters that this counts for."""
LASTING = 1.33
"""Variance that the scatter of 6 s stretches does not show: a bag on one side, a gait, stay as long as a person does."""


class PoseEquations(Protocol):
    """What sightings, or clusters of them, ask of a pose; unknowns are a rotation vector in its frame, then the centre."""

    def summed(self) -> tuple[Floats, Floats]:
        """(6,) gradient of half the robust cost, uphill, and (6, 6) information: how fast it grows."""
        ...


Equations = TypeVar("Equations", bound=PoseEquations)


@dataclass(frozen=True, eq=False)
class PoseFit(Generic[Equations]):
    """A pose at which the robust cost is least."""

    pose: Pose
    normal: Floats
    """(6, 6) information, that of `weak_prior` included."""
    equations: Equations
    """At the pose."""


def fit_pose(
    start: Pose, equations_at: Callable[[Pose, float], Equations], *, widening: float = 1.0, steps: int = STEPS,
    most_turn: float = np.inf,
) -> PoseFit[Equations]:  # fmt: skip
    """The pose that sightings fit, near `start`: Gauss-Newton with a robust loss, whose scale shrinks as it goes.

    Args:
        start: where the search begins; a weak prior holds the pose to it.
        equations_at: what is seen asks of a pose, by a loss of so many times its usual scale.
        widening: times the usual scale that the loss begins with; it is halved at each step, down to 1.
        steps: at most.
        most_turn: radians a step.
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
    """(6, 6) information of a move of which nothing is known; its first and its last three rows are alike but for the unit."""
    return np.diag(np.repeat([1 / TURN_SD**2, 1 / CENTRE_SD_M**2], 3))


@dataclass(frozen=True, eq=False)
class Resection:
    """A camera's pose from one stretch of time."""

    camera: str
    pose: Pose
    sigma: PoseSigma
    """Of the new pose, relative to the other cameras as they are held."""
    shift: Floats
    """(6,) centre (metres, world) and rotation vector (radians, camera frame) from the rig's pose to the new one."""
    covariance: Floats
    """(6, 6) of `shift`."""
    statistic: float
    """`shift` in its own covariance: squared length; 6 where nothing moved."""
    clusters: int
    """Stretches of people that it uses."""
    sightings: int
    cost: float
    """Half the weighted squared residuals that are left, bodies eliminated."""

    @property
    def metres(self) -> float:
        """How far the centre moved."""
        return float(np.linalg.norm(self.shift[:3]))

    @property
    def degrees(self) -> float:
        """How far the camera turned."""
        return float(np.degrees(np.linalg.norm(self.shift[3:])))


def resect(
    rig: Rig, observations: Observations, camera: str, *, from_s: float = -np.inf, until_s: float = np.inf,
    without: tuple[str, ...] = (), ground: GroundPlane | None = None,
) -> Resection | None:  # fmt: skip
    """The pose of one camera by the people that others see too.

    Args:
        rig: all other cameras stay as they are.
        observations: people with identities over all cameras, at common instants (`association.instants.common_instants`).
        camera: which.
        from_s: times of [from, until) count, by the observations' clock: frame 1 is 0 s, or the clock's offset.
        until_s: see `from_s`.
        without: cameras that do not count, such as others that have moved.
        ground: where feet are; z = 0 where None.

    Returns:
        The pose; None where too few people tell (fewer than `FEWEST_CLUSTERS` stretches of 6 s).
    """
    seen = gather_sightings(rig, observations).between(from_s, until_s)
    return resect_observations(rig, seen, camera, without=without, ground=ground)


def resect_observations(
    rig: Rig, seen: Sightings, camera: str, *, without: tuple[str, ...] = (), ground: GroundPlane | None = None,
    heights: dict[int, float] | None = None,
) -> Resection | None:  # fmt: skip
    """As `resect`, from sightings; `heights` are those of people, where they are known from elsewhere."""
    seen = seen.without(np.isin(seen.names, without))
    index = seen.names.index(camera)
    rotation, centre = poses_of(rig, seen.names)
    # The bodies' heights are the others' business: a camera that is far off would spoil them.
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
    """(6, 6) from rotation vector and centre to the order of `PoseSigma` and of `Scores`, centre and rotation vector."""
    return np.asarray(matrix[np.ix_(CENTRE_FIRST, CENTRE_FIRST)])


@dataclass(frozen=True, eq=False)
class _Clusters:
    """The K clusters in which a camera has a part, about its pose."""

    gradient: Floats
    """(K, 6) of half the robust cost, uphill,"""
    information: Floats
    """(K, 6, 6) and how fast it grows."""
    cost: float
    """Half the weighted squared residuals of all sightings, bodies eliminated."""

    @classmethod
    def of(cls, scores: Scores, index: int, people: FittedPeople) -> _Clusters:
        """Those of one of the cameras."""
        own = 6 * index + np.array(CENTRE_FIRST)
        scores = scores.take(scores.counts[:, index] > 0)
        cost = float(0.5 * (people.weight[:, None] * people.equations.residual**2).sum())
        return cls(-scores.gradient[:, own], scores.information[:, own[:, None], own], cost)

    def summed(self) -> tuple[Floats, Floats]:
        """(6,) gradient and (6, 6) information of all."""
        return self.gradient.sum(axis=0), self.information.sum(axis=0)


def cluster_robust_covariance(
    residual: Floats, normal: Floats, before: tuple[Floats, float] | None = None
) -> tuple[Floats, float, Floats]:
    """The covariance of a sum of cluster scores, from how they scatter.

    In the frame in which the formal covariance, `normal`, is the unit matrix, the scatter is averaged with that of
    `USUAL_WORTH` usual clusters: a few people walking the same way must not look better determined than they are. (The
    sandwich estimator of White, *Econometrica* 1980, by clusters: Liang and Zeger, *Biometrika* 1986.)

    Args:
        residual: (K, 6) scores, the fit taken away.
        normal: (6, 6) their summed information.
        before: scatter that was summed in other windows, and of how many clusters.

    Returns:
        (6, 6) covariance; its degrees of freedom; (6, 6) the scatter of these clusters, summed, for other windows.
    """
    lower = np.linalg.cholesky(normal)
    white = np.linalg.solve(lower, residual.T)
    n, (pooled, more) = len(residual), before or (np.zeros_like(normal), 0.0)
    # Of a sum of n squares whitened by the sum of n informations the mean is one cluster's share.
    scatter = n * LASTING * white @ white.T * (n / max(n - 3.0, 1.0))
    total = n + more + USUAL_WORTH
    inflation = (scatter + pooled + USUAL_WORTH * USUAL_INFLATION * np.eye(len(normal))) / total
    return lower @ inflation @ lower.T, total - 3.0, scatter
