"""OpenCap's pickles: values by hand, sessions, intrinsics alone, and pickles that would run something."""

import os
import pickle

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from support.refusals import refused
from support.scenes.handmade_rigs import LOOKING_NORTH, MATRIX, PIXELS, POINTS, SIZE, TRANSLATION

VALUES = {
    "distortion": np.zeros((1, 5)),
    "intrinsicMat": MATRIX,
    "imageSize": np.array([[float(SIZE[1])], [float(SIZE[0])]]),
    "rotation": LOOKING_NORTH,
    "translation": 1000 * np.reshape(TRANSLATION, (3, 1)),
    "rotation_EulerAngles": np.array([[np.pi / 2], [0], [0]]),
}


def dumped(path, values, protocol=4):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(values, protocol))
    return path


def test_points_by_hand(tmp_path):
    given = Given()
    rig, _ = read_rig_as("opencap", dumped(tmp_path / "cam.pickle", VALUES), given)
    assert (rig.names, rig["cam"].lens.size) == (("cam",), SIZE)
    np.testing.assert_allclose(rig["cam"].project(POINTS), PIXELS, atol=1e-6)
    assert given.unread.told == ()


def test_a_session_has_a_folder_for_each_camera(tmp_path):
    for name in ("Cam10", "Cam2"):
        dumped(tmp_path / "Videos" / name / "cameraIntrinsicsExtrinsics.pickle", VALUES)
    for place in (tmp_path, tmp_path / "Videos"):
        assert read_rig_as("opencap", place)[0].names == ("Cam2", "Cam10")


def test_intrinsics_alone_and_what_is_not_read(tmp_path):
    values = {key: value for key, value in VALUES.items() if not key.startswith(("rotation", "translation"))}
    given = Given()
    rig, _ = read_rig_as("opencap", dumped(tmp_path / "cam.pickle", values | {"rms": 0.2}), given)
    assert rig["cam"].pose is None
    assert given.unread.told == ("not read: rms",)


class Trap:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("protocol", range(6))
def test_nothing_in_a_pickle_runs(tmp_path, protocol):
    path = dumped(tmp_path / "cam.pickle", VALUES | {"rotation": Trap(tmp_path / "sprung")}, protocol)
    with pytest.raises(InputError, match=r"cam.pickle: the file: is not a calibration of OpenCap: it asks for posix.mkdir"):
        read_rig_as("opencap", path)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ([1, 2], "a dict with intrinsicMat"),
        (VALUES | {"distortion": np.zeros(3)}, "distortion is .*an array of 5 finite numbers"),
        (VALUES | {"translation": np.array([1, np.nan, 2])}, "translation is .*3 finite numbers"),
        (VALUES | {"rotation": np.diag([1.0, 1, -1])}, "rotation: .*not a rotation"),
        ({key: value for key, value in VALUES.items() if key != "translation"}, "has rotation alone"),
    ],
)
def test_bad_values(tmp_path, values, match):
    with refused(match, tmp_path):
        read_rig_as("opencap", dumped(tmp_path / "cam.pickle", values))
