"""The view from above as shapes and as files: SVG, and GeoJSON (RFC 7946).

GeoJSON defines only longitude and latitude. A rig whose world positions in degrees define is written in these. Any other rig is
written in metres of its world, which RFC 7946 does not define: the member `coordinate_system` of the collection states this.
"""

from __future__ import annotations

import base64
import json
import re
import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.geometry.geodesy import geodetic
from passerby.page.plan_view import CameraFromAbove, PlanView
from passerby.report.rendering import render

HEADING_SHARE = 0.16
"""Length of the stroke in a camera's viewing direction, as a share of the length of a field of view."""
BAR_SHARE = 0.2
"""Largest length of the scale bar, as a share of the width."""
INSET = 0.03
"""Distance from the corner to the scale bar, as a share of the width."""
ROUND = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Lengths of scale bars, metres."""
DIGITS = 3
WIDTH_PX, LINE_PX, LETTERS_PX, MARK_PX = 1600, 24, 15, 11
"""Sizes in a saved drawing: its longer side, a line of text below it, letters, and a camera's square."""
INK = "#1c1c1b"
Shape = dict[str, Any]
METRE_DIGITS, DEGREE_DIGITS = 3, 8
"""Number of decimals of metres and of degrees: about a millimetre in both."""
GEODETIC = "longitude and latitude in degrees, WGS 84"
LOCAL = "metres of the rig's world: x right, y up; not longitude and latitude, so not as RFC 7946 defines coordinates"


def drawing(view: PlanView) -> dict[str, Any]:
    """Return the drawing of the page, ready for JSON: shapes in metres with y downwards, extent, plan's position, caption."""
    width, height = (view.high - view.low).tolist()
    told: dict[str, Any] = {
        "box": [_round_place(one) for one in (view.low[0], -view.high[1], width, height)],
        "shapes": list(shapes(view)), "caption": caption(view), "notes": list(view.notes), "backdrop": None,
        "georeferenced": view.georeference is not None,
    }  # fmt: skip
    if view.backdrop is not None:
        (x, y), (w, h) = view.backdrop.corner.tolist(), view.backdrop.extent.tolist()
        told["backdrop"] = [_round_place(one) for one in (x, -y, w, h)]
    return told


def shapes(view: PlanView) -> Iterator[Shape]:
    """Yield the shapes, the lowest layer first. `points` are [x, y], metres, y downwards; `kind` determines the style."""
    if view.backdrop is None:
        yield from _grid(view)
    for path in view.paths:
        yield _shape("path", path.xy, path.colour)
    for camera in view.cameras:
        yield _shape("seen", camera.seen, camera.colour)
    for camera in view.cameras:
        outline = camera.outline(view.magnification)
        if outline is not None:
            yield _shape("sigma", outline)
    for camera in view.cameras:
        centre = camera.centre[:2]
        if camera.ahead is not None:
            yield _shape("heading", np.stack([centre, centre + HEADING_SHARE * view.reach_m * camera.ahead]), camera.colour)
        yield _shape("camera", centre[None], camera.colour)
    for camera in view.cameras:
        below = camera.ahead is not None and bool(camera.ahead[1] > 0)
        yield {**_shape("label", camera.centre[None, :2]), "text": camera.name, "below": below}
    yield from _scale_bar(view)


def caption(view: PlanView) -> str:
    """Describe the drawing in words."""
    people = len({one.identity for one in view.paths})
    told = [f"{_count(len(view.cameras), 'camera')} with their fields of view, drawn {view.reach_m:.3g} m long"]
    if people:
        told.append("the trajectory of 1 person" if people == 1 else f"trajectories of {people} people")
    if any(one.covariance is not None for one in view.cameras):
        times = f", drawn {view.magnification} times as large" if view.magnification > 1 else ""
        round_ones = any(one.covariance is not None and not one.is_directed for one in view.cameras)
        told.append(f"red: one sigma of the positions{times}" + (" (circles: directions unknown)" if round_ones else ""))
    if view.backdrop is None:
        told.append(f"grid: {view.spacing:g} m")
    if view.missing:
        told.append("not registered: " + ", ".join(view.missing))
    return "; ".join(told) + "."


def svg_text(view: PlanView) -> str:
    """Return the drawing as an SVG file with a white background and the embedded plan. Camera names can only become text."""
    extent = view.high - view.low
    unit = WIDTH_PX / float(extent.max())
    width, height = (extent * unit).tolist()
    corner = np.array([view.low[0], -view.high[1]])
    letters = max(20, int(width / (0.55 * LETTERS_PX)))
    lines = [part for line in (caption(view), *view.notes) for part in textwrap.wrap(_xml_text(line), letters)]
    tall = height + LINE_PX * (len(lines) + 0.5)
    backdrop = None
    if view.backdrop is not None:
        (x, y), wide = view.backdrop.corner.tolist(), view.backdrop.extent * unit
        at = (np.array([x, -y]) - corner) * unit
        data = base64.b64encode(view.backdrop.shown.data).decode("ascii")
        backdrop = {
            "href": f"data:{view.backdrop.shown.media_type};base64,{data}", "x": _px(at[0]), "y": _px(at[1]),
            "width": _px(wide[0]), "height": _px(wide[1]),
        }  # fmt: skip
    return render(
        "plan.svg", width=_px(width), height=_px(tall), backdrop=backdrop, ink=INK, letters=LETTERS_PX, mark=MARK_PX,
        shapes=[_draw_shape(shape, (np.array(shape["points"]) - corner) * unit) for shape in shapes(view)],
        lines=[{"words": line, "y": _px(height + LINE_PX * (number + 1))} for number, line in enumerate(lines)],
    )  # fmt: skip


