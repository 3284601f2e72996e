"""The view from above as GeoJSON (RFC 7946): cameras, their fields of view and sigmas, and people's trajectories.

The format knows longitude and latitude only. A rig that positions in degrees have set is written so. Any other is written in
the metres of its world, which RFC 7946 does not define: the member `coordinate_system` of the collection says so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.geometry.geodesy import geodetic
from passerby.page.plan_view import CameraFromAbove, PlanView

METRE_DIGITS, DEGREE_DIGITS = 3, 8
"""A millimetre, in metres and in degrees."""
GEODETIC = "longitude and latitude in degrees, WGS 84"
LOCAL = "metres of the rig's world: x right, y up; not longitude and latitude, so not as RFC 7946 defines coordinates"


def geojson_text(view: PlanView) -> str:
    """The whole file."""
    collection: dict[str, Any] = {
        "type": "FeatureCollection",
        "coordinate_system": LOCAL if view.georeference is None else GEODETIC,
    }
    if view.georeference is not None:
        latitude, longitude, altitude = view.georeference.tolist()
        collection["origin"] = {"longitude": longitude, "latitude": latitude, "altitude_m": altitude}
    if view.backdrop is not None:
        entry = view.backdrop.entry
        collection["plan"] = {"metres_per_pixel": entry.metres_per_pixel, "origin_px": list(entry.origin)}
    return json.dumps({**collection, "features": list(_features(view))}, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _features(view: PlanView) -> Iterator[dict[str, Any]]:
    for camera in view.cameras:
        yield _feature("Point", _places(view, camera.centre[None, :2])[0], _camera(view, camera))
    for camera in view.cameras:
        if ring := _ring(view, camera.seen):
            told = {"kind": "field of view", "camera": camera.name, "range_m": _rounded(view.reach_m)}
            yield _feature("Polygon", [ring], told)
        outline = camera.outline(1.0)
        if outline is not None and (ring := _ring(view, outline)):
            yield _feature("Polygon", [ring], {"kind": "one sigma of the position", "camera": camera.name})
    for path in view.paths:
        told = {"kind": "trajectory", "person": path.identity, "begin_s": _rounded(path.begin_s), "end_s": _rounded(path.end_s)}
        yield _feature("LineString", _places(view, path.xy), told)


def _camera(view: PlanView, camera: CameraFromAbove) -> dict[str, Any]:
    """Its properties: sigmas are one standard deviation; a heading runs from x towards y, an azimuth from north to east."""
    heading = None if camera.ahead is None else float(np.degrees(np.arctan2(camera.ahead[1], camera.ahead[0])))
    told: dict[str, Any] = {
        "kind": "camera", "camera": camera.name, "height_m": _rounded(camera.centre[2]), "heading_deg": _rounded(heading),
        "orientation_sigma_deg": _rounded(camera.orientation_sigma_deg),
        "ground_sigma_m": None if camera.semi_axes_m is None else [_rounded(one) for one in camera.semi_axes_m],
    }  # fmt: skip
    if view.georeference is not None:
        told["azimuth_deg"] = None if heading is None else _rounded((90 - heading) % 360)
    return told


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _ring(view: PlanView, outline: Floats) -> list[list[float]] | None:
    """A closed ring, counter-clockwise as RFC 7946 has it; None for an outline without an area."""
    x, y = outline.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    places = _places(view, outline if area > 0 else outline[::-1])
    if places[0] != places[-1]:
        places.append(places[0])
    return places if len({tuple(one) for one in places}) >= 3 else None


def _places(view: PlanView, xy: Floats) -> list[list[float]]:
    """Coordinates of places (N, 2), metres."""
    if view.georeference is None:
        return [[_metres(x), _metres(y)] for x, y in xy.tolist()]
    found = geodetic(np.column_stack([xy, np.zeros(len(xy))]), view.georeference)
    return [[round(longitude, DEGREE_DIGITS), round(latitude, DEGREE_DIGITS)] for latitude, longitude, _ in found.tolist()]


def _metres(value: float) -> float:
    """Adding zero turns -0.0 into 0.0."""
    return round(value, METRE_DIGITS) + 0.0


def _rounded(value: float | None) -> float | None:
    return None if value is None else _metres(float(value))
