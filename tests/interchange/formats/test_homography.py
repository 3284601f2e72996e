import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from support.scenes.handmade_rigs import facing, written

GROUND = np.array([[4.0, 5.0], [2.0, 9.0], [7.0, 14.0], [4.0, 40.0]])


@pytest.mark.parametrize(
    ("distortions", "fisheye"), [((), False), ((-0.2, 0.05, 0.001, -0.002), False), ((0.03, -0.01, 0, 0), True)]
)
def test_opencv_gets_from_pixels_to_the_ground_and_back(tmp_path, distortions, fisheye):
    rig = Rig((facing("a: \u00fc", distortions=distortions, fisheye=fisheye),))
    assert written("homography", rig, tmp_path / "out.json") == ()
    table = json.loads((tmp_path / "out.json").read_text())["cameras"]["a: \u00fc"]
    assert table["lens_model"] == ("fisheye" if fisheye else "pinhole")
    pixels = rig["a: \u00fc"].project(np.column_stack([GROUND, np.zeros(4)]))
    matrix, coefficients = np.array(table["camera_matrix"]), np.array(table["distortion"])
    if fisheye:
        flat = cv2.fisheye.undistortPoints(pixels[:, None], matrix, coefficients, P=matrix)[:, 0]
    else:
        flat = cv2.undistortImagePoints(pixels[:, None], matrix, coefficients)[:, 0]
    homogeneous = np.column_stack([flat, np.ones(4)]) @ np.array(table["undistorted_to_ground"]).T
    assert (homogeneous[:, 2] > 0).all()  # the sign tells ground from sky
    assert (np.array(table["undistorted_to_ground"]) @ (960, 539, 1))[2] < 0
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], GROUND, rtol=1e-4)
    back = cv2.perspectiveTransform(GROUND[:, None], np.array(table["ground_to_undistorted"]))[:, 0]
    np.testing.assert_allclose(back, flat, atol=1e-5)


SKEW = np.array([[0.0, 30, 0], [0, 0, 0], [0, 0, 0]])


def skewed(distortions=(), fisheye=False):
    straight = facing("north", distortions=distortions, fisheye=fisheye)
    return replace(straight, lens=replace(straight.lens, matrix=straight.lens.matrix + SKEW))


def test_opencv_gets_from_skewed_pixels_to_the_ground(tmp_path):
    """Its functions take no skew from the matrix, so that the homographies have to hold it."""
    assert written("homography", Rig((skewed(),)), tmp_path / "out.json") == ()
    table = json.loads((tmp_path / "out.json").read_text())["cameras"]["north"]
    matrix = np.array(table["camera_matrix"])
    pixels = skewed().project(np.column_stack([GROUND, np.zeros(4)]))
    flat = cv2.undistortPoints(pixels[:, None], matrix, np.array(table["distortion"]), P=matrix)[:, 0]
    homogeneous = np.column_stack([flat, np.ones(4)]) @ np.array(table["undistorted_to_ground"]).T
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], GROUND, rtol=1e-9)


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
