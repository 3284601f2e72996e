"""Motion of people: episodes of activities, paths between random waypoints, and the body's parameters at any time."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.simulation.body import BodyState, stride_length
from passerby.simulation.options import MAX_CLOCK_OFFSET_S, Activity, Preset

STEP_S = 0.04
PAD_S = MAX_CLOCK_OFFSET_S + 1.0
SMOOTHING_S = 0.22
PERSONAL_SPACE_M = 0.7
MARGIN_M = 0.3
GRAVITY = 9.81
POSTURES = ("crouch", "lean", "seat", "raised_left", "raised_right", "carry")


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of P people on a fine grid of times."""

    times: Floats
    """(K,) seconds."""
    state: BodyState
    """Parameters at the K times."""
    present_from: Floats
    """(P,) time at which each person enters the area, seconds; minus infinity: present from the start."""

    def at(self, times: Floats) -> tuple[BodyState, NDArray[np.bool_]]:
        """Interpolate body parameters and presence (T, P) linearly at any times (T,) within the grid."""
        place = (np.asarray(times) - self.times[0]) / STEP_S
        before = np.clip(np.floor(place).astype(np.int64), 0, len(self.times) - 2)
        weight = place - before
        values = {}
        for item in fields(BodyState):
            column = getattr(self.state, item.name)
            w = weight.reshape(-1, *(1,) * (column.ndim - 1))
            values[item.name] = (1 - w) * column[before] + w * column[before + 1]
        return BodyState(**values), np.asarray(times)[:, None] >= self.present_from


@dataclass(frozen=True, eq=False)
class _Schedule:
    """Intended motion of a person at each of the K times."""

    speed: Floats
    jump: Floats
    postures: Floats
    """(6, K), in the order of `POSTURES`."""


def simulate_motion(preset: Preset, heights: Floats, seconds: float, rng: np.random.Generator) -> Motion:
    """Simulate the motion of people in the preset's area from `PAD_S` before time 0 to `PAD_S` after `seconds`.

    Args:
        preset: area and activities.
        heights: (P,) standing heights, metres; the stride length grows with them.
        seconds: length of the scene.
        rng: each person uses a child of it.
    """
    times = np.arange(-PAD_S, seconds + PAD_S + STEP_S, STEP_S)
    people = rng.spawn(len(heights))
    half = np.asarray(preset.area_m) / 2 - MARGIN_M
    entry = np.array([_entry_time(preset, seconds, person) for person in people])
    starts = np.stack([_start(half, bool(np.isfinite(t)), person) for t, person in zip(entry, people, strict=True)])
    schedules = [_draw_schedule(preset.activities, times, person) for person in people]
    targets = np.stack([_smooth(schedule.speed) for schedule in schedules], axis=1)
    targets[times[:, None] < entry] = 0.0
    xy, heading = _walk(starts, targets, times[:, None] >= entry, half, people)
    velocity = np.gradient(xy, STEP_S, axis=0)
    speed = np.stack([_smooth(column) for column in np.linalg.norm(velocity, axis=-1).T], axis=1)
    speed = np.where(speed < 0.05, 0.0, speed)
    stride = stride_length(speed, heights)
    cadence = np.where(speed > 0, speed / np.maximum(stride, 1e-9), 0.0)
    phase = np.cumsum(cadence, axis=0) * STEP_S + np.array([person.uniform() for person in people])
    postures = np.stack([[_smooth(channel) for channel in schedule.postures] for schedule in schedules], axis=-1)
    state = BodyState(
        xy=xy,
        heading=heading,
        speed=speed,
        phase=phase,
        jump=np.stack([schedule.jump for schedule in schedules], axis=1),
        **{name: postures[row] for row, name in enumerate(POSTURES)},
    )
    return Motion(times, state, entry)


def _entry_time(preset: Preset, seconds: float, rng: np.random.Generator) -> float:
    """Draw the time at which a person enters, seconds; minus infinity for a person who is present from the start."""
    late, when = rng.uniform(), rng.uniform(0.0, 0.4)
    return float(when * seconds) if late < preset.entering else -np.inf


def _start(half: Floats, at_edge: bool, rng: np.random.Generator) -> Floats:
    """Draw the start of a person: anywhere, or on the edge of the area for a person who enters later."""
    place = rng.uniform(-1, 1, 2) * half
    axis, sign = int(rng.integers(2)), float(rng.choice((-1.0, 1.0)))
    if at_edge:
        place[axis] = sign * half[axis]
    return place


