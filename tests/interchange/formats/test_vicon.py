"""Vicon's .xcp: quaternion, centre, and the distortion that goes from the image to the pinhole."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from support.refusals import refused
from support.scenes.handmade_rigs import CENTRE, LOOKING_NORTH, POINTS

QUATERNION = Rotation.from_matrix(LOOKING_NORTH).as_quat()
RADIAL = np.array([-4e-8, 3e-15, -1e-22])


def xcp(folder, radial="", camera="", frame="", frames=1):
    position = " ".join(str(1000 * x) for x in CENTRE)
    key = (
        f'<KeyFrame FRAME="0" FOCAL_LENGTH="1000" PRINCIPAL_POINT="960 540" POSITION="{position}" '
        f'ORIENTATION="{" ".join(map(repr, QUATERNION.tolist()))}" {radial} {frame}/>'
    )
    text = (
        f'<?xml version="1.0"?><Cameras><Camera DEVICEID="21" NAME="" SENSOR_SIZE="1920 1080" PIXEL_ASPECT_RATIO="1" SKEW="0" '
        f"{camera}><KeyFrames>{key * frames}</KeyFrames></Camera></Cameras>"
    )
    (folder / "lab.xcp").write_text(text)
    return folder / "lab.xcp"


def test_a_camera_at_a_known_place(tmp_path):
    camera = read_rig_as("vicon", xcp(tmp_path))[0]["21"]
    np.testing.assert_allclose(camera.centre, CENTRE, atol=1e-9)
    # Ten metres ahead; a metre to the right of it; a metre above it.
    np.testing.assert_allclose(camera.project(POINTS), [[960, 540], [1060, 540], [960, 440]], atol=1e-6)


def test_pixels_undistort_to_the_rays_that_vicon_has(tmp_path):
    """The truth is Vicon's own direction: from a pixel to its ray."""
    centre = (948, 551)
    words = " ".join(map(repr, [*map(float, centre), *RADIAL.tolist()]))
    camera = read_rig_as("vicon", xcp(tmp_path, f'VICON_RADIAL2="Vicon3Parameter {words}"'))[0]["21"]
    pixels = np.stack(np.meshgrid(np.linspace(0, 1919, 15), np.linspace(0, 1079, 9)), axis=-1).reshape(-1, 2)
    offset = pixels - centre
    square = (offset**2).sum(axis=1, keepdims=True)
    straight = centre + offset * (1 + RADIAL[0] * square + RADIAL[1] * square**2 + RADIAL[2] * square**3)
    assert np.linalg.norm(straight - pixels, axis=1).max() > 20
    rays = np.column_stack([(straight - (960, 540)) / 1000, np.ones(len(pixels))])
    np.testing.assert_allclose(camera.lens.project_rays(rays), pixels, atol=0.1)


def test_the_older_key_is_about_the_principal_point(tmp_path):
    old = read_rig_as("vicon", xcp(tmp_path, 'VICON_RADIAL="-4e-08 3e-15"'))[0]["21"].lens
    new = read_rig_as("vicon", xcp(tmp_path, 'VICON_RADIAL2="Vicon3Parameter 960 540 -4e-08 3e-15 0"'))[0]["21"].lens
    np.testing.assert_array_equal(old.distortions, new.distortions)
    assert old.distortions.any()


@pytest.mark.parametrize(
    ("options", "loss"),
    [
        ({"radial": 'VICON_RADIAL2="ViconRadial2 960 540 1 -1e-08 1e-15"'}, "its distortion 'ViconRadial2' is left out"),
        ({"frames": 2}, "moves: of its 2 calibrations"),
    ],
)
def test_what_cannot_be_kept_is_a_loss(tmp_path, options, loss):
    path = xcp(tmp_path, **options)
    with pytest.raises(InputError, match=f"camera 21: {loss}.*--lossy"):
        read_rig_as("vicon", path)
    rig, losses = read_rig_as("vicon", path, lossy=True)
    assert len(rig) == len(losses) == 1


def test_what_is_not_read_is_told(tmp_path):
    given = Given()
    path = xcp(tmp_path, camera='TYPE="Vue"', frame='IMAGE_ERROR="0.2"')
    path.write_text(path.read_text().replace("</Cameras>", '<Camera DEVICEID="7" NAME="" SENSOR_SIZE="9 9"/></Cameras>'))
    assert read_rig_as("vicon", path, given)[0].names == ("21",)
    assert given.unread.told == ("not read: TYPE, camera 7, which is not calibrated (no KeyFrame), IMAGE_ERROR",)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('FOCAL_LENGTH="1000"', "", "camera 21: <KeyFrame> FOCAL_LENGTH is missing: 1 finite number is needed"),
        ('FOCAL_LENGTH="1000"', 'FOCAL_LENGTH="wide"', "FOCAL_LENGTH is 'wide': 1 finite number is needed"),
        ('SENSOR_SIZE="1920 1080"', 'SENSOR_SIZE="1920"', "SENSOR_SIZE is '1920': 2 finite numbers are needed"),
        ('ORIENTATION="', 'ORIENTATION="9', "a unit quaternion x y z w is needed"),
        ("<Camera ", "<Lens ", "is not XML"),
        ("KeyFrames", "Frames", "none of its 1 cameras has a KeyFrame"),
    ],
)
def test_bad_files(tmp_path, old, new, match):
    path = xcp(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with refused(match, path):
        read_rig_as("vicon", path)
