"""Bodies at instants with cameras that are held, and the equations of their sightings for the cameras.

A body stands at (x, y) on ground of height g and is h tall: four unknowns an instant. Each sighting gives the three equations
of `upright_body.linearise_bodies`. The body is eliminated (Schur complement), which leaves normal equations of the cameras
alone: a person that two cameras see constrains both, and the disagreement of a third camera becomes visible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.geometry.groups import group_medians, group_sums, huber_weights
from passerby.people.model import Priors
from passerby.people.sightings import Sightings
from passerby.people.upright_body import BodyEquations, linearise_bodies, reach_by_size

STANCE_SD = 0.07
"""Standard deviation of the height at an instant about the person's own, as a share: gait, bending, hats."""
GROUND_SD = 0.08
"""Standard deviation of the feet about the plane of the ground, metres: kerbs, strides."""
HUBER = 2.5
"""Scale of the default loss in the sightings' sigmas. It limits the effect of a wrong match, and a camera that has moved still
has an effect."""
ROUNDS, LEARNT_AFTER = 4, 2
"""Rounds of solving the bodies, and rounds after which people's own heights are taken from the bodies."""
USUAL_MEDIAN = 1.18
"""Median length of a vector of two standard normal variables."""
FOOT_SHIFT = Priors().foot_shift
"""Foot shift of a box, which ends at the nearer foot, as a share of the body's height."""


WeightsOf = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """Height of the ground by place: `height + slope . (x, y)`, metres."""

    height: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)
    sd: float = GROUND_SD
    """Standard deviation of people's feet about the plane, metres."""

    def at(self, xy: Floats) -> Floats:
        """Return the heights (N,) at positions (N, 2)."""
        return np.asarray(self.height + xy @ np.array(self.slope))


@dataclass(frozen=True, eq=False)
class FittedPeople:
    """G bodies and the observations that they use."""

    body: Floats
    """(G, 4) x, y, g, h: metres."""
    prior: Floats
    """(G, 4, 4) information of the prior on the bodies."""
    pull: Floats
    """(G, 4) gradient of the prior at `body`, downhill."""
    information: Floats
    """(G, 4, 4) total information of the bodies."""
    weight: Floats
    """(N,) weights of the sightings by the robust loss."""
    equations: BodyEquations
    by_camera: Floats
    """(N, 3, 6) derivatives of the equations by the camera, `BodyEquations.by_camera`."""
    scale: float
    """Ratio of the residuals' size to their stated sigmas."""
    heights: dict[int, float]
    """Heights of the people by identity, metres."""


def fit_people(
    seen: Sightings, rotation: Floats, centre: Floats, *, ground: GroundPlane | None = None,
    heights: dict[int, float] | None = None, scale: float | None = None, weights_of: WeightsOf | None = None,
) -> FittedPeople:  # fmt: skip
    """Fit bodies to the sightings of cameras that are held.

    Args:
        seen: sightings from `gather_sightings`: block after block, rays in the cameras' frames.
        rotation: (C, 3, 3) world to camera.
        centre: (C, 3) metres, world.
        ground: ground under the feet; z = 0 where None.
        heights: heights of people by identity, metres; taken from the bodies where None.
        scale: ratio of the residuals to their sigmas; measured where None.
        weights_of: robust loss: returns weights for lengths of residuals in sigmas; Huber's where None.
    """
    weights_of = weights_of or (lambda lengths: huber_weights(lengths, HUBER))
    ground = ground or GroundPlane()
    rotations, seen = rotation[seen.camera], seen.in_world(rotation, centre)
    who, number = np.unique(seen.block_identity, return_inverse=True)
    tall = np.array([(heights or {}).get(one, PERSON_HEIGHT_M) for one in who.tolist()])
    own = heights is not None
    body = _first_guess(seen, tall[number], ground)
    weight, size = np.ones(len(seen.camera)), scale or 1.0
    for turn in range(ROUNDS):
        if turn == LEARNT_AFTER and not own:
            tall, own = _heights(seen, body, number, len(who)), True
        known = tall[number]
        equations = equations_of(seen, body)
        prior, pull = _prior(body, known, ground, own)
        information, step = _eliminated(seen, equations, weight, prior, pull)
        body = body + step
        body[:, 3] = np.clip(body[:, 3], 0.4 * known, 1.3 * known)
        off = equations.residual - (equations.by_body @ step[seen.block][:, :, None])[:, :, 0]
        weight, size = _weights(seen, off, scale, weights_of)
    equations = equations_of(seen, body)
    prior, pull = _prior(body, known, ground, own)
    information, _ = _eliminated(seen, equations, weight, prior, pull)
    return FittedPeople(
        body, prior, pull, information, weight, equations, equations.by_camera(rotations), size,
        dict(zip(who.tolist(), tall.tolist(), strict=True)),
    )  # fmt: skip


