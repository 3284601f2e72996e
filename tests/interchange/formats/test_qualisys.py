"""Calibrations of Qualisys Track Manager: axes, units, pixels, parts of the sensor, cameras out of use, broken files."""

import numpy as np
import pytest
from typer.testing import CliRunner

from passerby.cli.main import app
from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from passerby.interchange.rig_toml import read_rig
from support.refusals import refused

# A camera 2 m above the floor at x = 4 m, looking along the world's -x, level: its right is the world's +y, its up is +z, its
# backward is +x. Sensor of 1920 x 1088 pixels; focal length 1600 pixels, centre at (959.5, 543.5).
CAMERA = (
    '<camera active="1" calibrated="true" avg-residual="0.5" serial="26580" model="Miqus Video" viewrotation="0">'
    '<fov_marker left="0" top="0" right="1919" bottom="1087"/><fov_video left="0" top="0" right="1919" bottom="1087"/>'
    '<fov_video_max left="0" top="0" right="1919" bottom="1087"/>'
    '<transform x="4000" y="0" z="2000" r11="0" r12="1" r13="0" r21="0" r22="0" r23="1" r31="1" r32="0" r33="0"/>'
    '<intrinsic focallength="9.3" sensorMinU="0" sensorMaxU="122879" sensorMinV="0" sensorMaxV="69631" focalLengthU="102400" '
    'focalLengthV="102400" centerPointU="61408" centerPointV="34784" skew="0" radialDistortion1="0" radialDistortion2="0" '
    'radialDistortion3="0" tangentalDistortion1="0" tangentalDistortion2="0"/></camera>'
)


def written(folder, *cameras):
    path = folder / "Lab.qca.txt"
    path.write_text(f'<?xml version="1.0"?><calibration source="x"><cameras>{"".join(cameras)}</cameras></calibration>')
    return path


