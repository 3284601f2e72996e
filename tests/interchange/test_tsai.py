"""Cameras calibrated by Tsai's method: OpenCV's lens draws what Tsai's does, over the whole picture; poses; broken files."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.core.cameras import Pose
from passerby.interchange.formats.tsai import WORST_PX, fit_distortions, is_tsai, read_tsai
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
def test_opencv_lens_draws_what_tsai_draws(tmp_path, kappa1, sx):
    tsai = camera(kappa1, sx)
    pixels = whole_picture(tsai.size)
    found = read_tsai(written(tmp_path, tsai)).camera("c0")
    assert np.abs(found.project(seen_at(tsai, pixels)) - pixels).max() < 0.02  # 0.1 px is the bound that is promised
    back = found.lens.bearings(pixels)
    true = (seen_at(tsai, pixels) - tsai.pose.centre) @ tsai.pose.R_cw.T
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert np.arccos(np.clip((back * true).sum(axis=1), -1, 1)).max() * found.lens.focal < 0.1


def test_pose_is_metres_and_rz_ry_rx(tmp_path):
    tsai = camera(5.7e-4)
    found = read_tsai(written(tmp_path, tsai)).camera("c0")
    assert np.allclose(found.pose.R_cw, tsai.pose.R_cw, atol=1e-9)
    assert np.allclose(found.centre, tsai.pose.centre, atol=1e-9)


def test_smaller_pictures_cover_the_calibrated_one(tmp_path):
    tsai = camera(5.7e-4)
    pixels = whole_picture(tsai.size)
    found = read_tsai(written(tmp_path, tsai)).camera("c0", (360, 288))
    assert found.lens.size == (360, 288)
    assert np.abs(found.project(seen_at(tsai, pixels)) - ((pixels + 0.5) / 2 - 0.5)).max() < 0.02


def test_nobody_outside_the_view_is_drawn_inside_the_picture(tmp_path):
    tsai = camera(5.7e-4)
    lens = read_tsai(written(tmp_path, tsai)).lens()
    angles = np.radians(np.linspace(0, 79, 400))
    drawn = lens.project_rays(np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))[:, 0]
    assert (np.diff(drawn) > 0).all()


def test_distortion_that_opencv_cannot_express_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"camera c0: .*terrace-tsai-c0.xml: kappa1 0.5 .* misses by [0-9.]+ px"):
        read_tsai(written(tmp_path, camera(0.5))).camera("c0")
    with pytest.raises(InputError, match="turns back inside the image"):
        read_tsai(written(tmp_path, camera(-1e-2))).camera("c0")


@pytest.mark.parametrize(("old", "new"), [('kappa1="5e-4"', 'kappa1="1e9"'), ('cx="360"', 'cx="1e12"')])
def test_numbers_of_another_unit_are_told(tmp_path, old, new):
    (tmp_path / "a.xml").write_text(SOUND.replace(old, new))
    with pytest.raises(
        InputError, match=r"camera c0: .*a\.xml: its numbers do not describe a lens: are focal, dpx and dpy in mil"
    ):
        read_tsai(tmp_path / "a.xml").camera("c0")


def test_the_error_told_is_the_error_made():
    kappa, radius, focal = 5.0, 0.7, 1000.0
    k, told = fit_distortions(kappa, radius, focal)
    drawn = np.linspace(0, radius, 1777)
    u2 = (drawn * (1 + kappa * drawn**2)) ** 2
    ratio = (1 + u2 * (k[0] + u2 * (k[1] + u2 * k[4]))) / (1 + u2 * (k[5] + u2 * (k[6] + u2 * k[7])))
    made = focal * np.abs(drawn * (1 + kappa * drawn**2) * ratio - drawn).max()
    assert told > WORST_PX
    assert made == pytest.approx(told, rel=0.02)


SOUND = (
    '<Camera><Geometry width="720" height="576" ncx="576" nfx="576" dx="0.023" dy="0.023" dpx="0.023" dpy="0.023"/>'
    '<Intrinsic focal="20" kappa1="5e-4" cx="360" cy="288" sx="1"/><Extrinsic tx="0" ty="0" tz="9e3" rx="0" ry="0" rz="0"/>'
    "</Camera>"
)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('focal="20"', "", "<Intrinsic> has no focal"),
        ('focal="20"', 'focal="wide"', "<Intrinsic> focal is 'wide'"),
        ('focal="20"', 'focal="1e200"', "<Intrinsic> focal is 1e+200: a number from 1e-09 to 1e+09"),
        ('dpx="0.023"', 'dpx="-1"', "<Geometry> dpx is -1"),
        ('tz="9e3"', 'tz="nan"', "<Extrinsic> tz is 'nan'"),
        ("<Extrinsic ", "<Extrinsik ", "<Extrinsic> is missing"),
        ("Camera>", "Photo>", "holds no <Camera>"),
        (SOUND, "", "is not XML"),
    ],
)
def test_broken_files_are_told(tmp_path, old, new, told):
    path = tmp_path / "View_001.xml"
    path.write_text(SOUND.replace(old, new))
    with refused(re.escape(told), path):
        read_tsai(path)


def test_missing_file_and_other_xml(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_tsai(tmp_path / "none.xml")
    assert not is_tsai(tmp_path / "none.xml")
    (tmp_path / "boxes.xml").write_text("<dataset><frame/></dataset>")
    assert not is_tsai(tmp_path / "boxes.xml")
