"""An articulated human body: joints by a few motion parameters, and spheres by the joints that fill the body.

Lengths are fractions of the standing height, after Drillis and Contini's segment lengths (Winter, *Biomechanics and Motor
Control of Human Movement*, figure 4.1). The standing height reaches from the soles, shoes on, to the top of the head, and a
person who stands straight is exactly that tall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.observations import BODY_17

HIP_HEIGHT = 0.530
TRUNK = 0.288
THIGH = 0.245
SHANK = 0.246
UPPER_ARM = 0.186
FOREARM = 0.146
HAND = 0.055
HEAD_ABOVE_SHOULDERS = 0.127
HEAD_RADIUS = 0.055
HIP_HALF_WIDTH = 0.055
SHOULDER_HALF_WIDTH = 0.105
FOOT_RADIUS = 0.020
ANKLE_HEIGHT = 0.039
TOE_AHEAD = 0.095
HEEL_BEHIND = 0.030
SQUAT_DROP = 0.33

JOINTS = (*BODY_17, "head", "chin", "neck", "chest", "pelvis", "left_hand", "right_hand", "left_toe", "right_toe", "left_heel",
          "right_heel")  # fmt: skip
"""Names of the joints that `pose_joints` returns; the first 17 are COCO's, in COCO's order."""


@dataclass(frozen=True, eq=False)
class BodyState:
    """Motion parameters of P people at T instants; every array is (T, P) unless stated otherwise."""

    xy: Floats
    """(T, P, 2) ground position between the feet, world, metres."""
    heading: Floats
    """Direction of the body's front in the world's x-y plane, radians."""
    speed: Floats
    """Walking speed, metres per second."""
    phase: Floats
    """Number of gait cycles walked so far; a whole number is a left heel strike."""
    jump: Floats
    """Height by which a jump lifts the whole body, metres."""
    crouch: Floats
    lean: Floats
    seat: Floats
    raised_left: Floats
    raised_right: Floats
    carry: Floats


def stride_length(speed: Floats, height: Floats) -> Floats:
    """Compute the length of a gait cycle (two steps), metres: 1.5 m at 1.4 m/s and 2.8 m at 4 m/s for a height of 1.72 m."""
    return np.asarray(0.71 * height * np.power(np.maximum(speed, 0.0), 0.6))


def pose_joints(state: BodyState, heights: Floats) -> Floats:
    """Compute the joints of all people at all instants.

    Args:
        state: motion parameters of T instants and P people.
        heights: (P,) standing heights, metres.

    Returns:
        (T, P, J, 3) joints, world, metres, in the order of `JOINTS`.
    """
    h = np.broadcast_to(heights, state.speed.shape)
    amount = np.clip(stride_length(state.speed, h) / (0.5 * h), 0.0, 1.0)
    run = np.clip((state.speed - 1.8) / 1.2, 0.0, 1.0)
    joints: dict[str, Floats] = {}
    pelvis = _legs(joints, state, h, amount, run)
    _trunk_and_head(joints, state, h, amount, run, pelvis)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        _arm(joints, state, h, amount, run, side, sign)
    local = np.stack([joints[name] for name in JOINTS], axis=2)
    return _move_to_world(local, state)


def _vector(forward: Floats, left: Floats | float, up: Floats) -> Floats:
    """Return vectors (T, P, 3) in the body's frame: x forward, y left, z up."""
    return np.stack([forward, np.broadcast_to(left, forward.shape), up], axis=-1)


def _move_to_world(local: Floats, state: BodyState) -> Floats:
    c, s = np.cos(state.heading)[..., None], np.sin(state.heading)[..., None]
    x = c * local[..., 0] - s * local[..., 1] + state.xy[..., :1]
    y = s * local[..., 0] + c * local[..., 1] + state.xy[..., 1:]
    return np.stack([x, y, local[..., 2] + state.jump[..., None]], axis=-1)


