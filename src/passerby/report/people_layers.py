"""The people in a camera's picture: as they were seen, and as the calibration has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Ints
from passerby.core.cameras import Camera
from passerby.core.colours import person_colour
from passerby.people.upright_bodies import predict_boxes
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.html import Html, element, join
from passerby.report.sheet import Sheet, dot, dot_path, offset_words, path_of, short, within
from passerby.report.through_lens import View

LIMBS = (
    ("left_ankle", "left_knee"), ("left_knee", "left_hip"), ("right_ankle", "right_knee"), ("right_knee", "right_hip"),
    ("left_hip", "right_hip"), ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"),
    ("left_shoulder", "right_shoulder"), ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"), ("nose", "left_eye"), ("nose", "right_eye"),
    ("left_eye", "left_ear"), ("right_eye", "right_ear"),
)  # fmt: skip


def boxes_layer(sheet: Sheet, contents: Contents, now: Fitted) -> Html:
    """The boxes that were seen in this frame, each with its person's number."""
    seen = contents.observations.cameras.get(sheet.camera.name)
    if seen is None:
        return Html("")
    missed = _misses(sheet, now)
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


def _misses(sheet: Sheet, now: Fitted) -> dict[int, str]:
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
    shown = np.isfinite(boxes).all(axis=1) & _in_view(sheet.camera, now, every)
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


def _in_view(camera: Camera, now: Fitted, bodies: Ints) -> NDArray[np.bool_]:
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