def _draw_schedule(activities: tuple[Activity, ...], times: Floats, rng: np.random.Generator) -> _Schedule:
    """Draw consecutive episodes; each activity takes, on average, the share of the time that the preset states."""
    weights = np.array([activity.share / np.mean(activity.seconds) for activity in activities])
    speed, jump, postures = np.zeros(len(times)), np.zeros(len(times)), np.zeros((len(POSTURES), len(times)))
    start = 0
    while start < len(times):
        activity = activities[int(rng.choice(len(activities), p=weights / weights.sum()))]
        end = start + max(1, round(rng.uniform(*activity.seconds) / STEP_S))
        speed[start:end] = rng.uniform(*activity.speed)
        raised = rng.uniform(*activity.raised)
        values = (rng.uniform(*activity.crouch), rng.uniform(*activity.lean), rng.uniform(*activity.seat),
                  raised if activity.both_arms else 0.0, raised, rng.uniform(*activity.carry))  # fmt: skip
        postures[:, start:end] = np.array(values)[:, None]
        if activity.jump[1] > 0:
            _add_jumps(jump, postures[0], start, min(end, len(times)), activity, rng)
        start = end
    return _Schedule(speed, jump, postures)


def _add_jumps(jump: Floats, crouch: Floats, start: int, end: int, activity: Activity, rng: np.random.Generator) -> None:
    """Add ballistic jumps within [start, end), each with bent knees before take-off and after landing."""
    bend = round(0.3 / STEP_S)
    begin = start + round(0.5 / STEP_S)
    while True:
        height = rng.uniform(*activity.jump)
        take_off = np.sqrt(2 * GRAVITY * height)
        flight = int(2 * take_off / GRAVITY / STEP_S) + 1
        if begin + flight + 2 * bend > end:
            return
        t = np.arange(flight) * STEP_S
        crouch[begin : begin + bend] = 0.3
        jump[begin + bend : begin + bend + flight] = np.maximum(take_off * t - 0.5 * GRAVITY * t * t, 0.0)
        crouch[begin + bend + flight : begin + flight + 2 * bend] = 0.3
        begin += flight + 2 * bend + round(rng.uniform(0.8, 2.0) / STEP_S)


def _smooth(values: Floats) -> Floats:
    """Smooth with a Gaussian of sigma `SMOOTHING_S` and constant ends, because joints need time to move."""
    reach = round(4 * SMOOTHING_S / STEP_S)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP_S / SMOOTHING_S) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), kernel / kernel.sum(), mode="valid")


def _walk(
    starts: Floats, targets: Floats, there: NDArray[np.bool_], half: Floats, people: list[np.random.Generator]
) -> tuple[Floats, Floats]:
    """Steer all people from waypoint to waypoint; they turn in curves and step aside for each other.

    Args:
        starts: (P, 2) metres.
        targets: (K, P) intended speeds, metres per second.
        there: (K, P) whether a person is in the area, so that others step aside.
        half: (2,) half extent of the walkable area, metres.
        people: one generator per person.

    Returns:
        (K, P, 2) positions, metres; (K, P) headings, radians, continuous.
    """
    n_steps, n_people = targets.shape
    waypoints = np.stack([person.uniform(-1, 1, (n_steps // 20 + 2, 2)) for person in people]) * half
    visited, everyone = np.zeros(n_people, dtype=np.int64), np.arange(n_people)
    xy, heading = np.empty((n_steps, n_people, 2)), np.empty((n_steps, n_people))
    towards = waypoints[:, 0] - starts
    xy[0], heading[0], speed = starts, np.arctan2(towards[:, 1], towards[:, 0]), np.zeros(n_people)
    for k in range(n_steps - 1):
        towards = waypoints[everyone, visited] - xy[k]
        reached = np.hypot(towards[:, 0], towards[:, 1]) < 0.6
        visited = np.minimum(visited + reached, waypoints.shape[1] - 1)
        error = np.arctan2(towards[:, 1], towards[:, 0]) - heading[k]
        error = (error + np.pi) % (2 * np.pi) - np.pi
        speed += np.clip(targets[k] * np.maximum(0.25, np.cos(error)) - speed, -3.0 * STEP_S, 2.0 * STEP_S)
        heading[k + 1] = heading[k] + np.clip(2.5 * error, -2.0, 2.0) * np.minimum(1.0, speed / 0.4) * STEP_S
        direction = np.stack([np.cos(heading[k + 1]), np.sin(heading[k + 1])], axis=1)
        aside = _step_aside(xy[k], there[k])
        xy[k + 1] = np.clip(xy[k] + (speed[:, None] * direction + aside) * STEP_S, -half, half)
    return xy, heading


def _step_aside(xy: Floats, there: NDArray[np.bool_]) -> Floats:
    """Compute velocities (P, 2), metres per second, away from people who are nearer than `PERSONAL_SPACE_M`."""
    apart = xy[:, None] - xy[None]
    distance = np.hypot(apart[..., 0], apart[..., 1])
    near = (distance < PERSONAL_SPACE_M) & (distance > 1e-6) & there[:, None] & there
    strength = np.where(near, 1.2 * (1 - distance / PERSONAL_SPACE_M), 0.0)
    return np.asarray(np.sum(strength[..., None] * apart / np.maximum(distance, 1e-6)[..., None], axis=1))
