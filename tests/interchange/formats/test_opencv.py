"""Files of OpenCV as its own programs write them, what others write alike, and what is no lens."""

import json
import re

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Export, Given, export, read_rig_as
from passerby.interchange.opencv_lens import read_opencv_lens
from support.refusals import refused

MATRIX = np.array([[900.0, 0, 640], [0, 905, 360], [0, 0, 1]])
DISTORTIONS = np.array([-0.2, 0.05, 0.001, -0.002, 0.01])
TURN = cv2.Rodrigues(np.array([0.1, -0.4, 0.2]))[0]
MOVE = np.array([0.5, -1.0, 4.0])
POINTS = np.random.default_rng(0).uniform((-1, -1, 2), (1, 1, 6), (40, 3))


def write(path, **values):
    storage = cv2.FileStorage(str(path), cv2.FileStorage_WRITE)
    for key, value in values.items():
        storage.write(key, value)
    storage.release()


def projected(turn=TURN, move=MOVE, matrix=MATRIX, distortions=DISTORTIONS):
    return cv2.projectPoints(POINTS, cv2.Rodrigues(np.array(turn))[0], np.array(move), matrix, distortions)[0][:, 0]


@pytest.mark.parametrize(("ending", "keys", "rotation"), [
    ("yml", ("camera_matrix", "distortion_coefficients"), TURN),
    ("xml", ("cameraMatrix", "distCoeffs"), cv2.Rodrigues(TURN)[0]),
    ("json", ("K", "D"), TURN), ("yaml", ("mtx", "dist"), TURN),
])  # fmt: skip
def test_one_file_is_one_camera(ending, keys, rotation, tmp_path):
    path = tmp_path / f"yard.{ending}"
    intrinsics = dict(zip(keys, (MATRIX, DISTORTIONS), strict=True))
    write(path, **intrinsics, image_width=1280, image_height=720, rvec=rotation, tvec=1000 * MOVE)
    stored = read_opencv_lens(path)
    assert (stored.size, stored.fisheye) == ((1280, 720), False)
    np.testing.assert_allclose(stored.matrix, MATRIX)
    np.testing.assert_allclose(stored.distortions, DISTORTIONS)
    with pytest.raises(InputError, match="does not state the unit of its translation"):
        read_rig_as("opencv", path)
    rig, losses = read_rig_as("opencv", path, Given(metres_per_unit=0.001))
    assert (losses, rig.names) == ((), ("yard",))
    np.testing.assert_allclose(rig["yard"].project(POINTS), projected(), atol=1e-9)


def test_a_folder_without_poses_has_lenses_in_the_order_of_names_and_numbers(tmp_path):
    """Numbers of cameras may be beyond floats."""
    for name in ("C10", "C2"):
        write(tmp_path / f"{name}.yml", camera_matrix=MATRIX, distortion_coefficients=DISTORTIONS)
    write(tmp_path / "other.yml", threshold=3.0)
    with pytest.raises(InputError, match=r"C2\.yml: states no image size.*--size"):
        read_rig_as("opencv", tmp_path)
    rig, _ = read_rig_as("opencv", tmp_path, Given((1280, 720)))
    assert rig.names == ("C2", "C10")
    assert all(camera.pose is None for camera in rig)
    (tmp_path / "numbered").mkdir()
    for name, number in (("C1", 10**400), ("C2", 3), ("C3", 10**399)):
        content = {"camera_matrix": MATRIX.tolist(), "distortion_coefficients": DISTORTIONS.tolist(), "cameraNumber": number}
        (tmp_path / "numbered" / f"{name}.json").write_text(json.dumps(content))
    assert read_rig_as("opencv", tmp_path / "numbered", Given((1280, 720)))[0].names == ("C2", "C3", "C1")


def test_the_pair_of_the_stereo_sample_is_read(tmp_path):
    write(tmp_path / "intrinsics.yml", M1=MATRIX, D1=DISTORTIONS, M2=MATRIX + np.diag([5.0, 5, 0]), D2=DISTORTIONS)
    write(tmp_path / "extrinsics.yml", R=TURN, T=MOVE[:, None], Q=np.eye(4))
    rig, _ = read_rig_as("opencv", tmp_path, Given((1280, 720), 1.0))
    np.testing.assert_allclose(rig["camera1"].project(POINTS), projected(np.eye(3), np.zeros(3)), atol=1e-9)
    np.testing.assert_allclose(rig["camera2"].project(POINTS), projected(matrix=MATRIX + np.diag([5.0, 5, 0])), atol=1e-9)


MULTI_VIEW = {
    "rvecs": np.array([np.zeros((3, 1)), cv2.Rodrigues(TURN)[0]]), "Ts": np.array([np.zeros(3), MOVE]),
    "Ks": np.array([MATRIX, MATRIX]), "distortions": np.array([DISTORTIONS, [0.03, -0.01, 0.002, 0.0, 0.0]])[:, None],
    "is_fisheye": np.array([0, 1]), "image_sizes": np.array([[1280, 720], [1280, 720]]),
}  # fmt: skip


