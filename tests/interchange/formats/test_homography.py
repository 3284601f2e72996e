import json

import cv2
import numpy as np
import pytest

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
    assert (homogeneous[:, 2] > 0).all()
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], GROUND, rtol=1e-4)
    back = cv2.perspectiveTransform(GROUND[:, None], np.array(table["ground_to_undistorted"]))[:, 0]
    np.testing.assert_allclose(back, flat, atol=1e-5)


def test_the_sign_tells_ground_from_sky(tmp_path):
    written("homography", Rig((facing("north"),)), tmp_path / "out.json")
    to_ground = np.array(json.loads((tmp_path / "out.json").read_text())["cameras"]["north"]["undistorted_to_ground"])
    assert (to_ground @ (960, 541, 1))[2] > 0
    assert (to_ground @ (960, 539, 1))[2] < 0


def test_a_camera_on_the_ground_is_a_loss(tmp_path):
    low = Camera("low", Lens((1920, 1080), facing().lens.matrix, np.zeros(0)), Pose.from_centre(facing().pose.R_cw, (0, 0, 0)))
    told = written("homography", Rig((facing("north"), low)), tmp_path / "out.json", lossy=True)
    assert told == ("camera low is at the height of the ground and is left out",)
