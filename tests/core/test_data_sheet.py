"""What is stated of a lens that nobody calibrated: fields of view, focal lengths, and what cannot be a lens."""

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.core.data_sheet import DATA_SHEET_SD, focal_of_field, sd_of_field
from passerby.core.lens import LARGEST_FOCAL_SD

SIZE = (1280, 720)


def field_deg(lens, pixels):
    first, second = lens.bearings(np.array(pixels, dtype=float))
    return np.degrees(2 * np.arcsin(0.5 * np.linalg.norm(first - second)))


@pytest.mark.parametrize(("degrees", "fisheye"), [(2, False), (60, False), (150, False), (60, True), (150, True), (240, True)])
def test_the_image_shows_the_stated_field_of_view(degrees, fisheye):
    lens = Lens.unknown(SIZE, hfov_deg=degrees, fisheye=fisheye)
    centre = field_deg(lens, [(0, 360), (640, 360)]) + field_deg(lens, [(640, 360), (1280, 360)])
    assert centre == pytest.approx(degrees, rel=1e-6)
    assert lens.fisheye is fisheye
    assert lens.uncalibrated


def test_a_focal_length_in_pixels():
    lens = Lens.unknown(SIZE, focal_px=900.0, group="A")
    assert (lens.focal, lens.focal_sd, lens.group) == (pytest.approx(900.0), DATA_SHEET_SD, "A")
    assert Lens.unknown(SIZE, focal_px=900.0, focal_sd=0.03).focal_sd == 0.03
    assert Lens.unknown(SIZE).focal_sd == LARGEST_FOCAL_SD


def test_a_wide_field_of_view_is_stated_less_well():
    """An equidistant lens has the same field with a longer focal length: two sigmas of what is added at most."""
    sds = [sd_of_field(degrees) for degrees in (2, 40, 90, 120, 150)]
    assert sds == sorted(sds)
    assert sds[0] == pytest.approx(DATA_SHEET_SD, abs=1e-3)
    apart = np.log(focal_of_field(90, 1280, fisheye=True) / focal_of_field(90, 1280))
    assert sd_of_field(90) == pytest.approx(np.hypot(DATA_SHEET_SD, apart / 2))
    assert sd_of_field(150) < LARGEST_FOCAL_SD
    assert sd_of_field(150, fisheye=True) == DATA_SHEET_SD


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"hfov_deg": 0.0}, "hfov_deg 0 is not the field of view of a pinhole lens: give 2 to 150"),
        ({"hfov_deg": float("nan")}, "hfov_deg nan"),
        ({"hfov_deg": 180.0}, "give 2 to 150 degrees, or up to 240 of a fisheye"),
        ({"hfov_deg": 300.0, "fisheye": True}, "hfov_deg 300 is not the field of view of a fisheye lens: give 2 to 240"),
        ({"focal_px": 0.0}, "a focal length of 0 px is none"),
        ({"focal_px": float("inf")}, "a focal length of inf px is none"),
        ({"focal_px": 2.8}, "a focal length of 2.8 px means 179 degrees over the 1280 px of a 1280 x 720 image"),
        ({"focal_px": 1e6}, "a pinhole lens sees 2 to 150: check the units"),
        # 130 degrees over the width of an upright image mean 150.6 over its height.
        ({"size": (1080, 1920), "hfov_deg": 130.0}, "151 degrees over the 1920 px of a 1080 x 1920 image"),
        ({"hfov_deg": 90.0, "focal_px": 640.0}, "state the focal length twice"),
        ({"focal_sd": 0.1}, "the sigma of a focal length that is not stated"),
        ({"hfov_deg": 90.0, "focal_sd": 0.6}, "focal_sd 0.6 is out of range"),
        ({"hfov_deg": 90.0, "focal_sd": 0.0}, "focal_sd 0 is out of range"),
    ],
)
def test_what_no_lens_can_be(arguments, what):
    with pytest.raises(InputError) as error:
        Lens.unknown(**{"size": SIZE, **arguments})
    assert what in str(error.value)


@pytest.mark.parametrize("size", [(0, 720), (1280, -1), (1280.5, 720), (1280,), (float("nan"), 720), ("a", "b"), 5])
def test_what_no_image_size_can_be(size):
    with pytest.raises(InputError, match="is not an image size"):
        Lens.unknown(size)