def test_the_file_of_the_multi_view_sample_is_read(tmp_path):
    given, path = Given(metres_per_unit=1.0), tmp_path / "rig.yaml"
    write(path, **MULTI_VIEW)
    assert read_rig_as("opencv", path, given)[0].names == ("0", "1")
    write(path, **MULTI_VIEW, cam_ids="left,right")
    rig, _ = read_rig_as("opencv", path, given)
    assert rig.names == ("left", "right")
    np.testing.assert_allclose(rig["left"].project(POINTS), projected(np.eye(3), np.zeros(3)), atol=1e-9)
    fisheye = MULTI_VIEW["distortions"][1, 0, :4]
    seen = cv2.fisheye.projectPoints(POINTS[:, None], cv2.Rodrigues(TURN)[0], MOVE[:, None], MATRIX, fisheye)[0][:, 0]
    np.testing.assert_allclose(rig["right"].project(POINTS), seen, atol=1e-9)


@pytest.mark.parametrize(("changed", "message"), [
    ({"Ks": np.array([MATRIX])}, "Ks, rvecs, Ts, image_sizes and is_fisheye have different numbers of cameras"),
    ({"Ks": np.array([-MATRIX, MATRIX])}, "focal lengths above 0"),
    ({"distortions": np.zeros((2, 1, 7))}, "distortions has 7 values"),
])  # fmt: skip
def test_a_multi_view_file_that_contradicts_itself_is_refused(tmp_path, changed, message):
    write(tmp_path / "rig.yaml", **(MULTI_VIEW | changed))
    with refused(message, tmp_path / "rig.yaml"):
        read_rig_as("opencv", tmp_path / "rig.yaml", Given(metres_per_unit=1.0))


@pytest.mark.parametrize(("values", "message"), [
    ({"R": TURN}, r"has no translation \(T\): give both"),
    ({"T": MOVE}, r"has no rotation \(R\): give both"),
    ({"R": np.ones((3, 3)), "T": MOVE}, "the rotation .* is none"),
    ({"R": np.eye(2), "T": MOVE}, "has 4 and 3 numbers"),
])  # fmt: skip
def test_poses_that_are_none_are_refused(values, message, tmp_path):
    write(tmp_path / "C1.yml", K=MATRIX, D=DISTORTIONS, image_width=1280, image_height=720, **values)
    with refused(message, tmp_path / "C1.yml"):
        read_rig_as("opencv", tmp_path, Given(metres_per_unit=1.0))


def test_what_opencv_makes_of_a_skewed_pinhole_is_as_near_as_stated(tmp_path):
    """Its functions take no skew from the matrix, so that none may be written to come nearer."""
    distortions = (-0.1, 0.01, 0.001, 0.0, 0.0)
    skewed = MATRIX + np.array([[0, 30.0, 0], [0, 0, 0], [0, 0, 0]])
    camera = Camera("yard", Lens((1280, 720), skewed, np.array(distortions)), Pose(TURN, MOVE))
    (loss,) = export(Export(Rig((camera,))), "opencv", tmp_path, lossy=True)
    stored = read_opencv_lens(tmp_path / "yard.yml")
    assert stored.matrix[0, 1] == 0
    rays = np.random.default_rng(2).uniform((-0.6, -0.35, 1), (0.6, 0.35, 1), (300, 3))
    project = cv2.fisheye.projectPoints if stored.fisheye else cv2.projectPoints
    seen = project(rays[:, None], np.zeros(3), np.zeros(3), stored.matrix, stored.distortions)[0][:, 0]
    off = np.linalg.norm(seen - camera.lens.project_rays(rays), axis=1).max()
    assert 1 < off <= float(re.search(r"up to ([\d.e+-]+) px off", loss)[1])


def test_names_that_opencv_cannot_bear_are_those_of_the_files(tmp_path):
    rig = Rig(tuple(Camera(name, Lens((1280, 720), MATRIX, DISTORTIONS)) for name in ("true", '"q"', "x: y", "#z")))
    export(Export(rig), "opencv", tmp_path)
    back, _ = read_rig_as("opencv", tmp_path)
    assert back.names == ("true", "_q_", "x: y", "#z")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["_q_.yml", "_z.yml", "true.yml", "x_ y.yml"]


def test_a_whole_rig_is_written_into_one_file(tmp_path):
    lens = Lens((1280, 720), MATRIX, DISTORTIONS)
    rig = Rig(
        (
            Camera("gate 2", lens, Pose(TURN, MOVE)),
            Camera("Öst", Lens((640, 480), np.diag([0.5, 0.5, 1]) @ MATRIX, np.zeros(4), True), Pose(TURN.T, -MOVE)),
            Camera("true", lens, Pose(np.eye(3), MOVE)),
            Camera("bare", lens),
        )
    )
    path = tmp_path / "rig.yml"
    for _ in range(2):
        assert export(Export(rig), "opencv", path) == ()
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera1").getNode("R").mat(), TURN)
    back, _ = read_rig_as("opencv", path)
    # OpenCV writes the text `true` so that it does not read it back.
    assert back.names == ("gate 2", "Öst", "camera3", "bare")
    assert back["bare"].pose is None
    for camera, other in zip(rig.posed(), back.posed(), strict=True):
        world = (POINTS - camera.pose.t_cw) @ camera.pose.R_cw
        np.testing.assert_allclose(other.project(world), camera.project(world), atol=1e-9)
    (tmp_path / "folder.yml").mkdir()
    export(Export(rig), "opencv", tmp_path / "folder.yml")
    assert len(list((tmp_path / "folder.yml").iterdir())) == 4


