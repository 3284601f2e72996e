"""OpenCV's files as OpenCV's own programs write them."""

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


@pytest.mark.parametrize(
    ("ending", "rotation"), [(".yml", TURN), (".xml", cv2.Rodrigues(TURN)[0]), (".json", TURN)], ids=["yml", "xml", "json"]
)
def test_one_file(ending, rotation, tmp_path):
    path = tmp_path / f"yard{ending}"
    write(path, K=MATRIX, dist=DISTORTIONS, image_width=1280, image_height=720, rvec=rotation, tvec=1000 * MOVE)
    with pytest.raises(InputError, match="does not state the unit of its translation"):
        read_rig_as("opencv", path)
    rig, told = read_rig_as("opencv", path, Given(metres_per_unit=0.001))
    assert (told, rig.names) == ((), ("yard",))
    np.testing.assert_allclose(rig["yard"].project(POINTS), projected(), atol=1e-9)


def test_files_without_poses_are_lenses_in_the_order_of_their_names(tmp_path):
    for name in ("C10", "C2"):
        write(tmp_path / f"{name}.yml", camera_matrix=MATRIX, distortion_coefficients=DISTORTIONS)
    write(tmp_path / "other.yml", threshold=3.0)
    with pytest.raises(InputError, match=r"C2\.yml: states no image size.*--size"):
        read_rig_as("opencv", tmp_path)
    rig, _ = read_rig_as("opencv", tmp_path, Given((1280, 720)))
    assert rig.names == ("C2", "C10")
    assert all(camera.pose is None for camera in rig)


def test_numbers_of_cameras_may_be_beyond_floats(tmp_path):
    for name, number in (("C1", 10**400), ("C2", 3), ("C3", 10**399)):
        content = {"camera_matrix": MATRIX.tolist(), "distortion_coefficients": DISTORTIONS.tolist(), "cameraNumber": number}
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    rig, _ = read_rig_as("opencv", tmp_path, Given((1280, 720)))
    assert rig.names == ("C2", "C3", "C1")


def test_the_pair_of_the_stereo_sample(tmp_path):
    write(tmp_path / "intrinsics.yml", M1=MATRIX, D1=DISTORTIONS, M2=MATRIX + np.diag([5.0, 5, 0]), D2=DISTORTIONS)
    write(tmp_path / "extrinsics.yml", R=TURN, T=MOVE[:, None], Q=np.eye(4))
    rig, _ = read_rig_as("opencv", tmp_path, Given((1280, 720), 1.0))
    np.testing.assert_allclose(rig["camera1"].project(POINTS), projected(np.eye(3), np.zeros(3)), atol=1e-9)
    np.testing.assert_allclose(rig["camera2"].project(POINTS), projected(matrix=MATRIX + np.diag([5.0, 5, 0])), atol=1e-9)


def test_the_file_of_the_multi_view_sample(tmp_path):
    fisheye = np.array([0.03, -0.01, 0.002, 0.0])
    write(
        tmp_path / "rig.yaml",
        rvecs=np.array([np.zeros((3, 1)), cv2.Rodrigues(TURN)[0]]),
        Ts=np.array([np.zeros(3), MOVE]),
        Ks=np.array([MATRIX, MATRIX]),
        distortions=np.array([DISTORTIONS, [*fisheye, 0.0]])[:, None],
        is_fisheye=np.array([0, 1]),
        image_sizes=np.array([[1280, 720], [1280, 720]]),
        cam_ids="left,right",
    )
    rig, _ = read_rig_as("opencv", tmp_path / "rig.yaml", Given(metres_per_unit=1.0))
    assert rig.names == ("left", "right")
    np.testing.assert_allclose(rig["left"].project(POINTS), projected(np.eye(3), np.zeros(3)), atol=1e-9)
    seen = cv2.fisheye.projectPoints(POINTS[:, None], cv2.Rodrigues(TURN)[0], MOVE[:, None], MATRIX, fisheye)[0][:, 0]
    np.testing.assert_allclose(rig["right"].project(POINTS), seen, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"R": TURN}, r"has no translation \(T\): give both"),
        ({"T": MOVE}, r"has no rotation \(R\): give both"),
        ({"R": np.ones((3, 3)), "T": MOVE}, "the rotation .* is none"),
        ({"R": np.eye(2), "T": MOVE}, "has 4 and 3 numbers"),
    ],
)
def test_poses_that_are_none(values, said, tmp_path):
    write(tmp_path / "C1.yml", K=MATRIX, D=DISTORTIONS, image_width=1280, image_height=720, **values)
    with refused(said, tmp_path / "C1.yml"):
        read_rig_as("opencv", tmp_path, Given(metres_per_unit=1.0))


