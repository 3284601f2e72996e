"""Layers over a camera's picture: people as observed and as modelled, the ground, other cameras, the horizon, plumb lines.

The image of a vertical edge of a building lies along the plumb line of its heading at any distance, so its position on the
ground need not be known. A wrong lens bends or tilts these lines relative to door posts and people; a wrong pose tilts the
horizon.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera
from passerby.core.colours import camera_colour, person_colour
from passerby.people.upright_bodies import predict_boxes
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.rendering import Row, short
from passerby.report.sheet import Label, Sheet, dot_path, keep_in_picture, label_at, offset_words, path_of
from passerby.report.through_lens import View, spacing_of

LIMBS = (
    ("left_ankle", "left_knee"), ("left_knee", "left_hip"), ("right_ankle", "right_knee"), ("right_knee", "right_hip"),
    ("left_hip", "right_hip"), ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"),
    ("left_shoulder", "right_shoulder"), ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"), ("nose", "left_eye"), ("nose", "right_eye"),
    ("left_eye", "left_ear"), ("right_eye", "right_ear"),
)  # fmt: skip
AXIS_COLOURS = {"x": "#e5484d", "y": "#30a46c"}
PAD_M = 2.0
"""Distance by which the grid extends beyond the people."""
NEAR_M = 24.0
"""Distance in x and y to which the grid of a site's camera extends; people farther away are too small to be useful."""
MOST_LINES = 24
"""Most spacings of a grid in one direction."""
COLOUR = "#ffd54a"
"""Colour of reference lines on a picture, where the page's own colours do not matter."""
ON_PAPER = "var(--warn, #855000)"
STEPS_DEG = (45.0, 30.0, 20.0, 15.0, 10.0, 5.0, 2.0, 1.0)
"""Angles between the headings of plumb lines. The smallest that gives at most `MOST_VERTICALS` lines is used."""
MOST_VERTICALS = 9
"""Most plumb lines in a picture."""


@dataclass(frozen=True)
class Joints:
    """All joints of a picture."""

    people: Sequence[Row] = ()
    crosses: str = ""
    """Projections of joints in space, as an SVG path."""


@dataclass(frozen=True)
class Ground:
    """The ground grid and the world's axes."""

    grid: str = ""
    axes: Sequence[Row] = ()
    origin: Floats | None = None


@dataclass(frozen=True)
class Lines:
    """The horizon and plumb lines; `names` has a label for each kind and its text anchor."""

    colour: str
    verticals: str = ""
    horizon: str = ""
    names: Sequence[tuple[Label, str]] = ()


def boxes_layer(sheet: Sheet, contents: Contents, now: Fitted) -> list[Row]:
    """Return the observed boxes of this frame, each with its person's number."""
    seen = contents.observations.cameras.get(sheet.camera.name)
    if seen is None:
        return []
    missed, boxes = _describe_misses(sheet, now), []
    for row in np.flatnonzero(seen.boxes.frame == sheet.backdrop.frame).tolist():
        identity, ltwh = int(seen.boxes.identity[row]), seen.boxes.ltwh[row].tolist()
        label = str(identity) if identity >= 0 else "?"
        wide, above = (0.62 * len(label) + 0.5) * sheet.letters, max(ltwh[1] - 1.15 * sheet.letters, 0.0)
        boxes.append({
            "title": missed.get(identity, f"person {label}"), "outline": _rectangle(*ltwh), "colour": person_colour(identity),
            "label": label, "x": ltwh[0], "y": above, "wide": wide,
        })  # fmt: skip
    return boxes


def _rectangle(x: float, y: float, w: float, h: float) -> str:
    """Return a box as an SVG path."""
    return path_of(np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])) + "Z"


def _describe_misses(sheet: Sheet, now: Fitted) -> dict[int, str]:
    """Describe, by person, the offset of the observed box from the model's."""
    s, place, told = now.sightings, now.place(sheet.camera.name), {}
    known = (s.camera == place) & np.isfinite(s.centre_px).all(axis=1)
    for row in np.flatnonzero(known).tolist():
        told[int(s.identity[row])] = (
            f"person {s.identity[row]}: centre {offset_words(s.centre_px[row])} of the model's centre, "
            f"{now.bodies.cameras[s.body[row]]} cameras agree"
        )
    return told