def test_folders_and_files_without_a_camera_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"has no file of OpenCV \(\.yml, "):
        read_rig_as("opencv", tmp_path)
    write(tmp_path / "other.yml", threshold=3.0)
    with pytest.raises(InputError, match="holds no camera: a camera_matrix and distortion_coefficients are needed"):
        read_rig_as("opencv", tmp_path)
    for name in ("C1.yml", "C1.xml"):
        write(tmp_path / name, K=MATRIX, D=DISTORTIONS, image_width=1280, image_height=720)
    with pytest.raises(InputError, match=f"^{tmp_path}: camera C1 occurs twice"):
        read_rig_as("opencv", tmp_path)
    write(tmp_path / "C1.xml", M1=np.eye(2), D1=DISTORTIONS, M2=MATRIX, D2=DISTORTIONS, R=TURN, T=MOVE[:, None])
    with pytest.raises(InputError, match="the camera matrix has 4 numbers: 3 x 3 are needed"):
        read_rig_as("opencv", tmp_path, Given((1280, 720), 1.0))


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
def test_a_lens_of_ros_is_read(tmp_path, model, fisheye):
    path = tmp_path / "a.yaml"
    path.write_text(ROS.replace("MODEL", model))
    stored = read_opencv_lens(path)
    assert (stored.size, stored.fisheye) == ((640, 480), fisheye)
    np.testing.assert_allclose(stored.matrix, [[900, 0, 330], [0, 910, 235], [0, 0, 1]])


@pytest.mark.parametrize("size", ['"image_size": [1280, 720],', '"size": {"width": 1280, "height": 720},', ""])
def test_lists_of_scripts_are_read(tmp_path, size):
    """Also in XML, where OpenCV writes a list of texts or tables as elements called `_`, and YAML that refers to itself."""
    numbers = " ".join(map(str, MATRIX.ravel()))
    rest = "<image_width>1280</image_width><image_height>720</image_height><dist>-0.2 0.05 0.001 -0.002 0.01</dist>"
    matrix = f"<camera_matrix><rows>3</rows><cols>3</cols><data>{numbers}</data></camera_matrix>"
    (tmp_path / "a.json").write_text(f'{{{size} "K": {MATRIX.tolist()}, "dist": [{DISTORTIONS.tolist()}], "fisheye": 0}}')
    (tmp_path / "a.xml").write_text(f"<opencv_storage><names><_>left</_><_>right</_></names>{matrix}{rest}</opencv_storage>")
    (tmp_path / "a.yaml").write_text(f"size: &a\n  inner: *a\nK: {MATRIX.ravel().tolist()}\nD: {DISTORTIONS.tolist()}\n")
    for name, expected in (("a.json", (1280, 720) if size else None), ("a.xml", (1280, 720)), ("a.yaml", None)):
        stored = read_opencv_lens(tmp_path / name)
        assert stored.size == expected
        np.testing.assert_allclose(stored.matrix, MATRIX)
        np.testing.assert_allclose(stored.distortions, DISTORTIONS)
    for text in ('{"images": [{"id": 1}]}', "[1, 2]"):
        (tmp_path / "a.json").write_text(text)
        assert read_opencv_lens(tmp_path / "a.json") is None


@pytest.mark.parametrize(("name", "text", "message"), [
    ("a.yml", "%YAML:1.0\n---\nfoo: [", "is not a file that OpenCV can read"),
    ("a.xml", "<a></a>", "is not a file that OpenCV can read"),
    ("a.json", '{"K": [1, 2], "D": [0, 0, 0, 0]}', "the camera matrix has 2 numbers"),
    ("a.json", '{"K": [9, 0, 1, 0, 9, 1, 0, 0, 1]}', "no distortion coefficients"),
    ("a.json", '{"K": [9, 0, 1, 0, 9, 1, 0, 0, 1], "D": [0, 0, 0]}', "distortions has 3 values"),
    ("a.json", '{"K": [0, 0, 1, 0, 9, 1, 0, 0, 1], "D": [0, 0, 0, 0]}', "is not a camera matrix"),
    ("a.json", '{"K": [9, 0, 1, 0, 9, 1, 0, 0, 1], "D": [0, 0, 0, 0], "width": 1.5, "height": 3}', "whole numbers"),
    ("a.yaml", ROS.replace("MODEL", "omnidirectional"), "lens model 'omnidirectional' is not known"),
])  # fmt: skip
def test_a_lens_that_cannot_be_used_is_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with refused(message, tmp_path / name):
        read_opencv_lens(tmp_path / name)