def _foot(state: BodyState, h: Floats, amount: Floats, run: Floats, sign: float) -> tuple[Floats, Floats, Floats]:
    """Compute ankle, toe and heel (T, P, 3) of one side: the foot rolls on the ground in stance and is lifted in swing."""
    stride = stride_length(state.speed, h)
    stance = 0.60 - 0.34 * run
    cycle = np.mod(state.phase + (0.0 if sign > 0 else 0.5), 1.0)
    planted = cycle < stance
    u = np.where(planted, cycle / stance, (cycle - stance) / (1 - stance))
    along = np.where(planted, 0.5 - u, -0.5 * np.cos(np.pi * u)) * stride * stance - 0.07 * stride
    lift = np.where(planted, 0.0, np.sin(np.pi * u)) * h * (0.02 + 0.12 * run) * amount
    roll = np.interp(np.where(planted, u, 1 + u), [0, 0.15, 0.55, 1, 1.4, 2], [-0.25, 0, 0, 0.8, 0.5, -0.25]) * amount
    # A crouching person sets one foot ahead and both apart.
    toe_x = along + (TOE_AHEAD + sign * 0.05 * state.crouch) * h
    toe_z = h * FOOT_RADIUS + lift + np.maximum(0.0, -np.sin(roll)) * (TOE_AHEAD + HEEL_BEHIND) * h
    y = sign * h * (HIP_HALF_WIDTH - 0.02 * amount + 0.05 * state.crouch)
    rise = (ANKLE_HEIGHT - FOOT_RADIUS) * h
    c, s = np.cos(roll), np.sin(roll)
    ankle = _vector(toe_x - TOE_AHEAD * h * c + rise * s, y, toe_z + TOE_AHEAD * h * s + rise * c)
    heel = _vector(toe_x - (TOE_AHEAD + HEEL_BEHIND) * h * c, y, toe_z + (TOE_AHEAD + HEEL_BEHIND) * h * s)
    return ankle, _vector(toe_x, y, toe_z), heel


def _legs(joints: dict[str, Floats], state: BodyState, h: Floats, amount: Floats, run: Floats) -> Floats:
    """Add the feet, the hips as high as both legs reach, and the knees to `joints`; return the pelvis (T, P, 3)."""
    # The hips move back to keep the balance, but less in walking, because the legs would not reach the ground.
    x = -h * (0.10 * state.crouch + 0.14 * state.seat + 0.12 * np.sin(state.lean)) * (1 - 0.8 * amount)
    stride = stride_length(state.speed, h)
    # Legs are never quite straight in gait: at mid-stance the hips are lower than in standing. The head then moves up and down
    # by about 4 cm, as measured.
    cycle = np.mod(state.phase, 1.0)
    bob = 0.02 * h * run * np.cos(4 * np.pi * (cycle - (0.30 - 0.17 * run)))
    z = h * (HIP_HEIGHT - SQUAT_DROP * state.crouch - 0.025 * run) - 0.012 * stride * amount * (1 - run) - bob
    reach = (THIGH + SHANK) * h
    for side, sign in (("left", 1.0), ("right", -1.0)):
        ankle, toe, heel = _foot(state, h, amount, run, sign)
        joints[f"{side}_ankle"], joints[f"{side}_toe"], joints[f"{side}_heel"] = ankle, toe, heel
        flat = (ankle[..., 0] - x) ** 2 + (ankle[..., 1] - sign * HIP_HALF_WIDTH * h) ** 2
        z = np.minimum(z, ankle[..., 2] + np.sqrt(np.maximum(reach**2 - flat, (0.05 * h) ** 2)))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hip = _vector(x, sign * HIP_HALF_WIDTH * h, z)
        joints[f"{side}_hip"] = hip
        joints[f"{side}_knee"] = _knee(hip, joints[f"{side}_ankle"], h, sign, state.crouch)
    joints["pelvis"] = _vector(x, 0.0, z)
    return joints["pelvis"]


def _knee(hip: Floats, ankle: Floats, h: Floats, sign: float, crouch: Floats) -> Floats:
    """Compute the knee by two-link inverse kinematics: it bends forward, and a little outwards in a crouch."""
    thigh, shank = THIGH * h, SHANK * h
    leg = ankle - hip
    length = np.clip(np.linalg.norm(leg, axis=-1), 0.02 * h, thigh + shank)
    axis = leg / np.maximum(np.linalg.norm(leg, axis=-1), 1e-9)[..., None]
    along = (thigh**2 - shank**2 + length**2) / (2 * length)
    aside = np.sqrt(np.maximum(thigh**2 - along**2, 0.0))
    front = _vector(np.ones_like(h), sign * 0.35 * crouch, 0.3 * np.ones_like(h))
    front = front - np.sum(front * axis, axis=-1, keepdims=True) * axis
    front = front / np.linalg.norm(front, axis=-1, keepdims=True)
    return np.asarray(hip + along[..., None] * axis + aside[..., None] * front)


