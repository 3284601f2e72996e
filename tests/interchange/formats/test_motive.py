"""OptiTrack Motive's .mcal: UTF-16, axes with y up, the standard and the own lens model, the binary .cal."""

import re

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from support.refusals import refused
from support.scenes.handmade_rigs import CENTRE, PIXELS, POINTS

# The camera of the shared handmade rig: at (4, -3, 2.5), level, looking along this world's +y. In Motive's world (y up) this
# world's (x, y, z) is (x, z, -y): the camera is at (4, 2.5, 3) and looks along -z, so its axes are the world's.
CAMERA = (
    '<Camera Serial="M7"><Properties CameraID="1"/><Attributes ImagerPixelWidth="1920" ImagerPixelHeight="1080"/>{lens}'
    '<Extrinsic X="4" Y="2.5" Z="3" OrientMatrix0="1" OrientMatrix1="0" OrientMatrix2="0" OrientMatrix3="0" OrientMatrix4="1" '
    'OrientMatrix5="0" OrientMatrix6="0" OrientMatrix7="0" OrientMatrix8="1"/></Camera>'
)
NUMBERS = 'HorizontalFocalLength="1000" VerticalFocalLength="1100" LensCenterX="960" LensCenterY="540"'
BENT = f'{NUMBERS} k1="-0.1" k2="0.02" k3="0.003" TangentialX="0.001" TangentialY="-0.002"'


def mcal(folder, lens=f"<IntrinsicStandardCameraModel {NUMBERS}/>", encoding="utf-16", camera=CAMERA):
    text = f'<?xml version="1.0" encoding="UTF-16LE"?><calibrationProfile><Calibration><Cameras>{camera.format(lens=lens)}'
    path = folder / "lab.mcal"
    path.write_bytes(f"{text}</Cameras></Calibration></calibrationProfile>".encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8"])
def test_a_camera_at_a_known_place(tmp_path, encoding):
    given = Given()
    camera = read_rig_as("motive", mcal(tmp_path, encoding=encoding), given)[0]["M7"]
    np.testing.assert_allclose(camera.centre, CENTRE, atol=1e-12)
    np.testing.assert_allclose(camera.project(POINTS), PIXELS, atol=1e-6)
    assert given.unread.told == ("not read: Properties",)


def test_the_orientation_is_from_camera_to_world_row_by_row(tmp_path):
    turned = CAMERA
    for index, value in enumerate((0, 0, -1, 0, 1, 0, 1, 0, 0)):
        turned = re.sub(rf'OrientMatrix{index}="\d"', f'OrientMatrix{index}="{value}"', turned)
    camera = read_rig_as("motive", mcal(tmp_path, camera=turned))[0]["M7"]
    ahead = np.array(CENTRE) + [10.0, 0, 0]
    np.testing.assert_allclose(camera.project(ahead[None]), [[960, 540]], atol=1e-6)
    np.testing.assert_allclose(camera.project(ahead[None] + [0, -1.0, 0]), [[1060, 540]], atol=1e-6)


def test_distortions(tmp_path):
    lens = read_rig_as("motive", mcal(tmp_path, f"<IntrinsicStandardCameraModel {BENT}/>"))[0]["M7"].lens
    np.testing.assert_array_equal(lens.distortions, [-0.1, 0.02, 0.001, -0.002, 0.003])
    with pytest.raises(InputError, match=r"camera M7: the distortion of Motive's own model is left out.*--lossy"):
        read_rig_as("motive", mcal(tmp_path, f"<Intrinsic {BENT}/>"))


def test_a_binary_calibration_says_what_to_save_instead(tmp_path):
    path = tmp_path / "lab.cal"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(InputError, match=r"lab.cal: is a binary calibration.*Motive 3 and save it as .mcal"):
        read_rig_as("motive", path)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('X="4"', 'X="nan"', "<Extrinsic> X is 'nan': 1 finite number is needed"),
        ('OrientMatrix0="1"', 'OrientMatrix0="-1"', "OrientMatrix: .* is not a rotation"),
        ("<Attributes", "<Else", "<Attributes> is missing"),
        ("<Camera ", "<Other ", "is not XML"),
    ],
)
def test_bad_files(tmp_path, old, new, match):
    with refused(match, tmp_path):
        read_rig_as("motive", mcal(tmp_path, camera=CAMERA.replace(old, new)))
