"""Rig files: round trips, the files of other tools, and every fault."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.interchange.rig_toml import read_lens, read_rig, write_rig
from support.refusals import refused

LENS = """size = [1920, 1080]
matrix = [[1000.0, 0.0, 960.0], [0.0, 1000.0, 540.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.0, 0.0, 0.0, 0.0]
"""
POSE = "rotation = [0.1, 0.2, 0.3]\ntranslation = [1.0, 2.0, 3.0]\n"
SIGMAS = "position_sigma_mm = 20\norientation_sigma_deg = 0.1\n"


def write(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    return path


def test_cameras_and_their_lenses_are_read(tmp_path):
    rig = read_rig(
        write(tmp_path, f'[left]\nname = "L"\n{LENS}{POSE}fisheye = false\n[right]\n{LENS}[metadata]\nunits = "m"\n')
    )
    assert (rig.names, rig["L"].lens.size) == (("L", "right"), (1920, 1080))
    np.testing.assert_allclose(rig["L"].pose.R_cw, cv2.Rodrigues(np.array([0.1, 0.2, 0.3]))[0])
    assert rig["L"].pose.t_cw.tolist() == [1, 2, 3]
    assert rig["right"].pose is None
    rig = read_rig(write(tmp_path, f'[a]\n{LENS}{POSE}[metadata]\nunits = "mm"\n'))
    np.testing.assert_allclose(rig["a"].pose.t_cw, [0.001, 0.002, 0.003])
    # Caliscope has tables that are no cameras and keys that no other tool has.
    other = f"save_path = 'x'\n[overlays]\nsize = 3\n[cam_1]\ncam_id = 1\n{LENS}{POSE}rotation_count = 0\nignore = false\n"
    (camera,) = read_rig(write(tmp_path, other))
    assert (camera.name, camera.pose is None) == ("cam_1", False)
    # A lens that is uncalibrated without a sigma may be anything.
    rig = read_rig(write(tmp_path, f"[a]\n{LENS}uncalibrated = true\n[b]\n{LENS}focal_sd_percent = 5\n"))
    assert (rig["a"].lens.focal_sd, rig["b"].lens.focal_sd) == (LARGEST_FOCAL_SD, pytest.approx(0.05))


@pytest.mark.parametrize(("text", "message"), [
    ("x = ", "is not TOML"),
    ("[metadata]\nunits = 'm'", "holds no camera"),
    (f"[a]\n{LENS}".replace("size = [1920, 1080]\n", ""), r"\[a\]: size is missing: give \[width, height\]"),
    (f"[a]\n{LENS}".replace("1920,", "1920.5,"), r"whole numbers of pixels"),
    (f"[a]\n{LENS}".replace("[0.0, 0.0, 1.0]]", "[0.0, 0.0]]"), r"matrix is .*three rows of three"),
    (f"[a]\n{LENS}".replace("[0.0, 0.0, 1.0]]", "[0.0, 0.0, 2.0]]"), r"is not a camera matrix"),
    (f"[a]\n{LENS}".replace("0.1,", "nan,"), r"distortions is .*finite"),
    (f"[a]\n{LENS}".replace("0.1, 0.0, 0.0, 0.0,", "0.1, 0.0,"), r"distortions has 3 values; a pinhole lens"),
    (f"[a]\n{LENS}fisheye = true", r"distortions has 5 values; a fisheye lens takes 0, 4"),
    (f'[a]\n{LENS}fisheye = "no"', r"fisheye is 'no': write true or false"),
    (f"[a]\n{LENS}rotation = [0.1, 0.2, 0.3]", r"has a rotation but no translation"),
    (f"[a]\n{LENS}rotation = [0, 0, 1e6]\ntranslation = [0, 0, 0]", r"\[a\]: .*a Rodrigues vector in radians is needed"),
    (f"[a]\n{LENS}rotation = [0.1, 0.2]\ntranslation = [0, 0, 0]", r"rotation is \[0.1, 0.2\]"),
    (f"[a]\n{LENS}rotation = [[1,0,0],[0,1,0],[0,0,2]]\ntranslation = [0, 0, 0]", r"is not a rotation"),
    (f'[a]\nname = "n"\n{LENS}[b]\nname = "n"\n{LENS}', r"camera n occurs twice"),
    (f'[a]\nname = ""\n{LENS}', r"\[a\]: name is '': give the camera's name in quotes"),
    (f"[a]\n{LENS}focal_sd_percent = 0", r"\[a\]: focal_sd_percent is 0: give a number above 0, up to"),
    (f"[a]\n{LENS}position_sigma_mm = -1", r"\[a\]: position_sigma_mm is -1: give a number from 0 on"),
    (f"[a]\n{LENS}{SIGMAS}covariance = {np.arange(36).reshape(6, 6).tolist()}", r"\[a\]: covariance is not symmetric"),
    (f"[a]\n{LENS}{SIGMAS}covariance = {(1e300 * np.eye(6)).tolist()}", r"\[a\]: covariance has a value of 1e\+300"),
    (f"[a]\n{LENS}{SIGMAS}covariance = {np.diag([1, 1, 1, 1, 1, -1]).tolist()}", r"has a negative variance \(-1\)"),
    ("[A]\n" + LENS.replace("[1000.0", '["FX"').replace(" 1000.0", ' "FY"'), r"\[A\]: matrix still says FX and FY: put"),
    (f'[a]\n{LENS}{POSE}[metadata]\nunits = "ft"\n', "units is 'ft': write one of m, cm, mm"),
    (f'[a]\n{LENS}uncalibrated = "yes"', r"\[a\]: uncalibrated is 'yes': write true or false"),
])  # fmt: skip
def test_a_fault_names_file_table_value_and_mend(tmp_path, text, message):
    with refused(message, tmp_path / "rig.toml"):
        read_rig(write(tmp_path, text))


def test_one_lens_is_found_by_table_or_by_name(tmp_path):
    path = write(tmp_path, f'[cam_0]\nname = "left"\n{LENS}[broken]\nmatrix = 3\n')
    assert (read_lens(path, "cam_0").size, read_lens(path, "left").size) == ((1920, 1080), (1920, 1080))
    with pytest.raises(InputError, match=r"no table \[right\]: .*the file has cam_0, broken"):
        read_lens(path, "right")
    with pytest.raises(InputError, match=r"\[broken\]: size is missing"):
        read_lens(path, "broken")


finite = st.floats(-100, 100)
vectors = st.tuples(finite, finite, finite)


@given(vectors, vectors, st.sampled_from([0, 4, 5, 8, 12, 14]), st.booleans())
def test_a_rig_comes_back(tmp_path_factory, turn, shift, count, with_sigma):
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]]), np.linspace(-0.1, 0.1, count))
    sigma = PoseSigma(0.0123, 0.45, 40 * np.eye(6) + np.add.outer(np.arange(6.0), np.arange(6.0))) if with_sigma else None
    posed = Camera("a b.c", lens, Pose(Rotation.from_rotvec(turn).as_matrix(), shift), sigma)
    fisheye = Camera("2", Lens((640, 480), lens.matrix, np.array([0.1, 0, 0, 0]), fisheye=True))
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    write_rig(path, Rig((posed, fisheye), "doubtful", {"source": "test"}))
    back = read_rig(path)
    assert (back.names, back.verdict, back.metadata) == (("a b.c", "2"), "doubtful", {"source": "test"})
    assert back["2"].pose is None
    assert back["2"].lens.fisheye
    np.testing.assert_allclose(back["a b.c"].pose.R_cw, posed.pose.R_cw, atol=1e-12)
    assert (back["a b.c"].pose.t_cw.tolist(), back["a b.c"].lens.matrix.tolist()) == (list(shift), lens.matrix.tolist())
    # No coefficients are written as zeros, which other tools need: the same lens.
    assert back["a b.c"].lens.distortions.tolist() == (lens.distortions.tolist() or [0.0] * 5)
    if sigma is not None:
        assert (back["a b.c"].sigma.position_m, back["a b.c"].sigma.orientation_deg) == (pytest.approx(0.0123), 0.45)
        assert back["a b.c"].sigma.covariance.tolist() == sigma.covariance.tolist()


def test_a_reserved_name_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be called metadata"):
        write_rig(tmp_path / "rig.toml", Rig((Camera("metadata", Lens.unknown((640, 480))),)))
    assert not (tmp_path / "rig.toml").exists()


@pytest.mark.parametrize("lens", [Lens.unknown((1280, 720)), Lens.unknown((640, 480), hfov_deg=200.0, fisheye=True)])
def test_an_unknown_lens_comes_back_as_one(tmp_path, lens):
    """The stand-in for it is no intrinsics: a calibration that reads the file estimates it."""
    path = tmp_path / "rig.toml"
    write_rig(path, Rig((Camera("A", lens), Camera("B", replace(lens, uncalibrated=False)))))
    assert path.read_text().count("uncalibrated = true") == 1
    back = read_lens(path, "A")
    assert (back.size, back.fisheye, back.uncalibrated) == (lens.size, lens.fisheye, True)
    assert (back.focal, back.focal_sd) == (pytest.approx(lens.focal), pytest.approx(lens.focal_sd))
    assert not read_lens(path, "B").uncalibrated


def test_sigmas_that_are_infinite_are_not_written(tmp_path):
    """TOML's inf is no sigma that another tool could use; a camera without any has none when it is read."""
    lens, pose, covariance = Lens.unknown((640, 480)), Pose(np.eye(3), np.zeros(3)), np.full((6, 6), np.inf)
    sigmas = {"a": (np.inf, 0.5), "b": (0.25, np.inf), "c": (np.inf, np.inf)}
    write_rig(tmp_path / "rig.toml", Rig(tuple(Camera(n, lens, pose, PoseSigma(*s, covariance)) for n, s in sigmas.items())))
    assert "inf" not in (tmp_path / "rig.toml").read_text()
    back = read_rig(tmp_path / "rig.toml")
    assert (back["a"].sigma.orientation_deg, np.isfinite(back["a"].sigma.position_m)) == (0.5, False)
    assert (back["b"].sigma.position_m, np.isfinite(back["b"].sigma.orientation_deg)) == (0.25, False)
    assert back["c"].sigma is None
