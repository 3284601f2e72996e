"""Cameras calibrated by Tsai's method: OpenCV's lens draws what Tsai's does, over the whole picture; files and folders."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.core.cameras import Pose
from passerby.interchange.formats import Given, read_rig_as
from passerby.interchange.formats.tsai import fit_distortions, is_tsai, read_tsai
from support.datasets.tsai import Tsai
from support.refusals import refused


def camera(kappa1, sx=1.0, size=(720, 576), focal=20.16, **other):
    rng = np.random.default_rng(5)
    pose = Pose(Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), rng.normal(size=3) * 5)
    return Tsai(size=size, focal=focal, kappa1=kappa1, cx=366.5, cy=305.8, sx=sx, pose=pose, **other)


def written(folder, tsai):
    (folder / "terrace-tsai-c0.xml").write_text(tsai.xml())
    return folder / "terrace-tsai-c0.xml"


def whole_picture(size, step=12):
    """(N, 2) pixels, the outer edge of the picture among them."""
    x, y = (np.linspace(-0.5, extent - 0.5, extent // step) for extent in size)
    return np.array(np.meshgrid(x, y)).reshape(2, -1).T


def seen_at(tsai, pixels):
    """(N, 3) points of the world that Tsai's camera draws at pixels: its polynomial goes this way without being solved."""
    sensor = (pixels - (tsai.cx, tsai.cy)) * (tsai.dpx / tsai.sx, tsai.dpy)
    plane = sensor * (1 + tsai.kappa1 * (sensor**2).sum(axis=1, keepdims=True)) / tsai.focal
    inside = np.column_stack([plane, np.ones(len(plane))]) * np.linspace(2, 90, len(plane))[:, None]
    return (inside - tsai.pose.t_cw) @ tsai.pose.R_cw


@pytest.mark.parametrize(("kappa1", "sx"), [(0.0, 1.04), (5.7e-4, 1.0), (6e-3, 1.04), (-5e-4, 1.04)])
def test_the_lens_of_opencv_draws_what_tsai_draws(tmp_path, kappa1, sx):
    tsai = camera(kappa1, sx)
    pixels = whole_picture(tsai.size)
    calibrated = read_tsai(written(tmp_path, tsai))
    found = calibrated.camera("c0")
    assert np.allclose(found.pose.R_cw, tsai.pose.R_cw, atol=1e-9)
    assert np.allclose(found.centre, tsai.pose.centre, atol=1e-9)
    assert np.abs(found.project(seen_at(tsai, pixels)) - pixels).max() < 0.02  # 0.1 px is the bound that is promised
    back = found.lens.bearings(pixels)
    true = (seen_at(tsai, pixels) - tsai.pose.centre) @ tsai.pose.R_cw.T
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert np.arccos(np.clip((back * true).sum(axis=1), -1, 1)).max() * found.lens.focal < 0.1
    if kappa1 != 5.7e-4:
        return
    # Smaller pictures cover the calibrated one, and what is outside the view is drawn outside the picture.
    small = calibrated.camera("c0", (360, 288))
    assert small.lens.size == (360, 288)
    assert np.abs(small.project(seen_at(tsai, pixels)) - ((pixels + 0.5) / 2 - 0.5)).max() < 0.02
    angles = np.radians(np.linspace(0, 79, 400))
    drawn = found.lens.project_rays(np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))[:, 0]
    assert (np.diff(drawn) > 0).all()


def test_distortion_that_opencv_cannot_express_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"camera c0: .*terrace-tsai-c0.xml: kappa1 0.5 .* misses by [0-9.]+ px"):
        read_tsai(written(tmp_path, camera(0.5))).camera("c0")
    with pytest.raises(InputError, match="turns back inside the image"):
        read_tsai(written(tmp_path, camera(-1e-2))).camera("c0")


def test_the_stated_error_is_the_error_made():
    kappa, radius, focal = 5.0, 0.7, 1000.0
    k, stated = fit_distortions(kappa, radius, focal)
    drawn = np.linspace(0, radius, 1777)
    u2 = (drawn * (1 + kappa * drawn**2)) ** 2
    ratio = (1 + u2 * (k[0] + u2 * (k[1] + u2 * k[4]))) / (1 + u2 * (k[5] + u2 * (k[6] + u2 * k[7])))
    made = focal * np.abs(drawn * (1 + kappa * drawn**2) * ratio - drawn).max()
    assert stated > 0.1
    assert made == pytest.approx(stated, rel=0.02)


