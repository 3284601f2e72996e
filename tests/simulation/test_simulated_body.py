"""The body is as tall as declared, stands on the ground, and moves like one."""

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose
from passerby.simulation.body import JOINTS, SHANK, THIGH, BodyState, body_spheres, pose_joints, stride_length
from passerby.simulation.lenses import looking_at
from passerby.simulation.observe import observe_camera

HEIGHTS = np.array([1.55, 1.72, 1.90])


def state(times=1, **values):
    zero = np.zeros((times, len(HEIGHTS)))
    names = ("heading", "speed", "phase", "jump", "crouch", "lean", "seat", "raised_left", "raised_right", "carry")
    columns = {name: zero + values.get(name, 0.0) for name in names}
    return BodyState(xy=np.zeros((times, len(HEIGHTS), 2)), **columns)


def extent(body):
    """Lowest and highest point, (T, P) metres."""
    centres, radii = body_spheres(pose_joints(body, HEIGHTS), HEIGHTS)
    return (centres[..., 2] - radii).min(axis=2), (centres[..., 2] + radii).max(axis=2)


def test_standing_people_are_exactly_as_tall_as_declared_and_runners_leave_the_ground():
    low, high = extent(state())
    np.testing.assert_allclose(low, 0, atol=1e-9)
    np.testing.assert_allclose(high[0], HEIGHTS, atol=1e-9)
    low, _ = extent(state(200, speed=3.5, phase=np.linspace(0, 2, 200)[:, None]))
    assert (low.max(axis=0) > 0.03).all()
    assert (low > -1e-6).all()


@pytest.mark.parametrize("speed", [0.5, 1.2, 1.6])
def test_walkers_keep_a_foot_on_the_ground_and_bob_by_a_few_centimetres(speed):
    low, high = extent(state(200, speed=speed, phase=np.linspace(0, 3, 200)[:, None]))
    np.testing.assert_allclose(low, 0, atol=1e-6)
    assert (high < HEIGHTS).all()
    assert (high.mean(axis=0) > 0.97 * HEIGHTS).all()
    assert (np.ptp(high, axis=0) < 0.06 * HEIGHTS / 1.55).all()
    if speed >= 1.2:
        assert (np.ptp(high, axis=0) > 0.015).all()


def test_planted_feet_do_not_slide():
    """While the body walks straight at 1.3 m/s, the flat left foot stays where it is."""
    speed, seconds = 1.3, 0.01 * np.arange(150)[:, None]
    phase = seconds * speed / stride_length(np.full(3, speed), HEIGHTS)
    joints = pose_joints(state(150, speed=speed, phase=phase), HEIGHTS)
    toe = joints[:, :, JOINTS.index("left_toe"), 0] + seconds * speed
    for person in range(3):
        share = np.mod(phase[:, person], 1)
        flat = np.flatnonzero((share > 0.1) & (share < 0.3))
        first = np.split(flat, np.flatnonzero(np.diff(flat) > 1) + 1)[0]
        assert len(first) > 5
        assert np.ptp(toe[first, person]) < 1e-6


def test_bones_keep_their_length():
    rng = np.random.default_rng(0)
    body = state(300, speed=rng.uniform(0, 4, (300, 1)), phase=rng.uniform(0, 1, (300, 1)), crouch=rng.uniform(0, 1, (300, 3)),
                 lean=rng.uniform(0, 1.2, (300, 3)), seat=rng.uniform(0, 1, (300, 3)))  # fmt: skip
    joints = pose_joints(body, HEIGHTS)

    def bone(a, b):
        return np.linalg.norm(joints[:, :, JOINTS.index(a)] - joints[:, :, JOINTS.index(b)], axis=-1) / HEIGHTS

    for side in ("left", "right"):
        np.testing.assert_allclose(bone(f"{side}_hip", f"{side}_knee"), THIGH, atol=1e-6)
        np.testing.assert_allclose(bone(f"{side}_knee", f"{side}_ankle"), SHANK, atol=1e-6)


def test_crouching_shortens_a_raised_arm_lengthens_and_knees_point_where_the_body_faces():
    poses = {}, {"crouch": 1.0, "lean": 0.5}, {"crouch": 0.8, "seat": 1.0}, {"raised_right": 1.0}
    standing, squatting, sitting, reaching = (extent(state(**pose))[1] for pose in poses)
    assert (squatting < 0.68 * standing).all()
    assert (sitting < 0.78 * standing).all()
    assert (reaching > 1.15 * standing).all()
    joints = pose_joints(state(heading=np.pi / 2, crouch=0.7), HEIGHTS)
    knees, pelvis = joints[0, :, JOINTS.index("left_knee")], joints[0, :, JOINTS.index("pelvis")]
    assert (knees[:, 1] - pelvis[:, 1] > 0.15).all()
    assert (pose_joints(state(), HEIGHTS)[0, :, JOINTS.index("left_shoulder"), 1] > 0.1).all()


@pytest.mark.parametrize("distortion", [(0.0, 0.0, 0.0, 0.0), (-0.15, 0.0135, 0.0, 0.0)])
def test_boxes_are_tight_around_densely_sampled_spheres(distortion):
    """Against 2,000 points on every sphere's surface, projected one by one."""
    lens = Lens((1400, 1400), np.array([[700.0, 0, 700], [0, 700, 700], [0, 0, 1]]), np.array(distortion))
    centre = np.array([-2.0, -3.0, 2.5])
    camera = Camera("C", lens, Pose.from_centre(looking_at(centre, np.array([0.3, 0.2, 0.9]), 0.1), centre))
    body = state(lean=0.3, crouch=0.2, raised_right=0.6)
    joints = pose_joints(body, HEIGHTS)
    box = observe_camera(camera, joints, HEIGHTS, np.ones((1, 3), dtype=bool), occlusion=False).box[0]
    spheres, radii = body_spheres(joints, HEIGHTS)
    directions = np.random.default_rng(0).standard_normal((2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for person in range(3):
        surface = spheres[0, person][:, None] + radii[person][:, None, None] * directions
        pixels = camera.project(surface.reshape(-1, 3))
        assert (box[person, :2] <= pixels.min(axis=0) + 0.05).all()
        assert (box[person, 2:] >= pixels.max(axis=0) - 0.05).all()
        np.testing.assert_allclose(box[person], [*pixels.min(axis=0), *pixels.max(axis=0)], atol=0.4)