def _heights(seen: Sightings, body: Floats, number: Ints, n: int) -> Floats:
    """Estimate people's heights (n,) from bodies seen by several cameras, drawn to the usual height where these are few."""
    several = np.bincount(seen.block, minlength=seen.n_blocks) > 1
    found = np.full(n, PERSON_HEIGHT_M)
    order = np.flatnonzero(several)[np.argsort(number[several], kind="stable")]
    count = np.bincount(number[several], minlength=n)
    for one, part in enumerate(np.split(body[order, 3], np.cumsum(count)[:-1])):
        if len(part):
            # A person's posture lasts: twenty instants count as four independent ones.
            weight = min(len(part) / 5.0, 10.0) / (STANCE_SD * PERSON_HEIGHT_M) ** 2
            found[one] = (PERSON_HEIGHT_M / PERSON_HEIGHT_SD_M**2 + weight * float(np.median(part))) / (
                1 / PERSON_HEIGHT_SD_M**2 + weight
            )
    return found


def equations_of(seen: Sightings, body: Floats) -> BodyEquations:
    """Linearise the equations of sightings, rays in the world's frame, about bodies (G, 4)."""
    here = body[seen.block]
    return linearise_bodies(seen, here, (FOOT_SHIFT * seen.has_foot * here[:, 3])[:, None])


def _first_guess(seen: Sightings, height: Floats, ground: GroundPlane) -> Floats:
    """Return first bodies (G, 4): the median over the cameras of the positions from each middle's ray and size."""
    length = (seen.top_fraction - seen.bottom_fraction) * height[seen.block]
    middle, reach = reach_by_size(seen.top, seen.bottom, seen.size, length, least_level=0.2)
    place = seen.origin + reach[:, None] * middle
    x, y = (group_medians(seen.block, place[:, k], seen.n_blocks) for k in (0, 1))
    return np.column_stack([x, y, ground.at(np.column_stack([x, y])), height])


def _prior(body: Floats, known: Floats, ground: GroundPlane, own: bool) -> tuple[Floats, Floats]:
    """Return the prior of g about the ground and of h about the person's height: information (G, 4, 4), gradient (G, 4)."""
    n = len(body)
    spread = known * STANCE_SD if own else np.hypot(known * STANCE_SD, PERSON_HEIGHT_SD_M)
    information = np.zeros((n, 4, 4))
    of_ground = np.array([-ground.slope[0], -ground.slope[1], 1.0, 0.0]) / ground.sd
    information += of_ground[:, None] * of_ground
    information[:, 3, 3] += 1 / spread**2
    miss = (body[:, 2] - ground.at(body[:, :2])) / ground.sd
    pull = -miss[:, None] * of_ground
    pull[:, 3] -= (body[:, 3] - known) / spread**2
    return information, pull


def _eliminated(
    seen: Sightings, equations: BodyEquations, weight: Floats, prior: Floats, pull: Floats
) -> tuple[Floats, Floats]:
    """Solve the normal equations of the bodies: return their information (G, 4, 4) and their steps (G, 4)."""
    A = equations.by_body
    weighted = A * weight[:, None, None]
    information = prior + group_sums(seen.block, np.einsum("nki,nkj->nij", weighted, A), seen.n_blocks)
    right = pull + group_sums(seen.block, np.einsum("nki,nk->ni", weighted, equations.residual), seen.n_blocks)
    information += 1e-6 * np.eye(4)
    step = np.linalg.solve(information, right[:, :, None])[:, :, 0]
    return information, np.asarray(step, dtype=np.float64)


def _weights(seen: Sightings, residual: Floats, scale: float | None, weights_of: WeightsOf) -> tuple[Floats, float]:
    """Return the weights (N,) and the scale of the residuals."""
    length = np.hypot(residual[:, 0], residual[:, 1])
    if scale is None:
        several = np.bincount(seen.block, minlength=seen.n_blocks)[seen.block] > 1
        # With two cameras the residuals show half of the errors, and less after a fit to them.
        scale = max(1.0, float(np.median(length[several])) / (0.7 * USUAL_MEDIAN)) if several.any() else 1.0
    return weights_of(length / scale), scale
