"""Scale, up direction and ground from trunks and arms, where nobody is seen from head to feet.

Joints that several cameras share fix how the cameras stand to each other, and place the joints of each body in space. What is
left is one similarity: its scale by the lengths of body segments as shares of stature, its up direction by trunks, which are
upright on the mean, and its ground by the height of hips. Lengths of segments do not change with posture; hips do, so that the
ground is a guess that anything better replaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import MIN_JOINT_SCORE, Observations
from passerby.geometry.groups import group_numbers
from passerby.geometry.triangulation import angular_residuals, in_camera_frames, triangulate

MOST_BODIES = 4000
"""Person-instants that are measured; more are drawn at random."""
MIN_BODIES = 8
"""Of one person, for a length or a direction of this person to count."""
MOST_OFF_RAD = 0.02
"""Joints whose rays miss each other by more are left out."""


@dataclass(frozen=True)
class Segment:
    """A part of the body of constant length."""

    ends: tuple[tuple[str, str], ...]
    """The joints at its ends; both sides of the body where there are two."""
    share: float
    """Of stature: Drillis and Contini (1966), as in Winter, *Biomechanics and Motor Control of Human Movement*, figure 4.1."""
    sd: float
    """How far the means of sources and the joints of detectors are from it, as a share of the length."""


SEGMENTS = (
    Segment((("shoulders", "hips"), ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip")), 0.288, 0.08),
    # Between the joints; from acromion to acromion it is 0.259.
    Segment((("left_shoulder", "right_shoulder"),), 0.21, 0.12),
    Segment((("left_shoulder", "left_elbow"), ("right_shoulder", "right_elbow")), 0.186, 0.07),
    Segment((("left_elbow", "left_wrist"), ("right_elbow", "right_wrist")), 0.146, 0.08),
)
"""Those of the upper body. Hips are the least sure: detectors put them beside the joints, each in its own way."""
COMMON_SD = 0.05
"""What all segments are off by alike: clothes, and joints that lie deeper in the body than where detectors see them."""
PROPORTION_SD = 0.04
"""How far a person's proportions are from the mean, as a share of lengths (Winter's tables: 3 to 5 %)."""
DISAGREE = 0.35
"""Logarithms of the scale that differ by more between segments speak of other joints than the names say."""

LEAN_SD, SIDEWAYS_SD = 0.20, 0.05
"""Of one person's mean trunk, radians, forwards and sideways: people at a desk lean on it."""
SWAY_SD = 0.15
"""Of a trunk about its person's mean, radians, as often as posture is a new one."""
SAME_POSTURE = 20
"""Time steps in a row that count as one posture."""
BENT_SIGMAS = 2.0
"""Trunks that lean farther count less."""

HIP_SHARE = 0.53
"""Height of the hips of who stands, as a share of stature."""
STANDING_QUANTILE = 0.8
"""Of each person's hip heights, and then of all people's: who stands is higher than who sits."""
GROUND_SD_M = 0.25
"""Of the ground by hips: all may sit, whose hips are 0.4 m lower."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Joints of N bodies in space, in the rig's frame and unit."""

    identity: Ints
    """(N,) ascending."""
    frame: Ints
    """(N,) ascending for each identity."""
    points: Floats
    """(N, J, 3) NaN where two cameras do not share the joint."""
    joints: tuple[str, ...]

    def at(self, name: str) -> Floats:
        """(N, 3) one joint; `shoulders` and `hips` are the middles of both."""
        if name == "shoulders":
            return self._middle("shoulder", "neck")
        if name == "hips":
            return self._middle("hip", "mid_hip")
        if name not in self.joints:
            return np.full((len(self.points), 3), np.nan)
        return self.points[:, self.joints.index(name)]

    def _middle(self, part: str, instead: str) -> Floats:
        middle = 0.5 * (self.at(f"left_{part}") + self.at(f"right_{part}"))
        return np.where(np.isfinite(middle), middle, self.at(instead))


@dataclass(frozen=True)
class BodyScale:
    """What segments say of the scale."""

    log_factor: float
    """The logarithm of what lengths have to be multiplied by."""
    sd: float
    people: int


@dataclass(frozen=True, eq=False)
class BodyVertical:
    """What trunks say of the up direction."""

    up: Floats
    """(3,) unit vector in the rig's frame."""
    covariance: Floats
    """(2, 2) of its tilt about two directions orthogonal to it: the rows of `basis`."""
    basis: Floats
    """(2, 3)"""


