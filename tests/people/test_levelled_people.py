"""The level of a rolled camera from the boxes of people, which do not show how they lean."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera
from passerby.core.observations import Boxes, CameraObservations, Clock
from passerby.core.pose import Pose
from passerby.geometry.rotations import direction_angle, exp_rotation
from passerby.people.level import level_from_people, levelled_people
from passerby.people.sightings import upright_sightings
from passerby.simulation.body import pose_joints
from passerby.simulation.observe import observe_camera
from support.scenes.people_and_rigs import simulated

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def filmed():
    return simulated("basketball", seconds=24.0)


def rolled(scene, name, degrees):
    """A camera of a scene, rolled about its viewing direction, with tight boxes of the people in its image."""
    camera = scene.rig[name]
    turn = exp_rotation(np.array([0.0, 0.0, np.deg2rad(degrees)]))
    camera = Camera(name, camera.lens, Pose(turn @ camera.pose.R_cw, turn @ camera.pose.t_cw))
    state, present = scene.motion.at((scene.frames - 1) / scene.options.fps)
    heights = np.array([scene.heights[one] for one in scene.identities.tolist()])
    view = observe_camera(camera, pose_joints(state, heights), heights, present, occlusion=False)
    time, who = np.nonzero((view.inside > 0.99) & ~view.clipped.any(axis=-1))
    corners = view.box[time, who]
    ltwh = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    return camera, Boxes(time + 1, np.full(len(time), -1), ltwh, np.ones(len(time)))


@pytest.mark.parametrize("degrees", [-45, 18, 45])
def test_the_vertical_of_a_rolled_camera_is_found(filmed, degrees):
    camera, boxes = rolled(filmed, "C2", degrees)
    bodies, level = levelled_people(
        CameraObservations(boxes), camera.lens, Clock(5.0), filmed.options.person_height_mean_m, np.random.default_rng(0)
    )
    assert np.rad2deg(direction_angle(level.up, camera.pose.R_cw @ UP)) < 4.0
    assert level.height == pytest.approx(camera.pose.centre[2], rel=0.15)
    feet = bodies.bottom @ level.R_lc.T
    assert (feet[:, 2] < 0).all()


def test_an_upright_camera_is_levelled_as_by_its_boxes_alone(filmed):
    camera, boxes = rolled(filmed, "C2", 0)
    seen, clock = CameraObservations(boxes), Clock(5.0)
    _, level = levelled_people(seen, camera.lens, clock, 1.72, np.random.default_rng(3))
    plain = level_from_people(upright_sightings(seen, camera.lens, clock), 1.72, np.random.default_rng(3))
    assert (level.up == plain.up).all()
    assert level.height == plain.height


def test_too_few_people_have_no_level(filmed):
    camera, boxes = rolled(filmed, "C2", 25)
    few = replace(boxes.take(np.arange(5)))
    assert levelled_people(CameraObservations(few), camera.lens, Clock(5.0), 1.72, np.random.default_rng(0))[1] is None
