"""An operating room as three cameras under its ceiling see it: people at a table, ten keypoints each, no feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import CameraObservations, Keypoints, Observations
from passerby.simulation.body import JOINTS, BodyState, pose_joints
from support.scenes.people_and_rigs import looking_at

LENS = Lens((640, 480), np.array([[540.0, 0.0, 320.0], [0.0, 540.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5))
NAMES = (
    "head", "neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip", "left_elbow", "right_elbow", "left_wrist",
    "right_wrist",
)  # fmt: skip
STANDING, LEANING, SEATED = range(3)


@dataclass(frozen=True, kw_only=True)
class Room:
    """What is simulated, and how well it is seen."""

    steps: int = 120
    """Time steps, some seconds apart."""
    people: int = 8
    """Of whom three to five are in the room at a time."""
    noise_px: float = 2.5
    offset: float = 0.015
    """Of each joint from where anatomy has it, alike for all people, as a share of stature: one sigma along each axis."""
    proportion_sd: float = 0.04
    """By how much a person's joints are off as a share of the segment, one sigma."""
    missing: float = 0.15
    """Share of joints that a camera does not find."""
    hips_missing: float = 0.5
    """Share of hips likewise."""


def operating_room(seed: int, room: Room | None = None) -> tuple[Rig, Observations, Floats]:
    """The true rig, what its cameras see of people whose ids hold, and the people's statures (P,), metres."""
    room, rng = room or Room(), np.random.default_rng((seed, 51))
    rig = _cameras(rng)
    heights = rng.normal(1.72, 0.09, room.people)
    joints, present = _people(room, heights, rng)
    seen = {}
    for camera in rig:
        time, person = np.nonzero(present)
        points = joints[time, person]
        xy = camera.project(points.reshape(-1, 3)).reshape(len(points), -1, 2)
        xy = xy + room.noise_px * rng.standard_normal(xy.shape)
        lost = np.where(["hip" in name for name in NAMES], room.hips_missing, room.missing)
        found = rng.random(xy.shape[:2]) >= lost
        with np.errstate(invalid="ignore"):
            found &= ((xy > 2) & (xy < np.array(camera.lens.size) - 2)).all(axis=2)
        whole = found.sum(axis=1) >= 3
        score = np.where(found, 0.9, 0.0)
        seen[camera.name] = CameraObservations(
            keypoints=Keypoints(time[whole] + 1, person[whole], np.nan_to_num(xy[whole]), score[whole], NAMES)
        )
    return rig, Observations(seen, 1.0), heights


def identities_of_one_frame(observations: Observations, *, unique: bool) -> Observations:
    """The same with ids that hold across cameras in one time step only: never used again, or beginning at 0 in each."""
    seen = [one.keypoints for one in observations.cameras.values()]
    keys = np.unique(np.concatenate([np.column_stack([one.frame, one.identity]) for one in seen]), axis=0)
    first = np.searchsorted(keys[:, 0], keys[:, 0])
    numbers = np.arange(len(keys)) if unique else np.arange(len(keys)) - first
    number_of = {(int(frame), int(identity)): int(number) for (frame, identity), number in zip(keys, numbers, strict=True)}

    def renumbered(keypoints: Keypoints) -> Ints:
        return np.array([number_of[int(f), int(i)] for f, i in zip(keypoints.frame, keypoints.identity, strict=True)])

    return Observations(
        {
            name: CameraObservations(
                keypoints=Keypoints(
                    one.keypoints.frame, renumbered(one.keypoints), one.keypoints.xy, one.keypoints.score, one.keypoints.joints
                )
            )
            for name, one in observations.cameras.items()
        },
        observations.fps,
    )


def _cameras(rng: np.random.Generator) -> Rig:
    """Three cameras under the ceiling at two sides of the table, tilted down by 40 to 55 degrees."""
    cameras = []
    for number, angle in enumerate((0.3, 1.9, 3.4)):
        angle += rng.uniform(-0.3, 0.3)
        reach = rng.uniform(1.8, 2.4)
        centre = (reach * np.cos(angle), reach * np.sin(angle), rng.uniform(2.6, 2.9))
        target = (*rng.uniform(-0.3, 0.3, 2), rng.uniform(0.8, 1.1))
        cameras.append(Camera(f"C{number + 1}", LENS, looking_at(centre, target)))
    return Rig(tuple(cameras))


def _people(room: Room, heights: Floats, rng: np.random.Generator) -> tuple[Floats, Bools]:
    """(T, P, 10, 3) joints as an annotator places them, and (T, P) who is in the room."""
    shape = (room.steps, room.people)
    posture = rng.choice(3, shape, p=(0.45, 0.45, 0.1))
    around = rng.uniform(-np.pi, np.pi, shape)
    away = np.where(posture == LEANING, rng.uniform(0.55, 0.8, shape), rng.uniform(0.7, 1.5, shape))
    xy = np.stack([1.4 * away * np.cos(around), away * np.sin(around)], axis=-1)
    leans = posture == LEANING
    heading = around + np.pi + np.where(leans, rng.normal(0, 0.2, shape), rng.normal(0, 1.0, shape))
    lean = np.where(leans, rng.uniform(0.15, 0.6, shape), rng.normal(0.05, 0.08, shape))
    zero = np.zeros(shape)
    state = BodyState(
        xy=xy, heading=heading, speed=zero, phase=zero, jump=zero,
        crouch=np.where(posture == SEATED, 0.5, 0.0), lean=lean, seat=np.where(posture == SEATED, 1.0, 0.0),
        raised_left=0.3 * rng.random(shape), raised_right=0.3 * rng.random(shape),
        carry=np.where(leans, rng.uniform(0.5, 1.0, shape), rng.uniform(0.0, 1.0, shape)),
    )  # fmt: skip
    every = pose_joints(state, heights)
    joints = every[:, :, [JOINTS.index(name) for name in NAMES]].copy()
    head = joints[:, :, 0]
    joints[:, :, 0] = head + 0.4 * (head - joints[:, :, 1])  # the upper head
    # Offsets turn with the body: forwards, to the left, up.
    c, s = np.cos(heading)[..., None], np.sin(heading)[..., None]
    fixed = rng.normal(0, room.offset, (len(NAMES), 3))
    own = rng.normal(0, 0.5 * room.offset, (room.people, len(NAMES), 3))
    off = (fixed + own)[None] * heights[None, :, None, None]
    ahead, aside = c * off[..., 0] - s * off[..., 1], s * off[..., 0] + c * off[..., 1]
    joints += np.stack([ahead, aside, np.broadcast_to(off[..., 2], ahead.shape)], axis=-1)
    centre = joints.mean(axis=2, keepdims=True)
    joints = centre + (joints - centre) * (1 + rng.normal(0, room.proportion_sd, room.people))[None, :, None, None]
    present = np.zeros(shape, dtype=bool)
    for time in range(room.steps):
        present[time, rng.choice(room.people, rng.integers(3, 6), replace=False)] = True
    return joints, present