def _trunk_and_head(
    joints: dict[str, Floats], state: BodyState, h: Floats, amount: Floats, run: Floats, pelvis: Floats
) -> None:
    lean = state.lean + 0.03 * amount + 0.12 * run
    up = _vector(np.sin(lean), 0.0, np.cos(lean))
    neck_up = _vector(np.sin(0.5 * lean), 0.0, np.cos(0.5 * lean))
    chest = pelvis + (TRUNK * h)[..., None] * up
    head = chest + (HEAD_ABOVE_SHOULDERS * h)[..., None] * neck_up
    joints["chest"], joints["head"] = chest, head
    joints["neck"] = chest + (0.05 * h)[..., None] * neck_up
    zero = np.zeros_like(h)
    joints["chin"] = head + _vector(0.012 * h, 0.0, -0.035 * h)
    joints["nose"] = head + _vector(0.056 * h, 0.0, -0.008 * h)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        joints[f"{side}_eye"] = head + _vector(0.048 * h, sign * 0.018 * h, 0.010 * h)
        joints[f"{side}_ear"] = head + _vector(zero, sign * 0.045 * h, zero)
        joints[f"{side}_shoulder"] = chest + _vector(zero, sign * SHOULDER_HALF_WIDTH * h, zero)


def _arm(joints: dict[str, Floats], state: BodyState, h: Floats, amount: Floats, run: Floats, side: str, sign: float) -> None:
    """Add elbow, wrist and hand: a swing against the leg of the same side, blended with work, carrying and a raised arm."""
    cycle = state.phase + (0.0 if sign > 0 else 0.5)
    shoulder = 0.03 - (0.40 + 0.35 * run) * amount * np.cos(2 * np.pi * cycle)
    elbow = 0.15 + 0.25 * amount + 1.1 * run
    outwards = np.full_like(h, 0.12)
    raised = state.raised_left if sign > 0 else state.raised_right
    for weight, angle, bend, aside in (
        (np.clip(state.crouch + state.lean - 0.1, 0, 1), 0.7, 0.5, 0.0),
        (state.carry, 0.35, 1.25, 0.1),
        (raised, 2.9, 0.2, 0.1),
    ):
        shoulder = (1 - weight) * shoulder + weight * angle
        elbow = (1 - weight) * elbow + weight * bend
        outwards = (1 - weight) * outwards + weight * aside
    bent = shoulder + elbow
    upper = _unit(_vector(np.sin(shoulder), sign * outwards, -np.cos(shoulder)))
    lower = _unit(_vector(np.sin(bent), sign * (outwards - 0.15), -np.cos(bent)))
    joints[f"{side}_elbow"] = joints[f"{side}_shoulder"] + (UPPER_ARM * h)[..., None] * upper
    joints[f"{side}_wrist"] = joints[f"{side}_elbow"] + (FOREARM * h)[..., None] * lower
    joints[f"{side}_hand"] = joints[f"{side}_wrist"] + (HAND * h)[..., None] * lower


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _sphere_table() -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Return the spheres along the limbs: indices of the limb's two joints, place between them (0 to 1), radius; (S,) each."""
    limbs = [
        ("head", "head", 1, HEAD_RADIUS, HEAD_RADIUS),
        ("chin", "chin", 1, 0.045, 0.045),
        ("neck", "neck", 1, 0.032, 0.032),
        ("chest", "pelvis", 5, 0.055, 0.065),
    ]
    for side in ("left", "right"):
        limbs += [
            (f"{side}_shoulder", f"{side}_hip", 5, 0.035, 0.050),
            (f"{side}_shoulder", f"{side}_elbow", 4, 0.032, 0.025),
            (f"{side}_elbow", f"{side}_wrist", 4, 0.024, 0.018),
            (f"{side}_hand", f"{side}_hand", 1, 0.026, 0.026),
            (f"{side}_hip", f"{side}_knee", 5, 0.052, 0.036),
            (f"{side}_knee", f"{side}_ankle", 5, 0.034, 0.022),
            (f"{side}_heel", f"{side}_toe", 3, FOOT_RADIUS, FOOT_RADIUS),
        ]
    rows = [
        (JOINTS.index(first), JOINTS.index(last), place, start + place * (end - start))
        for first, last, count, start, end in limbs
        for place in (np.linspace(0, 1, count) if count > 1 else np.zeros(1))
    ]
    first, last, places, radii = zip(*rows, strict=True)
    return np.array(first), np.array(last), np.array(places, dtype=np.float64), np.array(radii, dtype=np.float64)


SPHERES = _sphere_table()


def body_spheres(joints: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """Compute the spheres that fill the bodies.

    Args:
        joints: (T, P, J, 3) from `pose_joints`.
        heights: (P,) standing heights, metres.

    Returns:
        (T, P, S, 3) centres in the world, metres; (P, S) radii, metres.
    """
    first, last, places, radii = SPHERES
    centres = joints[:, :, first] + places[:, None] * (joints[:, :, last] - joints[:, :, first])
    return centres, heights[:, None] * radii
