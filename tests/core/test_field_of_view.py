"""Fields of view are those of data sheets, bent lenses too, and unknown where a lens shows no border."""

import numpy as np
import pytest

from passerby.core.cameras import Lens
from passerby.core.lens_figures import field_of_view_deg


def lens(focal, distortions=(), centre=(639.5, 359.5), fisheye=False):
    return Lens(
        (1280, 720), np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]), np.array(distortions), fisheye
    )


def test_a_pinhole_has_that_of_its_focal_length():
    across, down = field_of_view_deg(lens(800.0))
    assert across == pytest.approx(2 * np.degrees(np.arctan(640 / 800)))
    assert down == pytest.approx(2 * np.degrees(np.arctan(360 / 800)))


def test_a_principal_point_beside_the_image_counts_from_border_to_border():
    across, _ = field_of_view_deg(lens(800.0, centre=(-100.0, 359.5)))
    assert across == pytest.approx(np.degrees(np.arctan(1379.5 / 800) - np.arctan(99.5 / 800)))


def test_barrel_distortion_shows_more_and_a_fisheye_more_than_half_the_world():
    assert field_of_view_deg(lens(800.0, (-0.2, 0, 0, 0)))[0] > field_of_view_deg(lens(800.0))[0] + 3
    across, down = field_of_view_deg(lens(640 / np.radians(100), fisheye=True))
    assert across == pytest.approx(200)
    assert down == pytest.approx(112.5)


def test_what_turns_over_before_the_border_has_none():
    across, down = field_of_view_deg(lens(560.0, (-0.3, 0, 0, 0)))
    assert across is None
    assert down is not None