def _draw_shape(shape: Shape, at: Floats) -> dict[str, str]:
    """Return the values of a shape in a saved drawing, with positions in pixels."""
    kind, (x, y) = shape["kind"], at[0].tolist()
    drawn = {"kind": kind, "colour": shape.get("colour", INK)}
    if kind == "camera":
        return {**drawn, "x": _px(x - MARK_PX / 2), "y": _px(y - MARK_PX / 2)}
    if kind in ("label", "bar-label"):
        away = 1.4 * LETTERS_PX + 4 if shape.get("below") else -LETTERS_PX * 0.8
        return {**drawn, "x": _px(x), "y": _px(y + away), "text": _xml_text(shape["text"])}
    return {**drawn, "points": " ".join(f"{_px(x)},{_px(y)}" for x, y in at.tolist())}


def _grid(view: PlanView) -> Iterator[Shape]:
    """Yield grid lines at whole multiples of the spacing."""
    for axis in range(2):
        first, last = np.ceil(view.low[axis] / view.spacing), np.floor(view.high[axis] / view.spacing)
        for at in np.arange(first, last + 1) * view.spacing:
            ends = np.array([view.low, view.high])
            ends[:, axis] = at
            yield _shape("grid", ends)


def _scale_bar(view: PlanView) -> Iterator[Shape]:
    """Yield the scale bar in the lower left corner and its label in metres."""
    width = float((view.high - view.low)[0])
    metres = max((one for one in ROUND if one <= BAR_SHARE * width), default=ROUND[0])
    at = view.low + INSET * width
    yield _shape("bar", np.stack([at, at + (metres, 0.0)]))
    yield {**_shape("bar-label", (at + (metres / 2, 0.0))[None]), "text": f"{metres:g} m"}


def _shape(kind: str, xy: Floats, colour: str | None = None) -> Shape:
    points = [[_round_place(x), _round_place(-y)] for x, y in xy.tolist()]
    return {"kind": kind, "points": points} | ({} if colour is None else {"colour": colour})


def _round_place(value: float) -> float:
    """Round a coordinate to `DIGITS`; adding zero turns -0.0 into 0.0."""
    return round(float(value), DIGITS) + 0.0


def _xml_text(text: str) -> str:
    """Replace characters that XML does not allow even if escaped; names of cameras may contain any characters."""
    return re.sub("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)


def _px(value: float) -> str:
    return f"{round(float(value), 1) + 0.0:g}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def geojson_text(view: PlanView) -> str:
    """Return the view as the text of a GeoJSON file."""
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
            told = {"kind": "field of view", "camera": camera.name, "range_m": _round_number(view.reach_m)}
            yield _feature("Polygon", [ring], told)
        outline = camera.outline(1.0)
        if outline is not None and (ring := _ring(view, outline)):
            yield _feature("Polygon", [ring], {"kind": "one sigma of the position", "camera": camera.name})
    for path in view.paths:
        told = {
            "kind": "trajectory",
            "person": path.identity,
            "begin_s": _round_number(path.begin_s),
            "end_s": _round_number(path.end_s),
        }
        yield _feature("LineString", _places(view, path.xy), told)


def _camera(view: PlanView, camera: CameraFromAbove) -> dict[str, Any]:
    """Return a camera's properties. Sigmas are 1 standard deviation; headings run from x to y, azimuths from north to east."""
    heading = None if camera.ahead is None else float(np.degrees(np.arctan2(camera.ahead[1], camera.ahead[0])))
    told: dict[str, Any] = {
        "kind": "camera", "camera": camera.name, "height_m": _round_number(camera.centre[2]),
        "heading_deg": _round_number(heading),
        "orientation_sigma_deg": _round_number(camera.orientation_sigma_deg),
        "ground_sigma_m": None if camera.semi_axes_m is None else [_round_number(one) for one in camera.semi_axes_m],
    }  # fmt: skip
    if view.georeference is not None:
        told["azimuth_deg"] = None if heading is None else _round_number((90 - heading) % 360)
    return told


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _ring(view: PlanView, outline: Floats) -> list[list[float]] | None:
    """Return a closed ring, counter-clockwise as RFC 7946 requires; None for an outline with fewer than three points."""
    x, y = outline.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    places = _places(view, outline if area > 0 else outline[::-1])
    if places[0] != places[-1]:
        places.append(places[0])
    return places if len({tuple(one) for one in places}) >= 3 else None


def _places(view: PlanView, xy: Floats) -> list[list[float]]:
    """Return the coordinates of positions (N, 2), metres: longitude and latitude if georeferenced, otherwise metres."""
    if view.georeference is None:
        return [[_metres(x), _metres(y)] for x, y in xy.tolist()]
    found = geodetic(np.column_stack([xy, np.zeros(len(xy))]), view.georeference)
    return [[round(longitude, DEGREE_DIGITS), round(latitude, DEGREE_DIGITS)] for latitude, longitude, _ in found.tolist()]


def _metres(value: float) -> float:
    """Round to `METRE_DIGITS`; adding zero turns -0.0 into 0.0."""
    return round(value, METRE_DIGITS) + 0.0


def _round_number(value: float | None) -> float | None:
    return None if value is None else _metres(float(value))