def bodies_in_space(rig: Rig, R: Floats, centre: Floats, observations: Observations, rng: np.random.Generator) -> Bodies | None:
    """All bodies whose joints two cameras or more share; None where none
    are, or where cameras name joints differently.

    Args:
        rig: names and lenses.
        R: (C, 3, 3) world to camera, in the order of `rig`.
        centre: (C, 3) in any unit.
        observations: keypoints with identities.
        rng: draws bodies where there are more than `MOST_BODIES`.
    """
    seen = [(c, keypoints) for c, name in enumerate(rig.names) if len(keypoints := observations[name].keypoints)]
    if not seen or any(one.joints != seen[0][1].joints for _, one in seen):
        return None
    joints = seen[0][1].joints
    camera = np.concatenate([np.full(len(one), c) for c, one in seen])
    identity, frame = (np.concatenate([getattr(one, name) for _, one in seen]) for name in ("identity", "frame"))
    body = group_numbers(identity, frame)
    shared = (np.bincount(body)[body] >= 2) & (identity >= 0)
    numbers = np.unique(body[shared])
    if len(numbers) > MOST_BODIES:
        numbers = np.sort(rng.choice(numbers, MOST_BODIES, replace=False))
    if not len(numbers):
        return None
    place = np.full(int(body.max()) + 1, -1)
    place[numbers] = np.arange(len(numbers))
    rows = np.flatnonzero(place[body] >= 0)
    n, k = len(numbers), len(joints)
    xy, score = (np.concatenate([getattr(one, name) for _, one in seen]) for name in ("xy", "score"))
    row, joint = np.nonzero(score[rows] > MIN_JOINT_SCORE)
    row = rows[row]
    of, point = camera[row], place[body[row]] * k + joint
    bearing = np.zeros((len(row), 3))
    for c, item in enumerate(rig):
        bearing[of == c] = item.lens.bearings(xy[row, joint][of == c])
    points = _triangulated(of, point, bearing, R, centre, n * k)
    first = np.unique(place[body[rows]], return_index=True)[1]
    return Bodies(identity[rows[first]], frame[rows[first]], points.reshape(n, k, 3), joints)


def _triangulated(camera: Ints, point: Ints, bearing: Floats, R: Floats, centre: Floats, n: int) -> Floats:
    """(n, 3) points, NaN where rays are few, miss each other or meet behind a camera."""
    known = np.isfinite(bearing).all(axis=1)
    camera, point, bearing = camera[known], point[known], bearing[known]
    t = -np.einsum("cij,cj->ci", R, centre)
    points = triangulate(camera, point, bearing, R, t, n)
    there = np.isfinite(points[point]).all(axis=1)
    camera, point, bearing = camera[there], point[there], bearing[there]
    off = angular_residuals(in_camera_frames(points, camera, point, R, t), bearing)
    points[point[~(off < MOST_OFF_RAD)]] = np.nan
    return points


def body_scale(bodies: Bodies, height_mean: Floats, height_sd: Floats, people: Ints) -> BodyScale | None:
    """The scale by the lengths of segments; None where there are none, or where they contradict each other.

    Args:
        bodies: in space.
        height_mean: (P,) expected stature, metres.
        height_sd: (P,) its standard deviation, with what all people have in common (`expected_heights`).
        people: (P,) their identities.
    """
    logs = _factors(bodies, height_mean, people)
    who = np.isfinite(logs).any(axis=1)
    if not who.any() or not segments_agree(bodies, height_mean, people):
        return None
    weight = np.where(np.isfinite(logs), 1 / np.array([segment.sd for segment in SEGMENTS]) ** 2, 0.0)[who]
    own = (weight * np.nan_to_num(logs[who])).sum(axis=1) / weight.sum(axis=1)
    information = 1 / ((height_sd[who] / height_mean[who]) ** 2 + PROPORTION_SD**2)
    of_segments = 1 / np.sqrt(np.average(weight.sum(axis=1), weights=information))
    sd = float(np.sqrt(1 / information.sum() + COMMON_SD**2 + of_segments**2))
    return BodyScale(float(np.average(own, weights=information)), sd, int(np.count_nonzero(who)))


def segments_agree(bodies: Bodies, height_mean: Floats, people: Ints) -> bool:
    """Whether no two segments give quite different scales, as they do where joints stand under the names of others.

    Arguments as of `body_scale`.
    """
    logs = _factors(bodies, height_mean, people)
    found = [float(np.nanmedian(column)) for column in logs.T if np.isfinite(column).any()]
    return not found or max(found) - min(found) <= DISAGREE


def _factors(bodies: Bodies, height_mean: Floats, people: Ints) -> Floats:
    """(P, S) logarithms of the scale by each person's segments; NaN where too few were measured."""
    logs = np.full((len(people), len(SEGMENTS)), np.nan)
    for k, segment in enumerate(SEGMENTS):
        lengths = [np.linalg.norm(bodies.at(a) - bodies.at(b), axis=1) for a, b in segment.ends]
        for p, identity in enumerate(people):
            own = np.concatenate([length[bodies.identity == identity] for length in lengths])
            own = own[np.isfinite(own) & (own > 0)]
            if len(own) >= MIN_BODIES:
                logs[p, k] = np.log(segment.share * height_mean[p] / np.median(own))
    return logs


