"""Layers over a camera's picture: people as observed and as modelled, the ground, other cameras, the horizon, plumb lines.

A vertical edge of a building lies along the plumb line of its heading, near or far, so no place on the ground is needed. A
wrong lens bends or tilts these lines against door posts and people; a wrong pose tilts the horizon.
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
"""By how much the grid reaches beyond the people."""
NEAR_M = 24.0
"""How far from a camera of a site its grid reaches in x and y; people farther away are too small to be of use."""
MOST_LINES = 24
"""Of a grid, in one direction."""
COLOUR = "#ffd54a"
"""On a picture, where the page's own colours do not matter."""
ON_PAPER = "var(--warn, #855000)"
STEPS_DEG = (45.0, 30.0, 20.0, 15.0, 10.0, 5.0, 2.0, 1.0)
"""Between the headings of plumb lines: the narrowest with"""
MOST_VERTICALS = 9
"""or fewer in the picture."""


@dataclass(frozen=True)
class Joints:
    """All joints of a picture."""

    people: Sequence[Row] = ()
    crosses: str = ""
    """Where joints in space project."""


@dataclass(frozen=True)
class Ground:
    """The grid, and the world's axes."""

    grid: str = ""
    axes: Sequence[Row] = ()
    origin: Floats | None = None


@dataclass(frozen=True)
class Lines:
    """The horizon and plumb lines, with a name for each kind and the end at which it is anchored."""

    colour: str
    verticals: str = ""
    horizon: str = ""
    names: Sequence[tuple[Label, str]] = ()


def boxes_layer(sheet: Sheet, contents: Contents, now: Fitted) -> list[Row]:
    """The boxes that were seen in this frame, each with its person's number."""
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
    """A box as a path."""
    return path_of(np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])) + "Z"


def _describe_misses(sheet: Sheet, now: Fitted) -> dict[int, str]:
    """By person, how far the box that was seen is off the model's, in words."""
    s, place, told = now.sightings, now.place(sheet.camera.name), {}
    known = (s.camera == place) & np.isfinite(s.centre_px).all(axis=1)
    for row in np.flatnonzero(known).tolist():
        told[int(s.identity[row])] = (
            f"person {s.identity[row]}: centre {offset_words(s.centre_px[row])} of the model's centre, "
            f"{now.bodies.cameras[s.body[row]]} cameras agree"
        )
    return told


def model_layer(sheet: Sheet, now: Fitted) -> list[Row]:
    """The fitted bodies as this camera should see them: a dashed box where it saw one, and the body's axis.

    Bodies that only this camera saw are left out: they fit their boxes, whatever the calibration.
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
    """(K,) whether the middles of bodies are in the picture."""
    middle = np.column_stack([now.bodies.xy[bodies], now.bodies.top[bodies] / 2])
    return View(camera).points(middle)[1]


def joints_layer(sheet: Sheet, contents: Contents, now: Fitted) -> Joints:
    """Joints that were seen as dots with limbs; crosses where joints in space project."""
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
    """Letters that stay in the picture."""
    return label_at(words, keep_in_picture(sheet, xy))


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


def ground_layer(sheet: Sheet, fit: Fitted, near: bool = False) -> Ground:
    """The ground's grid and its axes; `near`: the grid around the camera, of a site that reaches far beyond what it sees."""
    if sheet.camera.pose is None:
        return Ground()
    view = View(sheet.camera)
    low, high = ground_seen(fit, sheet.camera, near)
    spacing = grid_spacing(low, high)
    grid = "".join(path_of(stretch) for line in view.segments(*grid_lines(low, high, spacing)) for stretch in line)
    pixels, inside = view.points(np.zeros((1, 3)))
    return Ground(grid, _axes(sheet, view, 5 * spacing), pixels[0] if inside[0] else None)


def _axes(sheet: Sheet, view: View, length: float) -> list[Row]:
    """The world's x and y from its origin, as far as they are in the picture."""
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
    """Where other cameras hang, by name: all, or those among some."""
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
    """(C, 3) of the cameras that have poses, metres."""
    return np.array([camera.centre for camera in cameras if camera.pose is not None]).reshape(-1, 3)


def reference_layer(sheet: Sheet) -> Lines:
    """The horizon and plumb lines, thin, each kind with its name."""
    colour = COLOUR if sheet.backdrop.uri is not None else ON_PAPER
    if sheet.camera.pose is None:
        return Lines(colour)
    view, names = View(sheet.camera), []
    lines, horizon = plumb_lines(view), view.horizon()
    if horizon:
        names.append(_name(sheet, "horizon", max(np.concatenate(horizon), key=lambda xy: xy[0])))
    if lines:
        # Of the line that reaches highest, the one farthest to the right where several leave through the upper border.
        tops = [_find_highest_pixel(stretches) for stretches in lines]
        names.append(_name(sheet, "vertical", min(tops, key=lambda xy: (round(xy[1]), -xy[0]))))
    verticals = "".join(path_of(stretch) for stretches in lines for stretch in stretches)
    return Lines(colour, verticals, "".join(path_of(stretch) for stretch in horizon), names)


def plumb_lines(view: View) -> list[list[Floats]]:
    """As many plumb lines as a drawing bears, as `View.verticals` has them."""
    fitting = None
    for step in map(np.deg2rad, STEPS_DEG):
        # To count lines takes a fifteenth of the time that it takes to find where they leave the picture.
        if view.count_verticals(step) > MOST_VERTICALS:
            break
        fitting = step
    return [] if fitting is None else view.verticals(fitting)


def _find_highest_pixel(stretches: list[Floats]) -> Floats:
    """(2,) the pixel of a line that is highest in the picture."""
    points = np.concatenate(stretches)
    return np.asarray(points[np.argmin(points[:, 1])])


def _name(sheet: Sheet, words: str, end: Floats) -> tuple[Label, str]:
    """What a line is, to the left of one of its ends, and where the letters are anchored."""
    x, y = keep_in_picture(sheet, (end[0] - 0.4 * sheet.letters, end[1] - 0.4 * sheet.letters))
    return label_at(words, (x, y)), "end" if x > 0.6 * len(words) * sheet.letters else "start"