def test_axes_units_and_pixels_by_hand(tmp_path):
    rig, losses = read_rig_as("qualisys", written(tmp_path, CAMERA))
    camera = rig["26580"]
    assert (losses, camera.lens.size) == ((), (1920, 1088))
    np.testing.assert_allclose(camera.centre, (4, 0, 2), atol=1e-12)
    np.testing.assert_allclose(camera.pose.R_cw, [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-12)
    # 4 m ahead, 1 m to the right and 0.5 m down: 400 pixels right of the centre and 200 below.
    np.testing.assert_allclose(camera.project(np.array([[0.0, 1.0, 1.5]])), [[959.5 + 400, 543.5 + 200]], atol=1e-9)
    assert np.isnan(camera.project(np.array([[5.0, 0.0, 2.0]]))).all()  # behind it


def test_distortions_are_not_scaled(tmp_path):
    values = {"radialDistortion1": -0.046, "radialDistortion2": 0.14, "radialDistortion3": 0.01,
              "tangentalDistortion1": 0.0006, "tangentalDistortion2": -0.0004}  # fmt: skip
    text = CAMERA
    for name, value in values.items():
        text = text.replace(f'{name}="0"', f'{name}="{value}"')
    camera = read_rig_as("qualisys", written(tmp_path, text))[0]["26580"]
    np.testing.assert_allclose(camera.lens.distortions, (-0.046, 0.14, 0.0006, -0.0004, 0.01))
    # At x = 0.25, y = 0 (400 pixels to the right) r^2 is 0.0625: factor 1 - 0.002875 + 0.000546875 + 0.00000244.
    x = 0.25 * (1 - 0.046 * 0.0625 + 0.14 * 0.0625**2 + 0.01 * 0.0625**3) - 0.0004 * 3 * 0.0625
    y = 0.0006 * 0.0625
    pixel = camera.project(np.array([[0.0, 1.0, 2.0]]))
    np.testing.assert_allclose(pixel, [[959.5 + 1600 * x, 543.5 + 1600 * y]], atol=1e-6)


def test_the_video_may_show_a_part_of_the_sensor(tmp_path):
    part = CAMERA.replace('fov_video left="0" top="0"', 'fov_video left="100" top="8"')
    camera = read_rig_as("qualisys", written(tmp_path, part))[0]["26580"]
    assert camera.lens.size == (1820, 1080)
    np.testing.assert_allclose(camera.lens.matrix[:2, 2], (859.5, 535.5))
    bare = part.replace("fov_video ", "fov_other ")
    assert read_rig_as("qualisys", written(tmp_path, bare))[0]["26580"].lens.size == (1920, 1088)


def test_smaller_videos_cover_the_sensor(tmp_path):
    path = written(tmp_path, CAMERA.replace('viewrotation="0"', f'viewrotation="0" video_resolution="{"5" * 5000}p"'))
    assert read_rig_as("qualisys", path)[0].names == ("26580",)  # a height of too many digits says nothing
    path = written(tmp_path, CAMERA.replace('viewrotation="0"', 'viewrotation="0" video_resolution="540p"'))
    with pytest.raises(InputError, match="its videos are 540p: give their size with --size"):
        read_rig_as("qualisys", path)
    camera = read_rig_as("qualisys", path, Given(size=(960, 544)))[0]["26580"]
    full = read_rig_as("qualisys", written(tmp_path, CAMERA))[0]["26580"]
    points = np.random.default_rng(0).uniform((-2, -1, 0), (1, 1, 3), (20, 3))
    np.testing.assert_allclose(camera.project(points), (full.project(points) + 0.5) / 2 - 0.5, atol=1e-9)
    with pytest.raises(InputError, match="another shape"):
        read_rig_as("qualisys", path, Given(size=(544, 960)))


def test_cameras_out_of_use_have_no_pose(tmp_path):
    idle = CAMERA.replace('active="1"', 'active="0"').replace("26580", "1")
    lost = CAMERA.replace('calibrated="true"', 'calibrated="false"').replace("26580", "2")
    out = tmp_path / "rig.toml"
    source = str(written(tmp_path, CAMERA, idle, lost))
    result = CliRunner().invoke(app, ["import", source, "--format", "qualisys", "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert [(camera.name, camera.pose is None) for camera in read_rig(out)] == [("26580", False), ("1", True), ("2", True)]


def test_skew_is_a_loss(tmp_path):
    path = written(tmp_path, CAMERA.replace('skew="0"', 'skew="128"'))
    with pytest.raises(InputError, match=r"camera 26580: its skew of 2 px is left out.*--lossy"):
        read_rig_as("qualisys", path)
    assert len(read_rig_as("qualisys", path, lossy=True)[1]) == 1


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("<transform", "<transformation", "camera 26580: <transform> is missing"),
        ('r23="1"', 'r23="0.9"', "is not a rotation"),
        ('x="4000"', 'x="far"', "<transform> x is 'far'"),
        ('x="4000"', "", "<transform> has no x"),
        ('fov_video left="0"', 'fov_video left="4000"', "is not an image"),
        ("camera ", "kamera ", "is not XML"),
        (CAMERA, "", "holds no <camera>"),
        (CAMERA, 2 * CAMERA, "camera 26580 occurs twice"),
    ],
)
def test_broken_files_are_told(tmp_path, old, new, match):
    path = written(tmp_path, CAMERA.replace(old, new))
    with refused(match, "Lab.qca.txt"):
        read_rig_as("qualisys", path)


@pytest.mark.real
def test_a_real_file_is_the_known_rig(data_root):
    folder = data_root / "pose2sim_single"
    if not (folder / "Calib.qca.txt").exists():
        pytest.skip(f"{folder} is not there")
    rig, _ = read_rig_as("qualisys", folder / "Calib.qca.txt")
    true = read_rig(folder / "rig.toml")
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 1.8), (200, 3))
    for name in true.names:
        np.testing.assert_allclose(rig[name].project(points), true[name].project(points), atol=1e-6)