def model_layer(sheet: Sheet, now: Fitted) -> list[Row]:
    """Return the projections of the fitted bodies: the body's axis, and a dashed box if this camera saw the person.

    Bodies that only this camera saw are left out: they fit their boxes with any calibration.
    """
    place = now.place(sheet.camera.name)
    if place is None or sheet.camera.pose is None or not len(now.bodies):
        return []
    s = now.sightings
    own = np.flatnonzero(s.camera == place)
    count = np.bincount(s.body[s.agrees], minlength=len(now.bodies))
    alone = np.bincount(s.body[own][s.agrees[own]], minlength=len(now.bodies))
    every = np.flatnonzero(count > alone)
    boxes, top, foot = predict_boxes(now.rig, np.full(len(every), place), now.bodies, every, np.zeros(len(every)), now.model)
    row_of = dict(zip(s.body[own].tolist(), own.tolist(), strict=True))
    shown = np.isfinite(boxes).all(axis=1) & _find_visible_bodies(sheet.camera, now, every)
    drawn = []
    for k in np.flatnonzero(shown).tolist():
        row = row_of.get(int(every[k]))
        box = "" if row is None else _rectangle(*s.model[row].tolist())
        title = f"person {now.bodies.identity[every[k]]}, {now.bodies.top[every[k]]:.2f} m tall"
        title += ": seen by other cameras" if row is None else ""
        drawn.append({"title": title, "d": path_of(np.array([foot[k], top[k]])) + box, "foot": foot[k]})
    return drawn


def _find_visible_bodies(camera: Camera, now: Fitted, bodies: Ints) -> NDArray[np.bool_]:
    """Return (K,) whether the middle of each body is in the picture."""
    middle = np.column_stack([now.bodies.xy[bodies], now.bodies.top[bodies] / 2])
    return View(camera).points(middle)[1]


def joints_layer(sheet: Sheet, contents: Contents, now: Fitted) -> Joints:
    """Return the observed joints as dots with limbs, and the projections of joints in space as crosses."""
    seen = contents.observations.cameras.get(sheet.camera.name)
    if seen is None:
        return Joints()
    keypoints, size = seen.keypoints, sheet.letters / 5
    bones = [(keypoints.joints.index(a), keypoints.joints.index(b)) for a, b in LIMBS if {a, b} <= set(keypoints.joints)]
    people, crosses = [], ""
    for row in np.flatnonzero(keypoints.frame == sheet.backdrop.frame).tolist():
        identity, found = int(keypoints.identity[row]), keypoints.score[row] > 0
        colour, xy = person_colour(identity), keypoints.xy[row]
        limbs = "".join(path_of(xy[[a, b]]) for a, b in bones if found[a] and found[b])
        dots = "".join(dot_path(point, size) for point in xy[found])
        label = str(identity) if identity >= 0 else "?"
        top = xy[found][np.argmin(xy[found][:, 1])] if found.any() else None
        at = None if top is None else _label(sheet, label, (top[0], top[1] - sheet.letters / 2))
        people.append({"title": f"person {label}", "colour": colour, "limbs": limbs, "dots": dots, "label": at})
    place, j = now.place(sheet.camera.name), now.joints
    if place is not None:
        points = j.model[(j.camera == place) & np.isfinite(j.model).all(axis=1)]
        crosses = "".join(
            f"M{short(x - size)} {short(y)}h{short(2 * size)}M{short(x)} {short(y - size)}v{short(2 * size)}"
            for x, y in points.tolist()
        )
    return Joints(people, crosses)


def _label(sheet: Sheet, words: str, xy: Sequence[float] | Floats) -> Label:
    """Return a label whose beginning is moved into the picture."""
    return label_at(words, keep_in_picture(sheet, xy))


def grid_region(fit: Fitted, contents_centres: Floats) -> tuple[Floats, Floats]:
    """Return the lowest (2,) and highest (2,) x and y of the drawn ground, metres: around the people, else the cameras."""
    places = fit.ways.xy
    if len(places) < 2:
        places = contents_centres[:, :2] if len(contents_centres) else np.zeros((1, 2))
        return places.min(axis=0) - 5 * PAD_M, places.max(axis=0) + 5 * PAD_M
    low, high = np.quantile(places, (0.005, 0.995), axis=0)
    return low - PAD_M, high + PAD_M


