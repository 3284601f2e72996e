"""Formats that go from pixels to the ground: homographies, and zones of Frigate with their distances."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import frigate
from support.scenes.handmade_rigs import SIZE, facing, written

GROUND = np.array([[4.0, 5.0], [2.0, 9.0], [7.0, 14.0], [4.0, 40.0]])
SKEW = np.array([[0.0, 30, 0], [0, 0, 0], [0, 0, 0]])


def skewed(distortions=(), fisheye=False):
    straight = facing("north", distortions=distortions, fisheye=fisheye)
    return replace(straight, lens=replace(straight.lens, matrix=straight.lens.matrix + SKEW))


@pytest.mark.parametrize(("camera", "rtol"), [
    (facing("north"), 1e-4), (facing("north", distortions=(-0.2, 0.05, 0.001, -0.002)), 1e-4),
    (facing("north", distortions=(0.03, -0.01, 0, 0), fisheye=True), 1e-4),
    # OpenCV takes no skew from the matrix, so that the homographies have to hold it.
    (skewed(), 1e-9),
])  # fmt: skip
def test_opencv_gets_from_pixels_to_the_ground_and_back(tmp_path, camera, rtol):
    rig = Rig((replace(camera, name="a: \u00fc"),))
    assert written("homography", rig, tmp_path / "out.json") == ()
    table = json.loads((tmp_path / "out.json").read_text())["cameras"]["a: \u00fc"]
    assert table["lens_model"] == ("fisheye" if camera.lens.fisheye else "pinhole")
    pixels = camera.project(np.column_stack([GROUND, np.zeros(4)]))
    matrix, coefficients = np.array(table["camera_matrix"]), np.array(table["distortion"])
    if camera.lens.fisheye:
        flat = cv2.fisheye.undistortPoints(pixels[:, None], matrix, coefficients, P=matrix)[:, 0]
    else:
        flat = cv2.undistortImagePoints(pixels[:, None], matrix, coefficients)[:, 0]
    homogeneous = np.column_stack([flat, np.ones(4)]) @ np.array(table["undistorted_to_ground"]).T
    assert (homogeneous[:, 2] > 0).all()  # the sign tells ground from sky
    assert (np.array(table["undistorted_to_ground"]) @ (960, 539, 1))[2] < 0
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], GROUND, rtol=rtol)
    back = cv2.perspectiveTransform(GROUND[:, None], np.array(table["ground_to_undistorted"]))[:, 0]
    np.testing.assert_allclose(back, flat, atol=1e-5)


@pytest.mark.parametrize(("distortions", "fisheye"), [((-0.2, 0.05, 0.001, -0.002), False), ((0.03, -0.01, 0, 0), True)])
def test_a_lens_both_bent_and_skewed_is_a_loss(tmp_path, distortions, fisheye):
    camera = skewed(distortions, fisheye)
    with pytest.raises(InputError, match=r"camera north: its lens .*skewed. is fitted by .* px off.*--lossy"):
        written("homography", Rig((camera,)), tmp_path / "out.json")
    (told,) = written("homography", Rig((camera,)), tmp_path / "out.json", lossy=True)
    table = json.loads((tmp_path / "out.json").read_text())["cameras"]["north"]
    matrix, to_image = np.array(table["camera_matrix"]), np.array(table["ground_to_undistorted"])
    assert matrix[0, 1] == 0
    # What the fit is off is what is told, in pixels as OpenCV has them from points on the ground.
    flat = np.linalg.inv(matrix) @ to_image @ np.column_stack([GROUND, np.ones(4)]).T
    rays, zero = np.ascontiguousarray((flat / flat[2]).T), np.zeros(3)
    project = cv2.fisheye.projectPoints if table["lens_model"] == "fisheye" else cv2.projectPoints
    pixels = project(rays[:, None], zero, zero, matrix, np.array(table["distortion"]))[0][:, 0]
    off = np.linalg.norm(pixels - camera.project(np.column_stack([GROUND, np.zeros(4)])), axis=1)
    assert 0.01 < off.max() <= float(re.search(r"up to ([\d.e+-]+) px off", told)[1])


def test_a_camera_on_the_ground_is_a_loss(tmp_path):
    low = Camera("low", Lens((1920, 1080), facing().lens.matrix, np.zeros(0)), Pose.from_centre(facing().pose.R_cw, (0, 0, 0)))
    told = written("homography", Rig((facing("north"), low)), tmp_path / "out.json", lossy=True)
    assert told == ("camera low is at the height of the ground and is left out",)


def looking(down_deg, name="down", height=6.0, **lens):
    """A camera that looks so far below the horizon."""
    sine, cosine = np.sin(np.radians(down_deg)), np.cos(np.radians(down_deg))
    R_cw = np.array([[1, 0, 0], [0, -sine, -cosine], [0, cosine, -sine]])
    return Camera(name, facing(**lens).lens, Pose.from_centre(R_cw, (4.0, -3.0, height)))


def corners_of(camera, ground):
    return camera.project(np.column_stack([ground, np.zeros(len(ground))]))


def test_side_lengths_are_those_on_the_ground():
    ground = np.array([[2.0, 4.0], [6.0, 5.0], [6.0, 2.0], [3.0, 1.0]])
    expected = np.linalg.norm(np.roll(ground, -1, axis=0) - ground, axis=1)
    for lens in ({}, {"distortions": (-0.2, 0.03, 0.001, 0)}, {"distortions": (0.02, 0, 0, 0), "fisheye": True}):
        camera = looking(40, **lens)
        np.testing.assert_allclose(frigate.side_lengths(camera, corners_of(camera, ground)), expected, rtol=1e-6)


def test_what_shows_no_ground_has_no_length():
    camera = looking(20)
    above = np.array([[900.0, 2], [1000, 2], [1000, 900], [900, 900]])
    assert np.isnan(frigate.side_lengths(camera, above)).tolist() == [True, True, False, True]
    assert frigate.zone_at(camera, above) is None
    assert frigate.propose_zone(looking(-60)) is None


def test_metres_per_pixel_as_frigate_interpolates_them():
    """By hand: a rectangle of 100 x 50 pixels, with sides of 10, 4, 20 and 6 m."""
    corners = np.array([[100.0, 100], [200, 100], [200, 150], [100, 150]])
    sides = np.array([10.0, 4.0, 20.0, 6.0])
    # Upper side 0.1 and lower 0.2 m a pixel, left 0.12 and right 0.08.
    pixels = np.array([[100.0, 100], [200, 150], [150, 125]])
    np.testing.assert_allclose(frigate.metres_per_pixel(corners, sides, pixels), [0.11, 0.14, 0.125])
    # Whatever corner comes first.
    np.testing.assert_allclose(frigate.metres_per_pixel(np.roll(corners, 2, 0), np.roll(sides, 2), pixels), [0.11, 0.14, 0.125])


def test_the_file_of_frigate_is_a_part_of_its_configuration(tmp_path):
    """A steep camera has a zone of even scale; a low one none, and the file says how far its speeds are off."""
    good, poor = frigate.propose_zone(looking(65)), frigate.propose_zone(looking(25))
    assert good.worst <= 0.1
    assert good.sides_m.min() >= 1.5
    assert poor.worst > 0.2
    rig = Rig((looking(60, "a b"), looking(20, "low"), looking(-60, "up")))
    with pytest.raises(InputError, match="no camera sees enough ground"):
        written("frigate", Rig((rig["up"],)), tmp_path / "none.yml")
    assert not (tmp_path / "none.yml").exists()
    with pytest.raises(InputError, match="camera up sees too little ground"):
        written("frigate", Rig((rig["low"], rig["up"])), tmp_path / "none.yml")
    (told,) = written("frigate", rig, tmp_path / "zones.yml", lossy=True)
    assert told.startswith("camera up ")
    text = (tmp_path / "zones.yml").read_text()
    cameras = yaml.safe_load(text)["cameras"]
    assert list(cameras) == ["a_b", "low"]
    zone = cameras["a_b"]["zones"]["ground_a_b"]
    shares = np.array([float(value) for value in zone["coordinates"].split(",")]).reshape(4, 2)
    assert ((shares > 0) & (shares < 1)).all()
    # What Frigate's validate_distances makes of it.
    sides = np.array(list(map(float, zone["distances"].split(","))))
    ground = frigate.ground_points(rig["a b"], shares * SIZE - 0.5)
    np.testing.assert_allclose(np.linalg.norm(np.roll(ground, -1, axis=0) - ground, axis=1), sides, rtol=2e-3)
    assert "# low: Frigate's speeds are off by -" in text
