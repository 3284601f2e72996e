"""Bodies at instants, and what each sighting says about its camera once the body is let go.

A body stands at (x, y) on ground of height g and is h tall: four unknowns an instant. Each sighting gives three equations: its
middle across and up the picture, tight, and its size, loose (the person model of `solver.person_model`, linear about a guess).
The body is eliminated (Schur complement), so that what is left are normal equations of the cameras alone: a point of a person
that two cameras see binds both, and a third that disagrees stands out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.people.rig_observations import Sightings

BODY_M, BODY_SD = 1.72, 0.09
"""Standing height of people, and how much they differ."""
STANCE_SD = 0.07
"""Of the height at an instant about the person's own, as a share: gait, bending, hats."""
GROUND_SD = 0.08
"""Metres, of the feet about the plane of the ground: kerbs, strides."""
HUBER = 2.5
"""Scale of the Huber loss in the sightings' own sigmas: what a wrong match says counts no more than that."""
ROUNDS, LEARNT_AFTER = 4, 2
"""Of solving the bodies anew; after so many people's own heights are taken from them."""
NEAREST_M = 0.3
USUAL_MEDIAN = 1.18
"""Median of the length of a vector of two normal variables."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Height of the ground by place: `height + slope . (x, y)`, metres."""

    height: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)
    sd: float = GROUND_SD
    """Metres: of people's feet about it."""

    def at(self, xy: Floats) -> Floats:
        """(N,) heights at places (N, 2)."""
        return np.asarray(self.height + xy @ np.array(self.slope))


@dataclass(frozen=True, eq=False)
class Equations:
    """The linear equations of N sightings about G bodies: `residual - by_body d(body) - by_camera d(camera)`, whitened."""

    by_body: Floats
    """(N, 3, 4) x, y, g, h."""
    by_camera: Floats
    """(N, 3, 6) centre (metres, world), rotation vector (radians, camera frame: R becomes exp(w) R)."""
    residual: Floats
    """(N, 3)"""


@dataclass(frozen=True, eq=False)
class People:
    """G bodies and what they rest on."""

    body: Floats
    """(G, 4) x, y, g, h: metres."""
    prior: Floats
    """(G, 4, 4) information of what is known of them without being seen,"""
    pull: Floats
    """(G, 4) and its gradient at `body`."""
    information: Floats
    """(G, 4, 4) of the bodies, all told."""
    weight: Floats
    """(N,) of the sightings, by the robust loss."""
    equations: Equations
    scale: float
    """Of the residuals: how many times their sigmas they really are."""
    heights: dict[int, float]
    """Of the people, metres."""


def solve_people(
    seen: Sightings, rotation: Floats, centre: Floats, *, ground: Ground | None = None, heights: dict[int, float] | None = None,
    scale: float | None = None,
) -> People:  # fmt: skip
    """The bodies that the sightings show, by cameras that are held.

    Args:
        seen: sightings.
        rotation: (C, 3, 3) world to camera.
        centre: (C, 3) metres, world.
        ground: where feet are; z = 0 where None.
        heights: of people, metres; taken from the bodies where None.
        scale: of the residuals; measured where None.
    """
    ground = ground or Ground()
    who, number = np.unique(seen.person, return_inverse=True)
    tall = np.array([(heights or {}).get(one, BODY_M) for one in who.tolist()])
    own = heights is not None
    body = _first_guess(seen, rotation, centre, tall[number], ground)
    weight, size = np.ones(len(seen.camera)), scale or 1.0
    for turn in range(ROUNDS):
        if turn == LEARNT_AFTER and not own:
            tall, own = _heights(seen, body, number, len(who)), True
        known = tall[number]
        equations = equations_of(seen, rotation, centre, body)
        prior, pull = _prior(body, known, ground, own)
        information, step = _eliminated(seen, equations, weight, prior, pull)
        body = body + step
        body[:, 3] = np.clip(body[:, 3], 0.4 * known, 1.3 * known)
        off = equations.residual - (equations.by_body @ step[seen.group][:, :, None])[:, :, 0]
        weight, size = _huber(seen, off, scale)
    equations = equations_of(seen, rotation, centre, body)
    prior, pull = _prior(body, known, ground, own)
    information, _ = _eliminated(seen, equations, weight, prior, pull)
    return People(body, prior, pull, information, weight, equations, size, dict(zip(who.tolist(), tall.tolist(), strict=True)))


def _heights(seen: Sightings, body: Floats, number: Ints, n: int) -> Floats:
    """(n,) heights by what several cameras saw at once, drawn towards the usual height where that is little."""
    several = np.bincount(seen.group, minlength=seen.n_groups) > 1
    found = np.full(n, BODY_M)
    order = np.flatnonzero(several)[np.argsort(number[several], kind="stable")]
    count = np.bincount(number[several], minlength=n)
    for one, part in enumerate(np.split(body[order, 3], np.cumsum(count)[:-1])):
        if len(part):
            # A person's posture lasts: twenty instants say about what four independent ones would.
            weight = min(len(part) / 5.0, 10.0) / (STANCE_SD * BODY_M) ** 2
            found[one] = (BODY_M / BODY_SD**2 + weight * float(np.median(part))) / (1 / BODY_SD**2 + weight)
    return found