def grid_lines(low: Floats, high: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return the grid lines over a region of the ground at whole multiples of `spacing`: (L, 3) beginnings, (L, 3) ends."""
    first, last = np.floor(low / spacing).astype(int), np.ceil(high / spacing).astype(int)
    xs, ys = (np.arange(first[k], last[k] + 1) * spacing for k in range(2))
    begin = [(x, ys[0], 0.0) for x in xs] + [(xs[0], y, 0.0) for y in ys]
    end = [(x, ys[-1], 0.0) for x in xs] + [(xs[-1], y, 0.0) for y in ys]
    return np.array(begin), np.array(end)


def grid_spacing(low: Floats, high: Floats) -> float:
    """Return the spacing of the grid lines over a region, metres."""
    return spacing_of(float((high - low).max()), MOST_LINES)


def ground_seen(fit: Fitted, camera: Camera, near: bool) -> tuple[Floats, Floats]:
    """Return the lowest (2,) and highest (2,) x and y of the ground drawn in a camera's picture, metres.

    It is the whole drawn ground, or with `near` the part within `NEAR_M` of the camera.
    """
    low, high = grid_region(fit, centres_of([camera]))
    if not near or camera.pose is None:
        return low, high
    centre = camera.centre[:2]
    return np.minimum(np.maximum(low, centre - NEAR_M), centre), np.maximum(np.minimum(high, centre + NEAR_M), centre)


def ground_layer(sheet: Sheet, fit: Fitted, near: bool = False) -> Ground:
    """Return the ground grid and the axes; `near`: only the grid around the camera, for a site much larger than its view."""
    if sheet.camera.pose is None:
        return Ground()
    view = View(sheet.camera)
    low, high = ground_seen(fit, sheet.camera, near)
    spacing = grid_spacing(low, high)
    grid = "".join(path_of(stretch) for line in view.segments(*grid_lines(low, high, spacing)) for stretch in line)
    pixels, inside = view.points(np.zeros((1, 3)))
    return Ground(grid, _axes(sheet, view, 5 * spacing), pixels[0] if inside[0] else None)


def _axes(sheet: Sheet, view: View, length: float) -> list[Row]:
    """Return the visible parts of the world's x and y axes from the origin."""
    ends = np.array([[length, 0.0, 0.0], [0.0, length, 0.0]])
    return [
        {
            "colour": colour, "strokes": [path_of(stretch) for stretch in stretches],
            "label": _label(sheet, name, stretches[-1][-1]),
        }
        for (name, colour), stretches in zip(AXIS_COLOURS.items(), view.segments(np.zeros((2, 3)), ends), strict=True)
        if stretches
    ]  # fmt: skip


def draw_other_cameras(sheet: Sheet, contents: Contents, among: Collection[str] | None = None) -> list[Row]:
    """Return the marks of other cameras that are in the picture, with names; `among`: only these cameras, None for all."""
    if sheet.camera.pose is None:
        return []
    others = [
        (index, other) for index, other in enumerate(contents.rig)
        if other.pose is not None and other.name != sheet.camera.name and (among is None or other.name in among)
    ]  # fmt: skip
    pixels, inside = View(sheet.camera).points(centres_of([other for _, other in others]))
    drawn, half = [], sheet.letters / 2
    for row in np.flatnonzero(inside).tolist():
        (index, other), (x, y) = others[row], pixels[row].tolist()
        diamond = path_of(np.array([[x, y - half], [x + half, y], [x, y + half], [x - half, y]])) + "Z"
        label = _label(sheet, other.name, (x + 1.4 * half, y - half))
        drawn.append({"diamond": diamond, "colour": camera_colour(index), "label": label})
    return drawn


def centres_of(cameras: Iterable[Camera]) -> Floats:
    """Return the centres (C, 3) of the cameras that have poses, metres."""
    return np.array([camera.centre for camera in cameras if camera.pose is not None]).reshape(-1, 3)


def reference_layer(sheet: Sheet) -> Lines:
    """Return the horizon and the plumb lines, with a label for each kind."""
    colour = COLOUR if sheet.backdrop.uri is not None else ON_PAPER
    if sheet.camera.pose is None:
        return Lines(colour)
    view, names = View(sheet.camera), []
    lines, horizon = plumb_lines(view), view.horizon()
    if horizon:
        names.append(_name(sheet, "horizon", max(np.concatenate(horizon), key=lambda xy: xy[0])))
    if lines:
        # Label the line that reaches highest; if several leave through the upper border, the rightmost of these.
        tops = [_find_highest_pixel(stretches) for stretches in lines]
        names.append(_name(sheet, "vertical", min(tops, key=lambda xy: (round(xy[1]), -xy[0]))))
    verticals = "".join(path_of(stretch) for stretches in lines for stretch in stretches)
    return Lines(colour, verticals, "".join(path_of(stretch) for stretch in horizon), names)


def plumb_lines(view: View) -> list[list[Floats]]:
    """Return the visible stretches of plumb lines (see `View.verticals`), as dense as `MOST_VERTICALS` allows."""
    fitting = None
    for step in map(np.deg2rad, STEPS_DEG):
        # Counting lines takes a fifteenth of the time of finding where they leave the picture.
        if view.count_verticals(step) > MOST_VERTICALS:
            break
        fitting = step
    return [] if fitting is None else view.verticals(fitting)


def _find_highest_pixel(stretches: list[Floats]) -> Floats:
    """Return the pixel (2,) of a line that is highest in the picture."""
    points = np.concatenate(stretches)
    return np.asarray(points[np.argmin(points[:, 1])])


def _name(sheet: Sheet, words: str, end: Floats) -> tuple[Label, str]:
    """Return the label of a line, to the left of one of its ends, and the text anchor of the label."""
    x, y = keep_in_picture(sheet, (end[0] - 0.4 * sheet.letters, end[1] - 0.4 * sheet.letters))
    return label_at(words, (x, y)), "end" if x > 0.6 * len(words) * sheet.letters else "start"
