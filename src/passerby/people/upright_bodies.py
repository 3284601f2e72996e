"""Upright bodies fitted to the boxes of single instants with a rig that is held, and the boxes predicted from these bodies.

The fit is robust: it has Cauchy weights on each box (the solver's scale) and on each person's stance. It begins at the median
of the positions that single boxes give.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Rig
from passerby.geometry.groups import cauchy_weights, group_medians, group_numbers, group_sums
from passerby.people.model import GAIT_SHARE, Noise, Priors
from passerby.people.sightings import Sightings, box_sightings
from passerby.people.upright_body import STANCE_SD, body_ends, linearise_on_ground, single_view_bodies, solve_bodies

ROUNDS = 8
"""Rounds of weighting and solving; the last moves a body by less than a millimetre."""
SOFT_ROUNDS = 4
"""Rounds after which a box that disagrees gets weight 0, if other boxes agree with the body: one that is 100 pixels off moved
it by some pixels."""
AGREES_SIGMAS = 5.0
"""Largest residual of the centre of a box that agrees, and the Cauchy scale of the solver's loss. A box with a larger residual
shows another person, or a part of a person."""
UNKNOWN_HEIGHT_SD = 0.07
"""Sigma of the heights that the calibration does not contain, as a share: adults differ by 5 %, and stance adds to it."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Parameters of people and boxes from the calibration."""

    noise: Noise
    foot_shift: float
    """Distance by which the lowest visible point is nearer to the camera than the body's axis, as a share of the height."""
    slack: Mapping[str, float]
    """By camera: logarithm of the factor by which boxes are taller than people."""
    heights: Mapping[int, float]
    """Standing heights by identity, metres."""
    usual_m: float
    """Standing height of all other people, metres."""


@dataclass(frozen=True, eq=False)
class UprightBodies:
    """B upright bodies. World of the rig: z up, ground at z = 0, metres."""

    identity: Ints
    """(B,)"""
    frame: Ints
    """(B,) frame of the sample's clock."""
    xy: Floats
    """(B, 2) position of the body on the ground."""
    top: Floats
    """(B,) height of its highest point."""
    sigma_m: Floats
    """(B,) root of the trace of the covariance of (x, y), for cameras that are held."""
    cameras: Ints
    """(B,) number of cameras that agree."""

    def __len__(self) -> int:
        return len(self.identity)

    @classmethod
    def none(cls) -> UprightBodies:
        """Return a table of no bodies."""
        nothing = np.zeros(0, np.int64)
        return cls(nothing, nothing, np.zeros((0, 2)), np.zeros(0), np.zeros(0), nothing)

    @property
    def standing(self) -> Floats:
        """(B, 4) x, y, height of the lowest and of the highest point, in the person model's order."""
        return np.column_stack([self.xy, np.zeros(len(self.top)), self.top])


def fit_bodies(rig: Rig, seen: Sightings, model: BodyModel) -> tuple[UprightBodies, Ints, Bools]:
    """Fit a body to the boxes of each identity and instant.

    Args:
        rig: cameras with poses.
        seen: M sightings of boxes, with `ltwh`.
        model: people and boxes, from the calibration.

    Returns:
        The bodies, sorted by identity, then by frame; the body of each box (M,), -1 where the lens gives no rays; and
        (M,) whether each box agrees with its body.
    """
    if not len(seen.step):
        return UprightBodies.none(), np.zeros(0, np.int64), np.zeros(0, bool)
    rays = _rays(rig, seen, model)
    rows = np.flatnonzero(rays.known)
    body_of = np.full(len(seen.step), -1)
    identity, frame = seen.identity[rows], seen.step[rows]
    block = group_numbers(identity, frame)
    first = np.unique(block, return_index=True)[1]
    identity, frame = identity[first], frame[first]
    body_of[rows] = block
    agrees = np.zeros(len(seen.step), bool)
    if not len(rows):
        return UprightBodies.none(), body_of, agrees
    height = np.array([model.heights.get(one, np.nan) for one in identity.tolist()])
    sd = np.where(np.isfinite(height), STANCE_SD, UNKNOWN_HEIGHT_SD)
    height = GAIT_SHARE * np.where(np.isfinite(height), height, model.usual_m)
    body, covariance, off = _solved(rays.take(rows), block, height, sd * height, model)
    agrees[rows] = off < AGREES_SIGMAS
    count = np.bincount(body_of[agrees], minlength=len(first))
    sigma = np.sqrt(np.trace(covariance[:, :2, :2], axis1=1, axis2=2))
    return UprightBodies(identity, frame, body[:, :2], body[:, 2], sigma, count), body_of, agrees