def test_what_opencv_makes_of_a_skewed_pinhole_is_as_near_as_told(tmp_path):
    """Its functions take no skew from the matrix, so that none may be written to come nearer."""
    distortions = (-0.1, 0.01, 0.001, 0.0, 0.0)
    skewed = MATRIX + np.array([[0, 30.0, 0], [0, 0, 0], [0, 0, 0]])
    camera = Camera("yard", Lens((1280, 720), skewed, np.array(distortions)), Pose(TURN, MOVE))
    (told,) = export(Export(Rig((camera,))), "opencv", tmp_path, lossy=True)
    stored = read_opencv_lens(tmp_path / "yard.yml")
    assert stored.matrix[0, 1] == 0
    rays = np.random.default_rng(2).uniform((-0.6, -0.35, 1), (0.6, 0.35, 1), (300, 3))
    project = cv2.fisheye.projectPoints if stored.fisheye else cv2.projectPoints
    seen = project(rays[:, None], np.zeros(3), np.zeros(3), stored.matrix, stored.distortions)[0][:, 0]
    off = np.linalg.norm(seen - camera.lens.project_rays(rays), axis=1).max()
    assert 1 < off <= float(re.search(r"up to ([\d.e+-]+) px off", told)[1])


def test_names_that_opencv_cannot_bear_are_those_of_the_files(tmp_path):
    rig = Rig(tuple(Camera(name, Lens((1280, 720), MATRIX, DISTORTIONS)) for name in ("true", '"q"', "x: y", "#z")))
    export(Export(rig), "opencv", tmp_path)
    back, _ = read_rig_as("opencv", tmp_path)
    assert back.names == ("true", "_q_", "x: y", "#z")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["_q_.yml", "_z.yml", "true.yml", "x_ y.yml"]


def test_a_whole_rig_in_one_file(tmp_path):
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


def test_folders_and_files_without_a_camera_are_told(tmp_path):
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


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"Ks": np.array([MATRIX])}, "Ks, rvecs, Ts, image_sizes and is_fisheye have different numbers of cameras"),
        ({"Ks": np.array([-MATRIX, MATRIX])}, "focal lengths above 0"),
        ({"distortions": np.zeros((2, 1, 7))}, "distortions has 7 values"),
    ],
)
def test_a_multi_view_file_that_contradicts_itself(tmp_path, changed, said):
    told = {
        "rvecs": np.zeros((2, 3, 1)), "Ts": np.zeros((2, 3)), "Ks": np.array([MATRIX, MATRIX]),
        "distortions": np.zeros((2, 1, 5)), "is_fisheye": np.array([0, 0]), "image_sizes": np.array([[1280, 720]] * 2),
    }  # fmt: skip
    write(tmp_path / "rig.yaml", **told)
    assert read_rig_as("opencv", tmp_path / "rig.yaml", Given(metres_per_unit=1.0))[0].names == ("0", "1")
    write(tmp_path / "rig.yaml", **(told | changed))
    with refused(said, tmp_path / "rig.yaml"):
        read_rig_as("opencv", tmp_path / "rig.yaml", Given(metres_per_unit=1.0))
