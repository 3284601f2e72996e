"""One camera's pose by people whom other cameras see too, with a covariance that allows for errors that last.

For what is measured anew while the other cameras stay as they are: has this camera moved, and where is it now?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, PoseSigma, Rig
from passerby.core.observations import Observations
from passerby.geometry.rotations import exp_rotation, log_rotation
from passerby.people.held_cameras import Ground, solve_people
from passerby.people.rig_observations import Sightings, poses_of, sightings_of
from passerby.people.scores import Scores, scores_of

LOOSE_M, LOOSE_DEG = 2.0, 40.0
"""One sigma of a move before anything is seen: only to keep the equations soluble."""
MAX_ROUNDS = 12
STILL = 1e-5
"""Metres and radians: steps below end the iteration."""
FEWEST_CLUSTERS = 6
"""Stretches of people below which scatter tells nothing of the sigma."""
USUAL_INFLATION = 6.0
"""How many times their formal variance scores have, where there are too few to tell: 4 to 7 in the worst direction of simulated
and real footage."""
USUAL_WORTH = 6.0
"""Clusters that this counts for."""
LASTING = 1.33
"""Variance that the scatter of 6 s stretches does not show: a bag on one side, a gait, stay as long as a person does."""


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
    """Stretches of people that it rests on."""
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
    without: tuple[str, ...] = (), ground: Ground | None = None,
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
    seen = sightings_of(rig, observations).between(from_s, until_s)
    return resect_sightings(rig, seen, camera, without=without, ground=ground)


def resect_sightings(
    rig: Rig, seen: Sightings, camera: str, *, without: tuple[str, ...] = (), ground: Ground | None = None,
    heights: dict[int, float] | None = None,
) -> Resection | None:  # fmt: skip
    """As `resect`, from sightings; `heights` are those of people, where they are known from elsewhere."""
    seen = seen.without(np.isin(seen.names, without))
    index = seen.names.index(camera)
    rotation, centre = poses_of(rig, seen.names)
    start_rotation, start_centre = rotation[index].copy(), centre[index].copy()
    own = slice(6 * index, 6 * index + 6)
    # The bodies' heights are the others' business: a camera that is far off would spoil them.
    apart = np.arange(len(seen.names)) == index
    if heights is None and (~apart[seen.camera]).any():
        heights = solve_people(seen.without(apart), rotation, centre, ground=ground).heights
    for _ in range(MAX_ROUNDS):
        people = solve_people(seen, rotation, centre, ground=ground, heights=heights)
        scores = _of_camera(scores_of(seen, people), index)
        if len(scores) < FEWEST_CLUSTERS:
            return None
        normal = scores.information[:, own, own].sum(axis=0) + loose()
        step = np.linalg.solve(normal, scores.gradient[:, own].sum(axis=0))
        step *= min(1.0, 0.5 / max(float(np.linalg.norm(step[3:])), 1e-12))
        centre[index] = centre[index] + step[:3]
        rotation[index] = exp_rotation(step[3:]) @ rotation[index]
        if np.abs(step).max() < STILL:
            break
    residual = scores.gradient[:, own] - scores.information[:, own, own] @ step
    inverse = np.linalg.inv(normal)
    covariance = inverse @ spread(residual, normal)[0] @ inverse
    shift = np.concatenate([centre[index] - start_centre, log_rotation(rotation[index] @ start_rotation.T)])
    sigma = PoseSigma(
        float(np.sqrt(np.trace(covariance[:3, :3]))), float(np.degrees(np.sqrt(np.trace(covariance[3:, 3:])))), covariance
    )
    return Resection(
        camera, Pose.from_centre(rotation[index], centre[index]), sigma, shift, covariance,
        float(shift @ np.linalg.solve(covariance, shift)), len(scores), int(np.count_nonzero(seen.camera == index)),
        _cost(people.weight, people.equations.residual),
    )  # fmt: skip


def spread(residual: Floats, normal: Floats, before: tuple[Floats, float] | None = None) -> tuple[Floats, float, Floats]:
    """The covariance of a sum of cluster scores, from how they scatter.

    In the frame in which the formal covariance, `normal`, is the unit matrix, the scatter is averaged with that of
    `USUAL_WORTH` usual clusters: a few people walking the same way must not look surer than they are. (The sandwich estimator
    of White, *Econometrica* 1980, by clusters: Liang and Zeger, *Biometrika* 1986.)

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


def loose() -> Floats:
    """(6, 6) information of a move of which nothing is known."""
    return np.diag(np.repeat([LOOSE_M**-2, np.radians(LOOSE_DEG) ** -2], 3))


def _of_camera(scores: Scores, index: int) -> Scores:
    """The clusters in which a camera has a part."""
    return scores.take(scores.counts[:, index] > 0)


def _cost(weight: Floats, residual: Floats) -> float:
    """Half the weighted squared residuals."""
    return float(0.5 * (weight[:, None] * residual**2).sum())