def body_vertical(bodies: Bodies) -> BodyVertical | None:
    """The up direction by trunks; None where there are none.

    A person's trunk leans forwards or backwards by an angle of its own, which is an unknown with a prior: somebody who turns
    tells both, somebody at a desk only what is sideways. Where no line from left to right is known, any way is forwards.
    """
    trunk = bodies.at("shoulders") - bodies.at("hips")
    lines = [_unit(bodies.at(f"left_{part}") - bodies.at(f"right_{part}")) for part in ("shoulder", "hip")]
    left = np.where(np.isfinite(lines[0]), lines[0], lines[1])
    one_sided = not np.isfinite(trunk).any()
    if one_sided:
        sides = [bodies.at(f"{side}_shoulder") - bodies.at(f"{side}_hip") for side in ("left", "right")]
        trunk = np.where(np.isfinite(sides[0]), sides[0], sides[1])
    use = np.isfinite(trunk).all(axis=1)
    turned = use & np.isfinite(left).all(axis=1)
    sided = np.count_nonzero(turned) >= MIN_BODIES and not one_sided
    use = turned if sided else use
    if np.count_nonzero(use) < MIN_BODIES:
        return None
    direction = _unit(trunk[use])
    person, frame = bodies.identity[use], bodies.frame[use]
    up = _unit(direction.mean(axis=0)[None])[0]
    found = None
    for _ in range(10):
        basis = np.linalg.svd(up[None])[2][1:]
        flat = direction @ basis.T
        sideways = _unit(left[use] @ basis.T) if sided else np.tile([0.0, 1.0], (len(flat), 1))
        tilt, covariance = _common_tilt(flat, sideways, SIDEWAYS_SD if sided else LEAN_SD, person, frame)
        up = _unit((up + tilt @ basis)[None])[0]
        found = BodyVertical(up, covariance, basis)
        if np.linalg.norm(tilt) < 1e-5:
            break
    return found


def _common_tilt(flat: Floats, sideways: Floats, sideways_sd: float, person: Ints, frame: Ints) -> tuple[Floats, Floats]:
    """(2,) what trunks lean by in common, and its covariance (2, 2).

    Args:
        flat: (N, 2) trunks as seen along the up direction assumed, radians.
        sideways: (N, 2) unit vectors from right to left, likewise.
        sideways_sd: of a person's mean trunk, radians.
        person: (N,) whose they are.
        frame: (N,) when.
    """
    people, number = np.unique(person, return_inverse=True)
    instant = np.unique(frame, return_inverse=True)[1]
    stretch = group_numbers(number, instant // SAME_POSTURE)
    bent = np.linalg.norm(flat, axis=1) / (BENT_SIGMAS * np.hypot(LEAN_SD, SWAY_SD))
    weight = 1 / ((1 + bent**2) * SWAY_SD**2 * np.bincount(stretch)[stretch])
    forwards = np.column_stack([sideways[:, 1], -sideways[:, 0]])
    size = 2 + 2 * len(people)
    normal, right = np.zeros((size, size)), np.zeros(size)
    for p in range(len(people)):
        own = number == p
        rows = np.zeros((np.count_nonzero(own), 2, size))
        rows[:, :, :2] = np.eye(2)
        rows[:, :, 2 + 2 * p], rows[:, :, 3 + 2 * p] = forwards[own], sideways[own]
        weighted = rows * weight[own, None, None]
        normal += np.einsum("nki,nkj->ij", weighted, rows)
        right += np.einsum("nki,nk->i", weighted, flat[own])
        normal[2 + 2 * p, 2 + 2 * p] += 1 / LEAN_SD**2
        normal[3 + 2 * p, 3 + 2 * p] += 1 / sideways_sd**2
    covariance = np.linalg.inv(normal)
    return np.asarray((covariance @ right)[:2]), np.asarray(covariance[:2, :2], dtype=np.float64)


def ground_below_hips(bodies: Bodies, up: Floats, factor: float, people: Ints, height_mean: Floats) -> float | None:
    """The height of the ground along `up`, metres, as if the highest hips were of people who stand; None without hips.

    Args:
        bodies: in space.
        up: (3,) unit vector.
        factor: metres of the unit of `bodies`.
        people: (P,) identities.
        height_mean: (P,) expected stature, metres.
    """
    sides = np.stack([bodies.at(name) @ up for name in ("hips", "left_hip", "right_hip")])
    hips = factor * np.where(np.isfinite(sides[0]), sides[0], np.where(np.isfinite(sides[1]), sides[1], sides[2]))
    own = [hips[(bodies.identity == identity) & np.isfinite(hips)] for identity in people]
    found = [
        np.quantile(height, STANDING_QUANTILE) - HIP_SHARE * mean
        for height, mean in zip(own, height_mean, strict=True)
        if len(height) >= MIN_BODIES
    ]
    return float(np.quantile(found, STANDING_QUANTILE)) if found else None


def _unit(vectors: Floats) -> Floats:
    """The vectors at length 1; NaN stays."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
