"""Images turned by quarter turns: what a camera projects turns with them."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma
from passerby.core.observations import Boxes
from passerby.core.quarter_turns import turn_boxes, turn_camera, turn_lens, turn_pixels
from passerby.geometry.rotations import exp_rotation

PINHOLE = (-0.21, 0.07, 0.003, -0.004, 0.01, 0.02, -0.01, 0.004, 0.002, -0.001, 0.003, 0.0015)
FISHEYE = (0.02, -0.01, 0.004, -0.001)
MATRIX = [[880.0, 0.0, 652.0], [0.0, 910.0, 344.0], [0.0, 0.0, 1.0]]
POSE = Pose(exp_rotation(np.array([1.7, -0.6, 0.5])), np.array([0.4, 1.0, 9.0]))
TURNS = (90, 180, 270)


def camera(fisheye: bool, rotate: int = 0) -> Camera:
    lens = Lens((1280, 720), np.array(MATRIX), np.array(FISHEYE if fisheye else PINHOLE), fisheye, rotate=rotate)
    covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) + 0.1
    return Camera("A", lens, POSE, PoseSigma.from_covariance(covariance))


@pytest.mark.parametrize("degrees", TURNS)
def test_the_turned_camera_sees_points_and_boxes_where_the_turned_image_shows_them(degrees):
    points = np.random.default_rng(0).uniform((-2, -2, 0), (2, 2, 2), (200, 3))
    for before in (camera(False), camera(True)):
        seen = before.project(points)
        assert np.isfinite(seen).all()
        found = turn_camera(before, degrees).project(points)
        assert np.allclose(found, turn_pixels(seen, before.lens.size, degrees), atol=1e-9)
    turned = np.rot90(image := np.arange(12).reshape(3, 4), -degrees // 90)
    v, u = np.mgrid[:3, :4]
    there = turn_pixels(np.stack([u, v], axis=-1).astype(float), (4, 3), degrees).astype(int)
    assert (turned[there[..., 1], there[..., 0]] == image).all()
    boxes = Boxes(np.array([1]), np.array([2]), np.array([[100.0, 50.0, 40.0, 160.0]]), np.array([0.9]))
    corners = turn_pixels(np.array([[100.0, 50.0], [140.0, 210.0]]), (1280, 720), degrees)
    (left, top, width, height) = turn_boxes(boxes, (1280, 720), degrees).ltwh[0]
    assert np.allclose([left, top, left + width, top + height], [*corners.min(axis=0), *corners.max(axis=0)])


@pytest.mark.parametrize("degrees", TURNS)
def test_the_covariance_turns_with_the_camera_and_back(degrees):
    before = camera(False, rotate=degrees)
    upright = turn_camera(before, degrees)
    back = turn_camera(upright, -degrees)
    assert (upright.lens.rotate, back.lens.rotate, back.lens.size) == (0, degrees, before.lens.size)
    assert np.allclose(back.sigma.covariance, before.sigma.covariance)
    before = camera(False)
    after, vector = turn_camera(before, degrees), np.array([0.01, -0.02, 0.03])
    moved = turn_camera(Camera("A", before.lens, Pose(exp_rotation(vector) @ POSE.R_cw, POSE.t_cw)), degrees)
    axes = after.pose.R_cw @ before.pose.R_cw.T
    assert np.allclose(moved.pose.R_cw @ after.pose.R_cw.T, exp_rotation(axes @ vector))
    assert np.allclose(after.sigma.covariance[3:, 3:], axes @ before.sigma.covariance[3:, 3:] @ axes.T)


@pytest.mark.parametrize("degrees", TURNS)
def test_positions_on_the_ground_are_as_uncertain_by_the_turned_camera(degrees):
    """With the uncertainty of the intrinsics, and what it has in common with that of the pose."""
    root = np.random.default_rng(2).normal(size=(10, 10)) * [*3 * [0.02], *3 * [0.003], 0.004, 2.0, 3.0, 0.01]
    complete = root.T @ root
    before = replace(camera(False), sigma=PoseSigma.from_covariance(complete[:6, :6], complete))
    pixels = before.project(np.random.default_rng(3).uniform((-2, -2, 0), (2, 2, 0), (20, 3)))
    expected = before.ground(pixels).covariance
    found = turn_camera(before, degrees).ground(turn_pixels(pixels, before.lens.size, degrees)).covariance
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)


def test_what_no_lens_model_expresses_is_an_error():
    skewed = Lens((1280, 720), np.array([[900.0, 2.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]), np.zeros(5))
    with pytest.raises(InputError, match="skew"):
        turn_lens(skewed, 90)
    with pytest.raises(InputError, match="rotate is 45"):
        Lens((1280, 720), np.array(MATRIX), np.zeros(5), rotate=45)
