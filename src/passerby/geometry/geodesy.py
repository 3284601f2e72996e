"""Latitude, longitude and altitude as metres east, north and up around a place (WGS 84).

The few lines that this takes are here rather than a dependency: pyproj brings ten megabytes of data for transformations of
which this is not one. They agree with it to a nanometre over ten kilometres.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
"""Defining constants of WGS 84 (NGA.STND.0036)."""


def mean_place(geodetic: Floats) -> Floats:
    """(3,) latitude, longitude, altitude amid places (N, 3), degrees and metres; also across the 180th meridian."""
    places = np.asarray(geodetic, dtype=np.float64).reshape(-1, 3)
    around = (places[:, 1] - places[0, 1] + 180) % 360 - 180
    longitude = (places[0, 1] + around.mean() + 180) % 360 - 180
    return np.array([places[:, 0].mean(), longitude, places[:, 2].mean()])


def earth_centred(geodetic: Floats) -> Floats:
    """(N, 3) metres from the earth's centre (x to longitude 0, z to the north pole) of latitude, longitude, altitude (N, 3)."""
    places = np.asarray(geodetic, dtype=np.float64).reshape(-1, 3)
    latitude, longitude = np.radians(places[:, 0]), np.radians(places[:, 1])
    normal = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    across = (normal + places[:, 2]) * np.cos(latitude)
    up = (normal * (1 - ECCENTRICITY_SQUARED) + places[:, 2]) * np.sin(latitude)
    return np.column_stack([across * np.cos(longitude), across * np.sin(longitude), up])


def east_north_up(geodetic: Floats, origin: Floats) -> Floats:
    """Metres east, north and up of a place.

    Args:
        geodetic: (N, 3) latitude and longitude in degrees, altitude above the ellipsoid in metres.
        origin: (3,) likewise; x points east there, y north, z along the ellipsoid's normal.

    Returns:
        (N, 3) metres.
    """
    return np.asarray((earth_centred(geodetic) - earth_centred(origin)) @ _find_local_axes(origin).T)


def geodetic(enu: Floats, origin: Floats) -> Floats:
    """Latitude, longitude and altitude of metres around a place; the inverse of `east_north_up`.

    Bowring's formula, once, from the reduced latitude (Survey Review 23, 1976). It comes back within 5 nm over ten kilometres.

    Args:
        enu: (N, 3) metres east, north and up of the place.
        origin: (3,) its latitude and longitude in degrees, altitude above the ellipsoid in metres.

    Returns:
        (N, 3) likewise; longitudes in [-180, 180].
    """
    places = np.asarray(enu, dtype=np.float64).reshape(-1, 3)
    x, y, z = (places @ _find_local_axes(origin) + earth_centred(origin)).T
    minor = SEMI_MAJOR_M * (1 - FLATTENING)
    p = np.hypot(x, y)
    reduced = np.arctan2(z * SEMI_MAJOR_M, p * minor)
    second = ECCENTRICITY_SQUARED / (1 - ECCENTRICITY_SQUARED)
    latitude = np.arctan2(
        z + second * minor * np.sin(reduced) ** 3, p - ECCENTRICITY_SQUARED * SEMI_MAJOR_M * np.cos(reduced) ** 3
    )
    normal = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    # Stable at the poles too, where p / cos(latitude) is not.
    altitude = p * np.cos(latitude) + z * np.sin(latitude) - SEMI_MAJOR_M**2 / normal
    return np.column_stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), altitude])


def _find_local_axes(origin: Floats) -> Floats:
    """(3, 3) rows east, north and up at a place, seen from the earth's centre."""
    latitude, longitude = np.radians(np.asarray(origin, dtype=np.float64)[:2])
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array([
        [-sin_lon, cos_lon, 0.0],
        [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
        [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
    ])  # fmt: skip
