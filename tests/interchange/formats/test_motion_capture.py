"""Calibrations of motion capture: BioCV, calib.io, OptiTrack Motive, OpenCap, Qualisys and Vicon, by hand and broken."""

import pickle
import re

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from passerby.interchange.rig_toml import read_rig
from support.refusals import refused
from support.scenes.handmade_rigs import CENTRE, PIXELS, POINTS, SIZE
from support.untrusted import example_files as example


def laid(form, folder, *changes, encoding="utf-16"):
    """The sound file of a format, with some of its text replaced."""
    name, content = example.BY_HAND[form]
    for old, new in changes:
        assert form == "opencap" or old in content
        content = content | {old: new} if form == "opencap" else content.replace(old, new)
    packed = pickle.dumps(content) if form == "opencap" else content.encode(encoding if form == "motive" else "utf-8")
    (folder / name).write_bytes(packed)
    return folder / name


def read(form, path, **given):
    """The rig, and what is not read."""
    asked = Given(**given)
    return read_rig_as(form, path, asked)[0], asked.unread.told


@pytest.mark.parametrize(("form", "name", "pixels", "unread"), [
    ("biocv", "00", PIXELS, ()), ("calibio", "cam0", PIXELS, ("not read: poses",)),
    ("motive", "M7", PIXELS, ("not read: Properties",)), ("opencap", "cam", PIXELS, ()),
    ("vicon", "21", [[960, 540], [1060, 540], [960, 440]], ()),
])  # fmt: skip
def test_a_camera_at_a_known_place_sees_points_at_known_pixels(tmp_path, form, name, pixels, unread):
    rig, left = read(form, laid(form, tmp_path), metres_per_unit=1.0 if form == "calibio" else None)
    assert (rig.names[0], rig[name].lens.size, left) == (name, SIZE, unread)
    np.testing.assert_allclose(rig[name].centre, CENTRE, atol=1e-9)
    np.testing.assert_allclose(rig[name].project(POINTS), pixels, atol=1e-6)


@pytest.mark.parametrize(("form", "change", "camera"), [
    ("biocv", [("0 0 0 0 0", "-0.1 0.02 0.001 -0.002 0.003")], "00"), ("calibio", [], "cam1"),
    ("motive", [(example.MOTIVE_LENS, example.MOTIVE_BENT)], "M7"),
    ("opencap", [("distortion", np.array([example.BENT]))], "cam"),
])  # fmt: skip
def test_distortions_are_in_the_order_of_opencv(tmp_path, form, change, camera):
    rig, _ = read(form, laid(form, tmp_path, *change), metres_per_unit=1.0)
    np.testing.assert_array_equal(rig[camera].lens.distortions, example.BENT)


def test_folders_hold_a_file_or_a_folder_for_each_camera(tmp_path):
    (tmp_path / "biocv").mkdir()
    with pytest.raises(InputError, match=r"holds no [.]calib file"):
        read("biocv", tmp_path / "biocv")
    for number in (10, 2):
        (tmp_path / "biocv" / f"{number}.calib").write_text(example.BIOCV)
        (tmp_path / "session" / "Videos" / f"Cam{number}").mkdir(parents=True)
        path = tmp_path / "session" / "Videos" / f"Cam{number}" / "cameraIntrinsicsExtrinsics.pickle"
        path.write_bytes(pickle.dumps(example.OPENCAP))
    assert read("biocv", tmp_path / "biocv")[0].names == ("2", "10")
    for place in (tmp_path / "session", tmp_path / "session" / "Videos"):
        assert read("opencap", place)[0].names == ("Cam2", "Cam10")


def test_calibio_asks_for_the_unit_where_it_matters(tmp_path):
    with pytest.raises(InputError, match=r"cameras\[0\]: does not state the unit.*--units mm"):
        read("calibio", laid("calibio", tmp_path))
    places = (('"x": -4.0, "y": 2.5, "z": 3.0', '"x": 0.0, "y": 0.0, "z": 0.0'),)
    assert read("calibio", laid("calibio", tmp_path, *places))[0]["cam0"].pose is not None


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8"])
def test_motives_orientation_is_from_camera_to_world_row_by_row_in_any_encoding(tmp_path, encoding):
    turn = (0, 0, -1, 0, 1, 0, 1, 0, 0)
    changes = [(re.search(rf'OrientMatrix{k}="\d"', example.MOTIVE)[0], f'OrientMatrix{k}="{turn[k]}"') for k in range(9)]
    camera = read("motive", laid("motive", tmp_path, *changes, encoding=encoding))[0]["M7"]
    ahead = np.array(CENTRE) + [[10.0, 0, 0], [10.0, -1.0, 0]]
    np.testing.assert_allclose(camera.project(ahead), [[960, 540], [1060, 540]], atol=1e-6)