SOUND = (
    '<Camera><Geometry width="720" height="576" ncx="576" nfx="576" dx="0.023" dy="0.023" dpx="0.023" dpy="0.023"/>'
    '<Intrinsic focal="20" kappa1="5e-4" cx="360" cy="288" sx="1"/><Extrinsic tx="0" ty="0" tz="9e3" rx="0" ry="0" rz="0"/>'
    "</Camera>"
)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('focal="20"', "", "<Intrinsic> has no focal"),
    ('focal="20"', 'focal="wide"', "<Intrinsic> focal is 'wide'"),
    ('focal="20"', 'focal="1e200"', "<Intrinsic> focal is 1e+200: a number from 1e-09 to 1e+09"),
    ('tz="9e3"', 'tz="nan"', "<Extrinsic> tz is 'nan'"),
    ("<Extrinsic ", "<Extrinsik ", "<Extrinsic> is missing"),
    ("Camera>", "Photo>", "holds no <Camera>"),
    (SOUND, "", "is not XML"),
    ('kappa1="5e-4"', 'kappa1="1e9"', "its numbers do not describe a lens: are focal, dpx and dpy in mil"),
    ('cx="360"', 'cx="1e12"', "its numbers do not describe a lens: are focal, dpx and dpy in mil"),
])  # fmt: skip
def test_broken_files_are_refused(tmp_path, old, new, message):
    path = tmp_path / "View_001.xml"
    path.write_text(SOUND.replace(old, new))
    with refused(re.escape(message), path):
        read_tsai(path).camera("c0")


def test_other_files_of_xml_are_no_cameras(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_tsai(tmp_path / "none.xml")
    assert not is_tsai(tmp_path / "none.xml")
    (tmp_path / "boxes.xml").write_text("<dataset><frame/></dataset>")
    assert not is_tsai(tmp_path / "boxes.xml")


def plain_camera(tz="9000", name="", width=720):
    called = f' name="{name}"' if name else ""
    # 20 mm on pixels of 0.02 mm: a focal length of 1000 pixels.
    return (
        f'<Camera{called}><Geometry width="{width}" height="576" ncx="1" nfx="1" dx="1" dy="1" dpx="0.02" dpy="0.02"/>'
        '<Intrinsic focal="20" kappa1="0" cx="360" cy="288" sx="1"/>'
        f'<Extrinsic tx="1000" ty="-2000" tz="{tz}" rx="0" ry="0" rz="1.5707963267948966"/></Camera>'
    )


def test_cameras_of_files_are_called_as_they_are_and_see_what_they_should(tmp_path):
    (tmp_path / "View_001.xml").write_text(plain_camera())
    rig, losses = read_rig_as("tsai", tmp_path / "View_001.xml")
    assert (rig.names, losses) == (("View_001",), ())
    # x_c = Rz(90 degrees) X + t: the world's x becomes the camera's y. X = (2, 0, 1) m lies at (1, -2 + 2, 10) m.
    np.testing.assert_allclose(rig["View_001"].project(np.array([[2.0, 0.0, 1.0]])), [[360 + 1000 * 0.1, 288.0]], atol=1e-9)
    (tmp_path / "rig.xml").write_text(f"<Cameras>{plain_camera()}{plain_camera('8000')}{plain_camera(name='door')}</Cameras>")
    rig, _ = read_rig_as("tsai", tmp_path / "rig.xml")
    assert [(c.name, c.pose.t_cw[2]) for c in rig] == [("rig_1", 9), ("rig_2", 8), ("door", 9)]


def test_a_folder_of_files_has_a_camera_for_each_in_other_units_and_sizes(tmp_path):
    for number in (2, 1):
        (tmp_path / f"View_00{number}.xml").write_text(plain_camera(str(1000 * number)))
    (tmp_path / "boxes.xml").write_text("<dataset/>")
    (tmp_path / "readme.txt").write_text("")
    rig, _ = read_rig_as("tsai", tmp_path)
    assert rig.names == ("View_001", "View_002")
    np.testing.assert_allclose(rig["View_002"].pose.t_cw, (1, -2, 2))
    rig, _ = read_rig_as("tsai", tmp_path, Given(size=(360, 288), metres_per_unit=1.0))
    np.testing.assert_allclose(rig["View_001"].pose.t_cw, (1000, -2000, 1000))
    assert rig["View_001"].lens.size == (360, 288)
    np.testing.assert_allclose(rig["View_001"].lens.matrix[0], (500, 0, 360.5 / 2 - 0.5))


def test_broken_rigs_are_refused(tmp_path):
    with pytest.raises(InputError, match="holds no XML file with a <Camera>"):
        read_rig_as("tsai", tmp_path)
    (tmp_path / "a.xml").write_text(plain_camera(name="door"))
    (tmp_path / "b.xml").write_text(plain_camera(name="door"))
    with pytest.raises(InputError, match="camera door is in another file"):
        read_rig_as("tsai", tmp_path)
    (tmp_path / "c.xml").write_text(f"<r>{plain_camera(name='1')}{plain_camera(name='1')}</r>")
    with pytest.raises(InputError, match=r"c\.xml: two cameras are called 1"):
        read_rig_as("tsai", tmp_path / "c.xml")
    with pytest.raises(InputError, match="another shape"):
        read_rig_as("tsai", tmp_path / "a.xml", Given(size=(640, 360)))
