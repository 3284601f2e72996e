"""The ground and the other cameras as a camera's picture should show them."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.core.colours import camera_colour
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.html import Html, join
from passerby.report.sheet import Sheet, dot, path_of, within
from passerby.report.through_lens import View, spacing_of

AXIS_COLOURS = {"x": "#e5484d", "y": "#30a46c"}
PAD_M = 2.0
"""By how much the grid reaches beyond the people."""
NEAR_M = 24.0
"""How far from a camera of a site its grid reaches in x and y; people farther away are too small to be of use."""
MOST_LINES = 24
"""Of a grid, in one direction."""


def grid_region(fit: Fitted, contents_centres: Floats) -> tuple[Floats, Floats]:
    """(2,) lowest and (2,) highest x and y of the ground that is drawn, metres: where people were, or around the cameras."""
    places = fit.ways.xy
    if len(places) < 2:
        places = contents_centres[:, :2] if len(contents_centres) else np.zeros((1, 2))
        return places.min(axis=0) - 5 * PAD_M, places.max(axis=0) + 5 * PAD_M
    low, high = np.quantile(places, (0.005, 0.995), axis=0)
    return low - PAD_M, high + PAD_M


def grid_lines(low: Floats, high: Floats, spacing: float) -> tuple[Floats, Floats]:
    """The lines of a grid on the ground over a region, at whole multiples of `spacing`: (L, 3) beginnings, (L, 3) ends."""
    first, last = np.floor(low / spacing).astype(int), np.ceil(high / spacing).astype(int)
    xs, ys = (np.arange(first[k], last[k] + 1) * spacing for k in range(2))
    begin = [(x, ys[0], 0.0) for x in xs] + [(xs[0], y, 0.0) for y in ys]
    end = [(x, ys[-1], 0.0) for x in xs] + [(xs[-1], y, 0.0) for y in ys]
    return np.array(begin), np.array(end)


def grid_spacing(low: Floats, high: Floats) -> float:
    """Metres between the lines of the grid over a region."""
    return spacing_of(float((high - low).max()), MOST_LINES)


def ground_seen(fit: Fitted, camera: Camera, near: bool) -> tuple[Floats, Floats]:
    """(2,) lowest and (2,) highest x and y of the ground in a camera's picture, metres: all of it, or what is `near` it."""
    low, high = grid_region(fit, centres_of([camera]))
    if not near or camera.pose is None:
        return low, high
    centre = camera.centre[:2]
    return np.minimum(np.maximum(low, centre - NEAR_M), centre), np.maximum(np.minimum(high, centre + NEAR_M), centre)


def ground_layer(sheet: Sheet, fit: Fitted, near: bool = False) -> Html:
    """The ground's grid and its axes; `near`: the grid around the camera, of a site that reaches far beyond what it sees."""
    if sheet.camera.pose is None:
        return Html("")
    view = View(sheet.camera)
    low, high = ground_seen(fit, sheet.camera, near)
    spacing = grid_spacing(low, high)
    stretches = [stretch for line in view.segments(*grid_lines(low, high, spacing)) for stretch in line]
    parts = [sheet.path("".join(path_of(s) for s in stretches), 1.0, stroke_opacity=0.6, class_="grid")] if stretches else []
    return join(*parts, _axes(sheet, view, 5 * spacing))


def _axes(sheet: Sheet, view: View, length: float) -> Html:
    """The world's x and y from its origin, as far as they are in the picture."""
    ends = np.array([[length, 0.0, 0.0], [0.0, length, 0.0]])
    parts = []
    for label, stretches in zip(AXIS_COLOURS, view.segments(np.zeros((2, 3)), ends), strict=True):
        colour = AXIS_COLOURS[label]
        for stretch in stretches:
            parts.append(sheet.path(path_of(stretch), 2.6, stroke=colour, class_=f"axis-{label}"))
        if stretches:
            far = within(sheet, stretches[-1][-1])
            parts.append(sheet.text(label, far, fill=colour, font_weight="bold", class_=f"axis-{label}"))
    pixels, inside = view.points(np.zeros((1, 3)))
    if inside[0]:
        parts.append(dot(pixels[0], sheet.letters / 4, sheet.ink, class_="origin"))
    return join(*parts)


def other_cameras(sheet: Sheet, contents: Contents, among: Collection[str] | None = None) -> Html:
    """Where other cameras hang, by name: all, or those among some."""
    if sheet.camera.pose is None:
        return Html("")
    others = [
        (index, other) for index, other in enumerate(contents.rig)
        if other.pose is not None and other.name != sheet.camera.name and (among is None or other.name in among)
    ]  # fmt: skip
    pixels, inside = View(sheet.camera).points(centres_of([other for _, other in others]))
    parts, half = [], sheet.letters / 2
    for row in np.flatnonzero(inside).tolist():
        (index, other), (x, y) = others[row], pixels[row].tolist()
        diamond = path_of(np.array([[x, y - half], [x + half, y], [x, y + half], [x - half, y]])) + "Z"
        parts.append(sheet.path(diamond, 2.0, stroke=camera_colour(index), fill=camera_colour(index), fill_opacity=0.5))
        parts.append(sheet.text(other.name, within(sheet, (x + 1.4 * half, y - half))))
    return join(*parts)


def centres_of(cameras: Iterable[Camera]) -> Floats:
    """(C, 3) of the cameras that have poses, metres."""
    return np.array([camera.centre for camera in cameras if camera.pose is not None]).reshape(-1, 3)