def test_a_binary_calibration_of_motive_says_what_to_save_instead(tmp_path):
    (tmp_path / "lab.cal").write_bytes(bytes(range(256)) * 4)
    with pytest.raises(InputError, match=r"lab.cal: is a binary calibration.*Motive 3 and save it as .mcal"):
        read("motive", tmp_path / "lab.cal")


def test_intrinsics_of_opencap_stand_alone(tmp_path):
    values = {key: value for key, value in example.OPENCAP.items() if not key.startswith(("rotation", "translation"))}
    (tmp_path / "cam.pickle").write_bytes(pickle.dumps(values | {"rms": 0.2}))
    rig, unread = read("opencap", tmp_path / "cam.pickle")
    assert (rig["cam"].pose, unread) == (None, ("not read: rms",))


def test_axes_units_and_pixels_of_qualisys_by_hand(tmp_path):
    camera = read("qualisys", laid("qualisys", tmp_path))[0]["26580"]
    assert camera.lens.size == (1920, 1088)
    np.testing.assert_allclose(camera.centre, (4, 0, 2), atol=1e-12)
    np.testing.assert_allclose(camera.pose.R_cw, [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-12)
    # 4 m ahead, 1 m to the right and 0.5 m down: 400 pixels right of the centre and 200 below.
    np.testing.assert_allclose(camera.project(np.array([[0.0, 1.0, 1.5]])), [[959.5 + 400, 543.5 + 200]], atol=1e-9)
    assert np.isnan(camera.project(np.array([[5.0, 0.0, 2.0]]))).all()  # behind it


def test_distortions_of_qualisys_are_not_scaled(tmp_path):
    values = (("radialDistortion1", -0.046), ("radialDistortion2", 0.14), ("radialDistortion3", 0.01),
              ("tangentalDistortion1", 0.0006), ("tangentalDistortion2", -0.0004))  # fmt: skip
    changes = [(f'{name}="0"', f'{name}="{value}"') for name, value in values]
    camera = read("qualisys", laid("qualisys", tmp_path, *changes))[0]["26580"]
    np.testing.assert_allclose(camera.lens.distortions, (-0.046, 0.14, 0.0006, -0.0004, 0.01))
    # At x = 0.25, y = 0 (400 pixels to the right) r^2 is 0.0625: factor 1 - 0.002875 + 0.000546875 + 0.00000244.
    x = 0.25 * (1 - 0.046 * 0.0625 + 0.14 * 0.0625**2 + 0.01 * 0.0625**3) - 0.0004 * 3 * 0.0625
    pixel = camera.project(np.array([[0.0, 1.0, 2.0]]))
    np.testing.assert_allclose(pixel, [[959.5 + 1600 * x, 543.5 + 1600 * 0.0006 * 0.0625]], atol=1e-6)


def test_videos_of_qualisys_show_a_part_of_the_sensor_or_less_of_its_pixels(tmp_path):
    part = ('fov_video left="0" top="0"', 'fov_video left="100" top="8"')
    camera = read("qualisys", laid("qualisys", tmp_path, part))[0]["26580"]
    assert camera.lens.size == (1820, 1080)
    np.testing.assert_allclose(camera.lens.matrix[:2, 2], (859.5, 535.5))
    bare = laid("qualisys", tmp_path, part, ("fov_video ", "fov_other "))
    assert read("qualisys", bare)[0]["26580"].lens.size == (1920, 1088)
    stated = 'viewrotation="0" video_resolution="{}p"'.format
    # A height of too many digits says nothing.
    assert read("qualisys", laid("qualisys", tmp_path, ('viewrotation="0"', stated("5" * 5000))))[0].names == ("26580",)
    full = read("qualisys", laid("qualisys", tmp_path))[0]["26580"]
    path = laid("qualisys", tmp_path, ('viewrotation="0"', stated(540)))
    with pytest.raises(InputError, match="its videos are 540p: give their size with --size"):
        read("qualisys", path)
    with pytest.raises(InputError, match="another shape"):
        read("qualisys", path, size=(544, 960))
    camera = read("qualisys", path, size=(960, 544))[0]["26580"]
    points = np.random.default_rng(0).uniform((-2, -1, 0), (1, 1, 3), (20, 3))
    np.testing.assert_allclose(camera.project(points), (full.project(points) + 0.5) / 2 - 0.5, atol=1e-9)


def test_cameras_of_qualisys_out_of_use_have_no_pose(tmp_path):
    idle = example.QUALISYS_CAMERA.replace('active="1"', 'active="0"').replace("26580", "1")
    lost = example.QUALISYS_CAMERA.replace('calibrated="true"', 'calibrated="false"').replace("26580", "2")
    rig, _ = read("qualisys", laid("qualisys", tmp_path, ("</cameras>", f"{idle}{lost}</cameras>")))
    assert [(camera.name, camera.pose is None) for camera in rig] == [("26580", False), ("1", True), ("2", True)]


@pytest.mark.parametrize("centre", [(960, 540), (948, 551)])
def test_pixels_undistort_to_the_rays_of_vicon(tmp_path, centre):
    """The truth is Vicon's own direction: from a pixel to its ray. The older key is about the principal point."""
    radial = np.array([-4e-8, 3e-15, -1e-22 if centre == (948, 551) else 0])
    words = " ".join(map(repr, [*map(float, centre), *radial.tolist()]))
    path = laid("vicon", tmp_path, ("<KeyFrame ", f'<KeyFrame VICON_RADIAL2="Vicon3Parameter {words}" '))
    camera = read("vicon", path)[0]["21"]
    pixels = np.stack(np.meshgrid(np.linspace(0, 1919, 15), np.linspace(0, 1079, 9)), axis=-1).reshape(-1, 2)
    offset = pixels - centre
    square = (offset**2).sum(axis=1, keepdims=True)
    straight = centre + offset * (1 + radial[0] * square + radial[1] * square**2 + radial[2] * square**3)
    assert np.linalg.norm(straight - pixels, axis=1).max() > 20
    rays = np.column_stack([(straight - (960, 540)) / 1000, np.ones(len(pixels))])
    np.testing.assert_allclose(camera.lens.project_rays(rays), pixels, atol=0.1)
    if centre == (960, 540):
        path = laid("vicon", tmp_path, ("<KeyFrame ", '<KeyFrame VICON_RADIAL="-4e-08 3e-15" '))
        np.testing.assert_array_equal(read("vicon", path)[0]["21"].lens.distortions, camera.lens.distortions)


def test_what_is_not_read_of_vicon_is_listed(tmp_path):
    idle = '<Camera DEVICEID="7" NAME="" SENSOR_SIZE="9 9"/></Cameras>'
    path = laid("vicon", tmp_path, ("<Camera ", '<Camera TYPE="Vue" '), ("<KeyFrame ", '<KeyFrame IMAGE_ERROR="0.2" '),
                ("</Cameras>", idle))  # fmt: skip
    rig, unread = read("vicon", path)
    assert (rig.names, unread) == (("21",), ("not read: TYPE, camera 7, which is not calibrated (no KeyFrame), IMAGE_ERROR",))


@pytest.mark.parametrize(("form", "old", "new", "loss"), [
    ("motive", f"<IntrinsicStandardCameraModel {example.MOTIVE_LENS}", f"<Intrinsic {example.MOTIVE_BENT}",
     "camera M7: the distortion of Motive's own model is left out"),
    ("qualisys", 'skew="0"', 'skew="128"', "camera 26580: its skew of 2 px is left out"),
    ("vicon", "<KeyFrame ", '<KeyFrame VICON_RADIAL2="ViconRadial2 960 540 1 -1e-08 1e-15" ',
     "camera 21: its distortion 'ViconRadial2' is left out"),
    ("vicon", example.KEYFRAME, 2 * example.KEYFRAME, "camera 21: moves: of its 2 calibrations"),
])  # fmt: skip
def test_what_cannot_be_kept_is_a_loss(tmp_path, form, old, new, loss):
    path = laid(form, tmp_path, (old, new))
    with pytest.raises(InputError, match=f"{loss}.*--lossy"):
        read_rig_as(form, path)
    rig, losses = read_rig_as(form, path, lossy=True)
    assert len(rig) == len(losses) == 1


@pytest.mark.parametrize(("form", "old", "new", "message"), [
    ("biocv", "0 0 0 0 0", "0.1 0.2", "00.calib: the file: holds no width, height"),
    ("biocv", "0.0 1.0 0.0 3000.0", "0.0 -1.0 0.0 3000.0", "the 4 x 4 matrix: .* not a rotation"),
    ("calibio", "CameraModelOpenCV", "CameraModelFisheye", r"cameras\[0\]: its model is 'libCalib::CameraModelFisheye'"),
    ("calibio", '"f": {"val": 1000.0}, ', "", r"cameras\[0\]: f: holds no val"),
    ("motive", 'X="4"', 'X="nan"', "<Extrinsic> X is 'nan': 1 finite number is needed"),
    ("motive", 'OrientMatrix0="1"', 'OrientMatrix0="-1"', "OrientMatrix: .* is not a rotation"),
    ("motive", "<Attributes", "<Else", "<Attributes> is missing"),
    ("opencap", "distortion", np.zeros(3), "distortion is .*an array of 5 finite numbers"),
    ("opencap", "translation", np.array([1, np.nan, 2]), "translation is .*3 finite numbers"),
    ("opencap", "rotation", np.diag([1.0, 1, -1]), "rotation: .*not a rotation"),
    ("qualisys", "<transform", "<transformation", "camera 26580: <transform> is missing"),
    ("qualisys", 'r23="1"', 'r23="0.9"', "is not a rotation"),
    ("qualisys", 'x="4000"', 'x="far"', "<transform> x is 'far'"),
    ("qualisys", 'x="4000"', "", "<transform> has no x"),
    ("qualisys", 'fov_video left="0"', 'fov_video left="4000"', "is not an image"),
    ("qualisys", "camera ", "kamera ", "is not XML"),
    ("qualisys", example.QUALISYS_CAMERA, "", "holds no <camera>"),
    ("qualisys", example.QUALISYS_CAMERA, 2 * example.QUALISYS_CAMERA, "camera 26580 occurs twice"),
    ("vicon", 'FOCAL_LENGTH="1000"', "", "camera 21: <KeyFrame> FOCAL_LENGTH is missing: 1 finite number is needed"),
    ("vicon", 'FOCAL_LENGTH="1000"', 'FOCAL_LENGTH="wide"', "FOCAL_LENGTH is 'wide': 1 finite number is needed"),
    ("vicon", 'SENSOR_SIZE="1920 1080"', 'SENSOR_SIZE="1920"', "SENSOR_SIZE is '1920': 2 finite numbers are needed"),
    ("vicon", 'ORIENTATION="', 'ORIENTATION="9', "a unit quaternion x y z w is needed"),
    ("vicon", "KeyFrames", "Frames", "none of its 1 cameras has a KeyFrame"),
])  # fmt: skip
def test_broken_files_are_refused_with_their_place_and_value(tmp_path, form, old, new, message):
    path = laid(form, tmp_path, (old, new))
    with refused(message, path):
        read(form, path, metres_per_unit=1.0)


@pytest.mark.parametrize(("values", "message"), [
    ([1, 2], "a dict with intrinsicMat"),
    ({key: value for key, value in example.OPENCAP.items() if key != "translation"}, "has rotation alone"),
])  # fmt: skip
def test_pickles_without_what_a_camera_needs_are_refused(tmp_path, values, message):
    (tmp_path / "cam.pickle").write_bytes(pickle.dumps(values))
    with refused(message, tmp_path / "cam.pickle"):
        read("opencap", tmp_path / "cam.pickle")


@pytest.mark.real
def test_a_real_file_of_qualisys_is_the_known_rig(data_root):
    folder = data_root / "pose2sim_single"
    if not (folder / "Calib.qca.txt").exists():
        pytest.skip(f"{folder} is not there")
    rig, _ = read_rig_as("qualisys", folder / "Calib.qca.txt")
    true = read_rig(folder / "rig.toml")
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 1.8), (200, 3))
    for name in true.names:
        np.testing.assert_allclose(rig[name].project(points), true[name].project(points), atol=1e-6)
