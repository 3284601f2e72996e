"""Layers over a camera's picture: people as observed and as modelled, the ground, other cameras, the horizon, plumb lines.

A vertical edge of a building lies along the plumb line of its heading, near or far, so no place on the ground is needed. A
wrong lens bends or tilts these lines against door posts and people; a wrong pose tilts the horizon.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera
from passerby.core.colours import camera_colour, person_colour
from passerby.people.upright_bodies import predict_boxes
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.html import Html, element, join
from passerby.report.sheet import Sheet, dot, dot_path, offset_words, path_of, short, within
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


def boxes_layer(sheet: Sheet, contents: Contents, now: Fitted) -> Html:
    """The boxes that were seen in this frame, each with its person's number."""
    seen = contents.observations.cameras.get(sheet.camera.name)
    if seen is None:
        return Html("")
    missed = _describe_misses(sheet, now)
    parts = []
    for row in np.flatnonzero(seen.boxes.frame == sheet.backdrop.frame).tolist():
        identity, (x, y, w, h) = int(seen.boxes.identity[row]), seen.boxes.ltwh[row].tolist()
        colour, half = person_colour(identity), sheet.letters / 2
        rectangle = path_of(np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])) + "Z"
        label = str(identity) if identity >= 0 else "?"
        wide = (0.62 * len(label) + 0.5) * sheet.letters
        above = max(y - 2.3 * half, 0.0)
        parts.append(
            element(
                "g", element("title", missed.get(identity, f"person {label}")),
                sheet.path(rectangle, 2.0, stroke=colour, stroke_linejoin="round"),
                element("rect", x=short(x), y=short(above), width=short(wide), height=short(2.3 * half), fill=colour),
                element("text", label, x=short(x + wide / 2), y=short(above + 1.9 * half), font_size=sheet.letters, fill="#fff",
                        text_anchor="middle"),
                class_="seen",
            )
        )  # fmt: skip
    return join(*parts)


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


def model_layer(sheet: Sheet, now: Fitted) -> Html:
    """The fitted bodies as this camera should see them: a dashed box where it saw one, and the body's axis.

    Bodies that only this camera saw are left out: they fit their boxes, whatever the calibration.
    """
    place = now.place(sheet.camera.name)
    if place is None or sheet.camera.pose is None or not len(now.bodies):
        return Html("")
    s = now.sightings
    own = np.flatnonzero(s.camera == place)
    count = np.bincount(s.body[s.agrees], minlength=len(now.bodies))
    alone = np.bincount(s.body[own][s.agrees[own]], minlength=len(now.bodies))
    every = np.flatnonzero(count > alone)
    boxes, top, foot = predict_boxes(now.rig, np.full(len(every), place), now.bodies, every, np.zeros(len(every)), now.model)
    row_of = dict(zip(s.body[own].tolist(), own.tolist(), strict=True))
    shown = np.isfinite(boxes).all(axis=1) & _find_visible_bodies(sheet.camera, now, every)
    parts = []
    for k in np.flatnonzero(shown).tolist():
        row = row_of.get(int(every[k]))
        d = path_of(np.array([foot[k], top[k]]))
        if row is not None:
            x, y, w, h = s.model[row].tolist()
            d += path_of(np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])) + "Z"
        words = f"person {now.bodies.identity[every[k]]}, {now.bodies.top[every[k]]:.2f} m tall"
        parts.append(
            element(
                "g", element("title", words + ("" if row is not None else ": seen by other cameras")),
                sheet.path(d, 1.6, stroke_dasharray="5 4", class_="model"),
                dot(foot[k], sheet.letters / 5, sheet.ink),
            )
        )  # fmt: skip
    return join(*parts)


def _find_visible_bodies(camera: Camera, now: Fitted, bodies: Ints) -> NDArray[np.bool_]:
    """(K,) whether the middles of bodies are in the picture."""
    middle = np.column_stack([now.bodies.xy[bodies], now.bodies.top[bodies] / 2])
    return View(camera).points(middle)[1]


def joints_layer(sheet: Sheet, contents: Contents, now: Fitted) -> Html:
    """Joints that were seen as dots with limbs; crosses where joints in space project."""
    seen = contents.observations.cameras.get(sheet.camera.name)
    if seen is None:
        return Html("")
    keypoints, size = seen.keypoints, sheet.letters / 5
    bones = [(keypoints.joints.index(a), keypoints.joints.index(b)) for a, b in LIMBS if {a, b} <= set(keypoints.joints)]
    parts = []
    for row in np.flatnonzero(keypoints.frame == sheet.backdrop.frame).tolist():
        identity, found = int(keypoints.identity[row]), keypoints.score[row] > 0
        colour, xy = person_colour(identity), keypoints.xy[row]
        limbs = "".join(path_of(xy[[a, b]]) for a, b in bones if found[a] and found[b])
        dots = "".join(dot_path(point, size) for point in xy[found])
        label = str(identity) if identity >= 0 else "?"
        top = xy[found][np.argmin(xy[found][:, 1])] if found.any() else None
        parts += [
            element("title", f"person {label}"),
            sheet.path(limbs, 1.5, stroke=colour, class_="limbs") if limbs else Html(""),
            element("path", d=dots, fill=colour, class_="seen") if dots else Html(""),
            sheet.text(label, within(sheet, (top[0], top[1] - sheet.letters / 2)), text_anchor="middle")
            if top is not None
            else Html(""),
        ]
    place, j = now.place(sheet.camera.name), now.joints
    if place is not None:
        points = j.model[(j.camera == place) & np.isfinite(j.model).all(axis=1)]
        d = "".join(
            f"M{short(x - size)} {short(y)}h{short(2 * size)}M{short(x)} {short(y - size)}v{short(2 * size)}"
            for x, y in points.tolist()
        )
        parts.append(sheet.path(d, 1.4, class_="model") if d else Html(""))
    return join(*parts)


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


def reference_layer(sheet: Sheet) -> Html:
    """The horizon and plumb lines, thin, each kind with its name."""
    if sheet.camera.pose is None:
        return Html("")
    view, colour = View(sheet.camera), COLOUR if sheet.backdrop.uri is not None else ON_PAPER
    parts = []
    lines = plumb_lines(view)
    if lines:
        d = "".join(path_of(stretch) for stretches in lines for stretch in stretches)
        parts.append(sheet.path(d, 1.0, stroke=colour, stroke_opacity=0.8, class_="verticals"))
    horizon = view.horizon()
    if horizon:
        d = "".join(path_of(stretch) for stretch in horizon)
        parts.append(sheet.path(d, 1.6, stroke=colour, stroke_dasharray="9 4", class_="horizon"))
        end = max(np.concatenate(horizon), key=lambda xy: xy[0])
        parts.append(_name(sheet, "horizon", end, colour))
    if lines:
        # Of the line that reaches highest, the one farthest to the right where several leave through the upper border.
        tops = [_find_highest_pixel(stretches) for stretches in lines]
        parts.append(_name(sheet, "vertical", min(tops, key=lambda xy: (round(xy[1]), -xy[0])), colour))
    return join(*parts)


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


def _name(sheet: Sheet, words: str, end: Floats, colour: str) -> Html:
    """What a line is, to the left of one of its ends."""
    x, y = within(sheet, (end[0] - 0.4 * sheet.letters, end[1] - 0.4 * sheet.letters))
    anchor = "end" if x > 0.6 * len(words) * sheet.letters else "start"
    return sheet.text(words, (x, y), fill=colour, text_anchor=anchor, class_="line-name")
