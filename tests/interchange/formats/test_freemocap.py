import tomllib

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.refusals import refused
from support.scenes.handmade_rigs import SIZE, facing, read_back, turned_rig, written

# As FreeMoCap 1.8.2 dumps a group of cameras (toml 0.10.2).
DUMPED = """\
[cam_0]
name = "Camera_000_synchronized"
size = [ 1280, 720,]
matrix = [ [ 900.5, 0.0, 639.5,], [ 0.0, 900.5, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.05, 0.0, 0.0, 0.0, 0.0,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]
world_orientation = [ [ 1.0, 0.0, 0.0,], [ 0.0, 1.0, 0.0,], [ 0.0, 0.0, 1.0,],]
world_position = [ 0.0, 0.0, 0.0,]

[cam_1]
name = "Camera_001_synchronized"
size = [ 1280, 720,]
matrix = [ [ 910.0, 0.0, 639.5,], [ 0.0, 910.0, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.04, 0.0, 0.0, 0.0, 0.0,]
rotation = [ 0.0, 0.5, 0.0,]
translation = [ -500.0, 0.0, 250.0,]

[metadata]
charuco_square_size = 54.0
charuco_board_object = "CharucoBoardDefinition(name='charuco_7x5')"
path_to_recorded_videos = "synchronized_videos"
date_time_calibrated = "2026-01-01T00:00:00"
groundplane_calibration = false
"""


def test_a_camera_at_a_known_place(tmp_path):
    written("freemocap", Rig((facing("north", distortions=(-0.1, 0.02, 0.001, -0.002)),)), tmp_path / "rig.toml")
    content = tomllib.loads((tmp_path / "rig.toml").read_text())
    table = content["cam_0"]
    np.testing.assert_allclose(table["rotation"], [np.pi / 2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(table["translation"], [-4000, 2500, 3000], atol=1e-9)
    np.testing.assert_allclose(table["world_position"], [4000, -3000, 2500], atol=1e-9)
    # Columns: the camera's right, down and forward in the world.
    np.testing.assert_allclose(table["world_orientation"], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    assert (table["name"], table["size"], table["distortions"]) == ("north", list(SIZE), [-0.1, 0.02, 0.001, -0.002, 0.0])
    assert content["metadata"]["groundplane_calibration"] is True


def test_tables_are_in_the_order_of_the_videos(tmp_path):
    """FreeMoCap sorts the keys as text, and the videos by their names in small letters: the two must go together."""
    names = [f"{letter}{index}" for letter in ("b", "A", "c") for index in range(4)]
    written("freemocap", turned_rig(names), tmp_path / "rig.toml")
    content = tomllib.loads((tmp_path / "rig.toml").read_text())
    keys = sorted(key for key in content if key != "metadata")
    assert [content[key]["name"] for key in keys] == sorted(names, key=str.lower)


def test_a_file_of_freemocap(tmp_path):
    (tmp_path / "c.toml").write_text(DUMPED)
    rig, _ = read_back("freemocap", tmp_path / "c.toml")
    assert rig.names == ("Camera_000_synchronized", "Camera_001_synchronized")
    pose = rig["Camera_001_synchronized"].pose
    np.testing.assert_allclose(pose.t_cw, [-0.5, 0, 0.25])
    np.testing.assert_allclose(pose.R_cw, cv2.Rodrigues(np.array([0, 0.5, 0]))[0])
    (tmp_path / "c.toml").write_text(DUMPED.replace("= 54.0", "= 1"))
    with pytest.raises(InputError, match=r"c.toml: lengths are in squares of the board.*--units"):
        read_back("freemocap", tmp_path / "c.toml")
    rig, _ = read_back("freemocap", tmp_path / "c.toml", metres_per_unit=0.001)
    np.testing.assert_allclose(rig["Camera_001_synchronized"].pose.t_cw, [-0.5, 0, 0.25])


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        (DUMPED, "", "is not a calibration of FreeMoCap"),
        ("[cam_0]", "[cam_0", "is not TOML"),
        ("Camera_001", "Camera_000", "camera Camera_000_synchronized occurs twice"),
        ("[metadata]", '[metadata]\nunits = "ft"', r"\[metadata\] units is 'ft': write one of m, cm, mm"),
    ],
)
def test_bad_files(tmp_path, old, new, match):
    path = tmp_path / "c.toml"
    path.write_text(DUMPED.replace(old, new))
    with refused(match, path):
        read_back("freemocap", path)
