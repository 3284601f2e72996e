"""Metres around a place as latitude, longitude and altitude: the inverse of the way there, all over the earth."""

import numpy as np
import pytest

from passerby.geometry.geodesy import east_north_up, geodetic, mean_place

ORIGINS = [(52.52, 13.405, 36.0), (0.0, 0.0, 0.0), (-33.9, 151.2, 800.0), (89.9, -170.0, 10.0), (64.1, 180.0, -30.0)]


@pytest.mark.parametrize("origin", ORIGINS)
def test_metres_come_back(origin):
    enu = np.random.default_rng(0).uniform(-10_000, 10_000, (500, 3)) * (1, 1, 0.05)
    places = geodetic(enu, np.array(origin))
    assert east_north_up(places, np.array(origin)) == pytest.approx(enu, abs=1e-6)
    assert (np.abs(places[:, 1]) <= 180).all()


def test_a_second_of_latitude_and_longitude() -> None:
    """52 degrees north, from the radii of curvature of WGS 84."""
    second = 1 / 3600
    moved = east_north_up(
        np.array([[52 + second, 13, 100], [52, 13 + second, 100], [52, 13, 107.0]]), np.array([52.0, 13.0, 100.0])
    )
    a, e2 = 6378137.0, 0.00669437999014
    w = np.sqrt(1 - e2 * np.sin(np.radians(52)) ** 2)
    meridian, across = a * (1 - e2) / w**3 + 100, (a / w + 100) * np.cos(np.radians(52))
    expected = [(0, meridian * np.radians(second), 0), (across * np.radians(second), 0, 0), (0, 0, 7)]
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    assert moved[2] == pytest.approx((0, 0, 7), abs=1e-6)


def test_the_poles_and_the_date_line() -> None:
    pole = geodetic(np.zeros((1, 3)), np.array([90.0, 0.0, 25.0]))[0]
    assert pole[[0, 2]] == pytest.approx([90.0, 25.0], abs=1e-7)
    middle = mean_place(np.array([[1.0, 179.9, 0], [1, -179.9, 2]]))
    assert (middle[0], abs(middle[1]), middle[2]) == pytest.approx((1, 180, 1))
