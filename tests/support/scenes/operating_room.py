"""An operating room as three cameras under its ceiling see it: people at a table, ten keypoints each, no feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.common.arrays import Bools, Floats
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


STEPS, PEOPLE = 120, 8
"""Time steps, some seconds apart, and people, three to five of them in the room at a time."""
NOISE_PX = 2.5
OFFSET = 0.015
"""Of each joint from where anatomy has it, alike for all people, as a share of stature: one sigma along each axis."""
PROPORTION_SD = 0.04
"""By how much a person's joints are off as a share of the segment, one sigma."""
MISSING, HIPS_MISSING = 0.15, 0.5
"""Share of joints, and of hips, that a camera does not find."""


def operating_room(seed: int) -> tuple[Rig, Observations]:
    """The true rig, and what its cameras see of people whose ids hold."""
    rng = np.random.default_rng((seed, 51))
    rig = _cameras(rng)
    joints, present = _people(rng.normal(1.72, 0.09, PEOPLE), rng)
    seen = {}
    for camera in rig:
        time, person = np.nonzero(present)
        points = joints[time, person]
        xy = camera.project(points.reshape(-1, 3)).reshape(len(points), -1, 2)
        xy = xy + NOISE_PX * rng.standard_normal(xy.shape)
        lost = np.where(["hip" in name for name in NAMES], HIPS_MISSING, MISSING)
        found = rng.random(xy.shape[:2]) >= lost
        with np.errstate(invalid="ignore"):
            found &= ((xy > 2) & (xy < np.array(camera.lens.size) - 2)).all(axis=2)
        whole = found.sum(axis=1) >= 3
        score = np.where(found, 0.9, 0.0)
        seen[camera.name] = CameraObservations(
            keypoints=Keypoints(time[whole] + 1, person[whole], np.nan_to_num(xy[whole]), score[whole], NAMES)
        )
    return rig, Observations(seen, 1.0)


def identities_of_one_frame(observations: Observations) -> Observations:
    """The same with ids that hold across cameras in one time step only."""
    renamed = {}
    for name, camera in observations.cameras.items():
        seen = camera.keypoints
        renamed[name] = replace(camera, keypoints=replace(seen, identity=PEOPLE * seen.frame + seen.identity))
    return Observations(renamed, observations.fps)


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


def _people(heights: Floats, rng: np.random.Generator) -> tuple[Floats, Bools]:
    """(T, P, 10, 3) joints as an annotator places them, and (T, P) who is in the room."""
    shape = (STEPS, PEOPLE)
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
    fixed = rng.normal(0, OFFSET, (len(NAMES), 3))
    own = rng.normal(0, 0.5 * OFFSET, (PEOPLE, len(NAMES), 3))
    off = (fixed + own)[None] * heights[None, :, None, None]
    ahead, aside = c * off[..., 0] - s * off[..., 1], s * off[..., 0] + c * off[..., 1]
    joints += np.stack([ahead, aside, np.broadcast_to(off[..., 2], ahead.shape)], axis=-1)
    centre = joints.mean(axis=2, keepdims=True)
    joints = centre + (joints - centre) * (1 + rng.normal(0, PROPORTION_SD, PEOPLE))[None, :, None, None]
    present = np.zeros(shape, dtype=bool)
    for time in range(STEPS):
        present[time, rng.choice(PEOPLE, rng.integers(3, 6), replace=False)] = True
    return joints, present
