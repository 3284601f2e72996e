"""People who move but stay where they are: boxes and joints as cameras around them see them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import BODY_17, Boxes, CameraObservations, Keypoints
from passerby.simulation.body import BodyState, pose_joints
from passerby.simulation.observe import observe_camera

SIZE = (1280, 960)


def ring(n: int, rng: np.random.Generator, *, reach_m: float = 4.5, height_m: float = 1.8) -> Rig:
    """Cameras around the origin, looking at a body's middle there, all turned about their axis a little."""
    lens = Lens(SIZE, np.array([[1000.0, 0.0, 640.0], [0.0, 1000.0, 480.0], [0.0, 0.0, 1.0]]), np.zeros(5))
    cameras = []
    for number in range(n):
        angle = 2 * np.pi * (number + rng.uniform(-0.2, 0.2)) / n
        centre = np.array([reach_m * np.cos(angle), reach_m * np.sin(angle), height_m + rng.uniform(-0.4, 0.6)])
        forward = np.array([0.0, 0.0, 0.9]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        roll = rng.uniform(-0.2, 0.2)
        axes = np.array([right, np.cross(forward, right)])
        axes = np.array([[np.cos(roll), np.sin(roll)], [-np.sin(roll), np.cos(roll)]]) @ axes
        cameras.append(Camera(f"C{number + 1}", lens, Pose.from_centre(np.vstack([axes, forward]), centre)))
    return Rig(tuple(cameras))


def moving_on_spot(places: Floats, seconds: float, fps: float, rng: np.random.Generator, *, moving: float = 1.0) -> Floats:
    """(T, P, J, 3) joints of people who wave, bend and turn about where they stand; still where `moving` is 0."""
    n_times, n_people = round(seconds * fps), len(places)
    at = np.arange(n_times) / fps
    knots = np.arange(0.0, seconds + 1.2, 0.6)

    def wandering(low: float, high: float) -> Floats:
        mean = rng.uniform(low, high, n_people)
        values = mean + moving * (rng.uniform(low, high, (len(knots), n_people)) - mean)
        return np.stack([np.interp(at, knots, column) for column in values.T], axis=1)

    zero = np.zeros((n_times, n_people))
    state = BodyState(
        xy=np.stack([places[:, k] + wandering(-0.1, 0.1) for k in (0, 1)], axis=-1),
        heading=rng.uniform(-np.pi, np.pi, n_people) + wandering(-0.3, 0.3), speed=zero, phase=zero, jump=zero,
        crouch=wandering(0.0, 0.3), lean=wandering(0.0, 0.3), seat=zero, raised_left=wandering(0.0, 1.0),
        raised_right=wandering(0.0, 1.0), carry=wandering(0.0, 0.5),
    )  # fmt: skip
    return pose_joints(state, rng.uniform(1.6, 1.85, n_people))


def seen(
    camera: Camera, joints: Floats, rng: np.random.Generator, *, noise: float = 0.015, exchanged: bool = False
) -> CameraObservations:
    """Boxes and joints of people (T, P, J, 3) in one camera, noise a share of their height; ids are the camera's own."""
    n_times, n_people = joints.shape[:2]
    shown = observe_camera(camera, joints, np.full(n_people, 1.72), np.ones((n_times, n_people), dtype=np.bool_))
    time, person = np.nonzero(shown.inside > 0.95)
    box = shown.box[time, person]
    height = box[:, 3] - box[:, 1]
    box = box + 0.01 * height[:, None] * rng.standard_normal(box.shape)
    numbers = rng.permutation(n_people)[person]
    ltwh = np.column_stack([box[:, :2], box[:, 2:] - box[:, :2]])
    xy = shown.joints[time, person]
    xy = xy + noise * height[:, None, None] * rng.standard_normal(xy.shape)
    found = Keypoints(time + 1, numbers, xy, 0.8 * shown.joint_visible[time, person])
    if exchanged:
        order = [BODY_17.index(_other_side(name)) for name in BODY_17]
        found = replace(found, xy=xy[:, order], score=found.score[:, order])
    return CameraObservations(Boxes(time + 1, numbers, ltwh, np.ones(len(time))), found)


def _other_side(name: str) -> str:
    if name.startswith("left"):
        return name.replace("left", "right", 1)
    return name.replace("right", "left", 1)