def predict_boxes(
    rig: Rig, camera: Ints, bodies: UprightBodies, body: Ints, width: Floats, model: BodyModel
) -> tuple[Floats, Floats, Floats]:
    """Predict the boxes of bodies in cameras.

    Args:
        rig: cameras with poses.
        camera: (M,) rows of the cameras.
        bodies: the bodies.
        body: (M,) rows of `bodies`.
        width: (M,) width of the boxes, pixels; the model has no width of people.
        model: people and boxes, from the calibration.

    Returns:
        (M, 4) left, top, width, height; (M, 2) and (M, 2) pixels of the highest and of the lowest point. NaN where they are
        behind the camera.
    """
    centre = np.array([c.centre for c in rig]).reshape(-1, 3)[camera]
    standing = bodies.standing[body]
    heights = np.array([model.heights.get(one, model.usual_m) for one in bodies.identity.tolist()])
    moved = model.foot_shift * heights[body][:, None]
    top, bottom, _, _ = body_ends(centre, standing, moved)
    top_px, bottom_px = np.full((len(body), 2), np.nan), np.full((len(body), 2), np.nan)
    taller = np.ones(len(body))
    for index, one in enumerate(rig):
        rows = np.flatnonzero(camera == index)
        top_px[rows], bottom_px[rows] = one.project(top[rows]), one.project(bottom[rows])
        taller[rows] = np.exp(model.slack.get(one.name, 0.0))
    middle, height = (top_px + bottom_px) / 2, (bottom_px - top_px)[:, 1] * taller
    return np.column_stack([middle[:, 0] - width / 2, middle[:, 1] - height / 2, width, height]), top_px, bottom_px


def _rays(rig: Rig, seen: Sightings, model: BodyModel) -> Sightings:
    """Return the rays of all boxes in the world's frame, each box shortened by the slack of its camera."""
    parts, order = [], []
    for index, camera in enumerate(rig):
        rows = np.flatnonzero(seen.camera == index)
        ltwh = np.array(seen.ltwh[rows])
        less = ltwh[:, 3] * -np.expm1(-model.slack.get(camera.name, 0.0))
        ltwh[:, 1] += less / 2
        ltwh[:, 3] -= less
        parts.append(box_sightings(camera, index, seen.step[rows], seen.identity[rows], ltwh, model.noise))
        order.append(rows)
    back = np.argsort(np.concatenate(order), kind="stable")
    return Sightings.joined(parts).take(back)


def _solved(rays: Sightings, block: Ints, height: Floats, height_sd: Floats, model: BodyModel) -> tuple[Floats, Floats, Floats]:
    """Solve the bodies (B, 3). Return them, their covariances, and the residuals (M,) of the boxes' centres in sigmas."""
    n = len(height)
    shift = (model.foot_shift * height)[block][:, None]
    alone = single_view_bodies(rays, float(np.median(height)), model.foot_shift * model.usual_m)[0]
    body = np.column_stack([*(group_medians(block, alone[:, k], n) for k in (0, 1)), height])
    off, sd = np.zeros(len(block)), height_sd
    for number in range(ROUNDS):
        found = linearise_on_ground(rays, body[block], shift)
        off = np.linalg.norm(found.residual(body[block])[:, :2], axis=1)
        if number == ROUNDS - 1:
            break
        weight = cauchy_weights((off / AGREES_SIGMAS) ** 2)
        if number >= SOFT_ROUNDS:
            agrees = off < AGREES_SIGMAS
            weight[~agrees & (np.bincount(block[agrees], minlength=n) > 0)[block]] = 0.0
        information = group_sums(block, found.information * weight[:, None, None], n)
        pull = group_sums(block, found.pull * weight[:, None], n)
        # The prior on height is weakened for people who crouch or jump, as by the solver's loss on stance.
        sd = height_sd * np.sqrt(1 + ((body[:, 2] - height) / (Priors().stance_loss * height_sd)) ** 2)
        body, covariance = solve_bodies(information, pull, height, sd)
        body[:, 2] = np.clip(body[:, 2], 0.2 * height, 1.5 * height)
    return body, covariance, off
