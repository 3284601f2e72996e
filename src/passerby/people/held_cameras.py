"""Bodies at instants, and what each sighting says about its camera once the body is let go.

A body stands at (x, y) on ground of height g and is h tall: four unknowns an instant. Each sighting gives the three equations
of `upright_body.linearise_bodies`. The body is eliminated (Schur complement), so that what is left are normal equations of the
cameras alone: a point of a person that two cameras see binds both, and a third that disagrees stands out.
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
"""Of the height at an instant about the person's own, as a share: gait, bending, hats."""
GROUND_SD = 0.08
"""Metres, of the feet about the plane of the ground: kerbs, strides."""
HUBER = 2.5
"""Scale of the usual loss in the sightings' own sigmas: what a wrong match says counts no more than that, and what a camera
says that has moved still counts."""
ROUNDS, LEARNT_AFTER = 4, 2
"""Of solving the bodies anew; after so many people's own heights are taken from them."""
USUAL_MEDIAN = 1.18
"""Median of the length of a vector of two normal variables."""
FOOT_SHIFT = Priors().foot_shift
"""Of a box, which ends at the nearer foot: as a share of the body's height."""


WeightsOf = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """Height of the ground by place: `height + slope . (x, y)`, metres."""

    height: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)
    sd: float = GROUND_SD
    """Metres: of people's feet about it."""

    def at(self, xy: Floats) -> Floats:
        """(N,) heights at places (N, 2)."""
        return np.asarray(self.height + xy @ np.array(self.slope))


@dataclass(frozen=True, eq=False)
class FittedPeople:
    """G bodies and the observations that they use."""

    body: Floats
    """(G, 4) x, y, g, h: metres."""
    prior: Floats
    """(G, 4, 4) information of what is known of them without being seen,"""
    pull: Floats
    """(G, 4) and its gradient at `body`."""
    information: Floats
    """(G, 4, 4) total information of the bodies."""
    weight: Floats
    """(N,) of the sightings, by the robust loss."""
    equations: BodyEquations
    by_camera: Floats
    """(N, 3, 6) of the equations."""
    scale: float
    """Of the residuals: how many times their sigmas they really are."""
    heights: dict[int, float]
    """Of the people, metres."""


def fit_people(
    seen: Sightings, rotation: Floats, centre: Floats, *, ground: GroundPlane | None = None,
    heights: dict[int, float] | None = None, scale: float | None = None, weights_of: WeightsOf | None = None,
) -> FittedPeople:  # fmt: skip
    """The bodies that the sightings show, by cameras that are held.

    Args:
        seen: of `gather_sightings`: block after block, rays in the cameras' frames.
        rotation: (C, 3, 3) world to camera.
        centre: (C, 3) metres, world.
        ground: where feet are; z = 0 where None.
        heights: of people, metres; taken from the bodies where None.
        scale: of the residuals; measured where None.
        weights_of: the robust loss, as weights by lengths of residuals in sigmas; Huber's where None.
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
    """(n,) heights by what several cameras saw at once, drawn towards the usual height where that is little."""
    several = np.bincount(seen.block, minlength=seen.n_blocks) > 1
    found = np.full(n, PERSON_HEIGHT_M)
    order = np.flatnonzero(several)[np.argsort(number[several], kind="stable")]
    count = np.bincount(number[several], minlength=n)
    for one, part in enumerate(np.split(body[order, 3], np.cumsum(count)[:-1])):
        if len(part):
            # A person's posture lasts: twenty instants say about what four independent ones would.
            weight = min(len(part) / 5.0, 10.0) / (STANCE_SD * PERSON_HEIGHT_M) ** 2
            found[one] = (PERSON_HEIGHT_M / PERSON_HEIGHT_SD_M**2 + weight * float(np.median(part))) / (
                1 / PERSON_HEIGHT_SD_M**2 + weight
            )
    return found


def equations_of(seen: Sightings, body: Floats) -> BodyEquations:
    """The equations of sightings, rays in the world's frame, about bodies (G, 4)."""
    here = body[seen.block]
    return linearise_bodies(seen, here, (FOOT_SHIFT * seen.has_foot * here[:, 3])[:, None])


def _first_guess(seen: Sightings, height: Floats, ground: GroundPlane) -> Floats:
    """(G, 4) the median over the cameras of where the middle's ray, as long as the size says, ends."""
    length = (seen.top_fraction - seen.bottom_fraction) * height[seen.block]
    middle, reach = reach_by_size(seen.top, seen.bottom, seen.size, length, least_level=0.2)
    place = seen.origin + reach[:, None] * middle
    x, y = (group_medians(seen.block, place[:, k], seen.n_blocks) for k in (0, 1))
    return np.column_stack([x, y, ground.at(np.column_stack([x, y])), height])


def _prior(body: Floats, known: Floats, ground: GroundPlane, own: bool) -> tuple[Floats, Floats]:
    """Of g about the ground and h about the person's height: (G, 4, 4) and its gradient (G, 4)."""
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
    """Information (G, 4, 4) and step (G, 4) of the bodies."""
    A = equations.by_body
    weighted = A * weight[:, None, None]
    information = prior + group_sums(seen.block, np.einsum("nki,nkj->nij", weighted, A), seen.n_blocks)
    right = pull + group_sums(seen.block, np.einsum("nki,nk->ni", weighted, equations.residual), seen.n_blocks)
    information += 1e-6 * np.eye(4)
    step = np.linalg.solve(information, right[:, :, None])[:, :, 0]
    return information, np.asarray(step, dtype=np.float64)


def _weights(seen: Sightings, residual: Floats, scale: float | None, weights_of: WeightsOf) -> tuple[Floats, float]:
    """(N,) weights, and the scale of the residuals."""
    length = np.hypot(residual[:, 0], residual[:, 1])
    if scale is None:
        several = np.bincount(seen.block, minlength=seen.n_blocks)[seen.block] > 1
        # Two cameras leave half of their errors to be seen, and a fit to them all the less.
        scale = max(1.0, float(np.median(length[several])) / (0.7 * USUAL_MEDIAN)) if several.any() else 1.0
    return weights_of(length / scale), scale