def equations_of(seen: Sightings, rotation: Floats, centre: Floats, body: Floats) -> Equations:
    """The equations about bodies (G, 4)."""
    R, C, here = rotation[seen.camera], centre[seen.camera], body[seen.group]
    toward = C[:, :2] - here[:, :2]
    toward = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), NEAREST_M)
    shift = (seen.foot_shift * here[:, 3])[:, None] * toward
    rows, by_body, by_camera = [], [], []
    for end, (ray, moved) in enumerate(((seen.top, 0.0), (seen.bottom, 1.0))):
        fraction = seen.fractions[:, end]
        place = np.column_stack([here[:, :2] + moved * shift, here[:, 2] + fraction * here[:, 3]])
        local = np.einsum("nij,nj->ni", R, place - C)
        axes = _axes(R, ray)
        along = np.maximum((local * ray).sum(axis=1), NEAREST_M)
        world = np.einsum("nki,nij->nkj", axes, R) / along[:, None, None]
        turn = np.cross(local[:, None, :], axes) / along[:, None, None]
        rows.append(-np.einsum("nki,ni->nk", axes, local) / along[:, None])
        by_camera.append(np.concatenate([-world, turn], axis=2))
        by_body.append(np.concatenate([world, world[:, :, 2:] * fraction[:, None, None]], axis=2))
    tight, loose = 1 / seen.middle_sd, 1 / seen.size_sd

    def joined(parts: list[Floats]) -> Floats:
        extra = (1,) * (parts[0].ndim - 2)
        middle = (parts[0] + parts[1]) / 2 * tight.reshape(-1, 1, *extra)
        span = (parts[0] - parts[1])[:, 1:] * loose.reshape(-1, 1, *extra)
        return np.concatenate([middle, span], axis=1)

    return Equations(joined(by_body), joined(by_camera), joined(rows))


def _axes(R: Floats, ray: Floats) -> Floats:
    """(N, 2, 3) across and up the picture, camera frame: at right angles to the rays, the first level in the world."""
    across = np.cross(ray, R[:, :, 2])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    return np.stack([across, np.cross(across, ray)], axis=1)


def _first_guess(seen: Sightings, rotation: Floats, centre: Floats, height: Floats, ground: Ground) -> Floats:
    """(G, 4) the median over the cameras of where the middle's ray, as long as the size says, ends."""
    R = rotation[seen.camera]
    middle = np.einsum("nji,nj->ni", R, seen.top + seen.bottom)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    level = np.hypot(middle[:, 0], middle[:, 1])
    span = (seen.fractions[:, 0] - seen.fractions[:, 1]) * height[seen.group]
    reach = span * np.maximum(level, 0.2) / np.maximum(seen.size, 1e-4)
    place = centre[seen.camera] + reach[:, None] * middle
    x, y = (_group_median(seen.group, place[:, k], seen.n_groups) for k in (0, 1))
    return np.column_stack([x, y, ground.at(np.column_stack([x, y])), height])


def _group_median(group: Ints, values: Floats, n: int) -> Floats:
    """(n,) medians (the mean of the two in the middle) of values (N,) sorted by group."""
    order = np.lexsort((values, group))
    count = np.bincount(group, minlength=n)
    first = np.cumsum(count) - count
    return np.asarray((values[order][first + (count - 1) // 2] + values[order][first + count // 2]) / 2)


def _prior(body: Floats, known: Floats, ground: Ground, own: bool) -> tuple[Floats, Floats]:
    """Of g about the ground and h about the person's height: (G, 4, 4) and its gradient (G, 4)."""
    n = len(body)
    spread = known * STANCE_SD if own else np.hypot(known * STANCE_SD, BODY_SD)
    information = np.zeros((n, 4, 4))
    of_ground = np.array([-ground.slope[0], -ground.slope[1], 1.0, 0.0]) / ground.sd
    information += of_ground[:, None] * of_ground
    information[:, 3, 3] += 1 / spread**2
    miss = (body[:, 2] - ground.at(body[:, :2])) / ground.sd
    pull = -miss[:, None] * of_ground
    pull[:, 3] -= (body[:, 3] - known) / spread**2
    return information, pull


def _eliminated(seen: Sightings, equations: Equations, weight: Floats, prior: Floats, pull: Floats) -> tuple[Floats, Floats]:
    """Information (G, 4, 4) and step (G, 4) of the bodies."""
    A = equations.by_body
    weighted = A * weight[:, None, None]
    information = prior + sums(seen.group, np.einsum("nki,nkj->nij", weighted, A), seen.n_groups)
    right = pull + sums(seen.group, np.einsum("nki,nk->ni", weighted, equations.residual), seen.n_groups)
    information += 1e-6 * np.eye(4)
    step = np.linalg.solve(information, right[:, :, None])[:, :, 0]
    return information, np.asarray(step, dtype=np.float64)


def _huber(seen: Sightings, residual: Floats, scale: float | None) -> tuple[Floats, float]:
    """(N,) weights, and the scale of the residuals."""
    length = np.hypot(residual[:, 0], residual[:, 1])
    if scale is None:
        several = np.bincount(seen.group, minlength=seen.n_groups)[seen.group] > 1
        # Two cameras leave half of their errors to be seen, and a fit to them all the less.
        scale = max(1.0, float(np.median(length[several])) / (0.7 * USUAL_MEDIAN)) if several.any() else 1.0
    return np.minimum(1.0, HUBER * scale / np.maximum(length, 1e-9)), scale


def sums(group: Ints, values: Floats, n: int) -> Floats:
    """(n, ...) sums of the rows (N, ...) of each group."""
    flat = values.reshape(len(values), -1)
    total = np.stack([np.bincount(group, flat[:, k], minlength=n) for k in range(flat.shape[1])], axis=1)
    return np.asarray(total.reshape(n, *values.shape[1:]), dtype=np.float64)
