"""Metres around a place as latitude, longitude and altitude: the inverse of the way there, all over the earth."""

import numpy as np
import pytest

from passerby.geometry.geodesy import earth_centred, east_north_up, geodetic

ORIGINS = [(52.52, 13.405, 36.0), (0.0, 0.0, 0.0), (-33.9, 151.2, 800.0), (89.9, -170.0, 10.0), (64.1, 180.0, -30.0)]


@pytest.mark.parametrize("origin", ORIGINS)
def test_metres_come_back(origin):
    enu = np.random.default_rng(0).uniform(-10_000, 10_000, (500, 3)) * (1, 1, 0.05)
    places = geodetic(enu, np.array(origin))
    assert east_north_up(places, np.array(origin)) == pytest.approx(enu, abs=1e-6)
    assert (np.abs(places[:, 1]) <= 180).all()


def test_a_degree_of_latitude_and_the_poles():
    """A meridian's degree at the equator is 110,574.3 m by the series of WGS 84; the poles have no longitude of their own."""
    north = geodetic(np.array([[0.0, 1.0, 0.0]]), np.zeros(3))[0]
    assert 1 / north[0] == pytest.approx(110_574.3, abs=0.1)
    pole = geodetic(np.zeros((1, 3)), np.array([90.0, 0.0, 25.0]))[0]
    assert pole[[0, 2]] == pytest.approx([90.0, 25.0], abs=1e-7)


def test_the_origin_is_itself():
    for origin in ORIGINS:
        found = geodetic(np.zeros((1, 3)), np.array(origin))
        assert earth_centred(found) == pytest.approx(earth_centred(np.array(origin)), abs=1e-6)
