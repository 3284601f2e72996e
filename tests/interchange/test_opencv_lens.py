"""OpenCV's files: what it writes itself, what others write alike, and what is no lens."""

import cv2
import numpy as np
import pytest

from passerby.interchange.opencv_lens import read_opencv_lens
from support.refusals import refused

MATRIX = np.array([[900.0, 0, 330], [0, 910, 235], [0, 0, 1]])
DISTORTIONS = [0.1, -0.2, 0.001, 0.002, 0.05]


@pytest.mark.parametrize(
    ("ending", "matrix_key", "distortions_key"),
    [
        ("yml", "camera_matrix", "distortion_coefficients"), ("xml", "cameraMatrix", "distCoeffs"), ("json", "K", "D"),
        ("yaml", "mtx", "dist"),
    ],
)  # fmt: skip
def test_what_opencv_writes(tmp_path, ending, matrix_key, distortions_key):
    path = tmp_path / f"a.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write(matrix_key, MATRIX)
    storage.write(distortions_key, np.array([DISTORTIONS]).T)
    storage.release()
    stored = read_opencv_lens(path)
    assert stored.size == (640, 480)
    np.testing.assert_allclose(stored.matrix, MATRIX)
    np.testing.assert_allclose(stored.distortions, DISTORTIONS)
    assert not stored.fisheye


ROS = """image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [900, 0, 330, 0, 910, 235, 0, 0, 1]
distortion_model: MODEL
distortion_coefficients:
  rows: 1
  cols: 4
  data: [0.1, 0.2, 0.01, 0.02]
"""


@pytest.mark.parametrize(("model", "fisheye"), [("plumb_bob", False), ("equidistant", True)])
def test_ros(tmp_path, model, fisheye):
    path = tmp_path / "a.yaml"
    path.write_text(ROS.replace("MODEL", model))
    stored = read_opencv_lens(path)
    assert (stored.size, stored.fisheye) == ((640, 480), fisheye)
    np.testing.assert_allclose(stored.matrix, MATRIX)


@pytest.mark.parametrize("size", ['"image_size": [640, 480],', '"size": {"width": 640, "height": 480},', ""])
def test_lists_in_json(tmp_path, size):
    path = tmp_path / "a.json"
    path.write_text(f'{{{size} "K": {MATRIX.tolist()}, "dist": [{DISTORTIONS}], "fisheye": 0}}')
    stored = read_opencv_lens(path)
    assert stored.size == ((640, 480) if size else None)
    np.testing.assert_allclose(stored.matrix, MATRIX)
    np.testing.assert_allclose(stored.distortions, DISTORTIONS)


def test_lists_in_xml_and_tables_that_hold_themselves(tmp_path):
    """OpenCV writes a list of texts or tables as elements called `_`; YAML may refer to what it stands in."""
    numbers = f"<camera_matrix><rows>3</rows><cols>3</cols><data>{' '.join(map(str, MATRIX.ravel()))}</data></camera_matrix>"
    rest = "<image_width>640</image_width><image_height>480</image_height><dist>0 0 0 0</dist>"
    (tmp_path / "a.xml").write_text(f"<opencv_storage><names><_>left</_><_>right</_></names>{numbers}{rest}</opencv_storage>")
    (tmp_path / "a.yaml").write_text(f"size: &a\n  inner: *a\nK: {MATRIX.ravel().tolist()}\nD: [0, 0, 0, 0]\n")
    for name, size in (("a.xml", (640, 480)), ("a.yaml", None)):
        stored = read_opencv_lens(tmp_path / name)
        np.testing.assert_allclose(stored.matrix, MATRIX)
        assert stored.size == size


def test_a_file_about_something_else_is_no_lens(tmp_path):
    (tmp_path / "a.json").write_text('{"images": [{"id": 1}]}')
    (tmp_path / "b.json").write_text("[1, 2]")
    assert read_opencv_lens(tmp_path / "a.json") is None
    assert read_opencv_lens(tmp_path / "b.json") is None


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.yml", "%YAML:1.0\n---\nfoo: [", "is not a file that OpenCV can read"),
        ("a.xml", "<a></a>", "is not a file that OpenCV can read"),
        ("a.json", '{"K": [1, 2], "D": [0, 0, 0, 0]}', "the camera matrix has 2 numbers"),
        ("a.json", '{"K": [9, 0, 1, 0, 9, 1, 0, 0, 1]}', "no distortion coefficients"),
        ("a.json", '{"K": [9, 0, 1, 0, 9, 1, 0, 0, 1], "D": [0, 0, 0]}', "distortions has 3 values"),
        ("a.json", '{"K": [0, 0, 1, 0, 9, 1, 0, 0, 1], "D": [0, 0, 0, 0]}', "is not a camera matrix"),
        ("a.json", '{"K": [9, 0, 1, 0, 9, 1, 0, 0, 1], "D": [0, 0, 0, 0], "width": 1.5, "height": 3}', "whole numbers"),
        ("a.yaml", ROS.replace("MODEL", "omnidirectional"), "lens model 'omnidirectional' is not known"),
    ],
)
def test_what_cannot_be_used_is_told(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with refused(told, tmp_path / name):
        read_opencv_lens(tmp_path / name)
