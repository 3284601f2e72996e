"""Fields of view are those of data sheets, bent lenses too, and unknown where a lens shows no border."""

import numpy as np
import pytest

from passerby.core.cameras import Lens
from passerby.core.lens_figures import field_of_view_deg


def lens(focal, distortions=(), centre=(639.5, 359.5), fisheye=False):
    matrix = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    return Lens((1280, 720), matrix, np.array(distortions), fisheye)


def test_a_pinhole_has_that_of_its_focal_length_from_border_to_border():
    degrees = np.degrees(np.arctan([640 / 800, 360 / 800]))
    assert field_of_view_deg(lens(800.0)) == pytest.approx(2 * degrees)
    across, _ = field_of_view_deg(lens(800.0, centre=(-100.0, 359.5)))
    assert across == pytest.approx(np.degrees(np.arctan(1379.5 / 800) - np.arctan(99.5 / 800)))


def test_barrel_distortion_shows_more_and_a_fisheye_more_than_half_the_world():
    assert field_of_view_deg(lens(800.0, (-0.2, 0, 0, 0)))[0] > field_of_view_deg(lens(800.0))[0] + 3
    assert field_of_view_deg(lens(640 / np.radians(100), fisheye=True)) == pytest.approx((200, 112.5))
    # What turns over before the border has none.
    assert [one is None for one in field_of_view_deg(lens(560.0, (-0.3, 0, 0, 0)))] == [True, False]
