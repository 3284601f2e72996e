"""What a camera saw and what the calibration makes of it, drawn over a picture of its video: one SVG.

Layers: the ground's grid, the horizon and plumb lines, other cameras, the model's boxes, the boxes that were seen, joints.
Coordinates within the inner group are those of the camera's pixels, whose origin is the middle of the first one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from passerby.common.progress import Progress
from passerby.core.observations import Clock
from passerby.report.camera_table import swatch
from passerby.report.contents import Contents
from passerby.report.distances import residual_px
from passerby.report.fitted import Fitted, fit_sample
from passerby.report.html import Html, Section, element, join, nothing, plot
from passerby.report.layers import (
    boxes_layer,
    grid_spacing,
    ground_layer,
    ground_seen,
    joints_layer,
    model_layer,
    other_cameras,
    reference_layer,
)
from passerby.report.residuals import residual_map
from passerby.report.rig_plots import rig_from_above, rig_in_space
from passerby.report.sampling import clocks_of, sample_at
from passerby.report.seen import Seen
from passerby.report.sheet import Backdrop, Sheet, backdrop, clip_text, short
from passerby.report.site_map import plan_drawing
from passerby.report.tables import count, figure

LAYERS = (
    ("grid", "ground grid"),
    ("lines", "horizon and verticals"),
    ("cameras", "other cameras"),
    ("boxes", "observed boxes"),
    ("model", "boxes of the model"),
    ("joints", "keypoints"),
)
DECODERS = 2
"""Videos of which an image is decoded at a time, beside the drawing."""
DECODED_AHEAD = 16
"""Images that wait for their drawing at most, 100 kB each."""
VIEWS_LEAD = (
    "In a good calibration the grid lies flat on the ground, the verticals run along the edges of doors and posts, and the "
    "boxes of the model coincide with the observed boxes. "
    "Arrows in the residual map that point in the same direction over a whole region indicate wrong intrinsics or a "
    "camera that moved."
)
RIG_LEAD = (
    "Positions and viewing directions of the cameras, and where people walked. An ellipse contains its camera with a "
    "probability of 39 % (1 sigma). Thin ellipses that point to the middle show an uncertain scale, which one measured "
    "distance fixes. If people walk through walls, or a camera faces away from them, something is wrong."
)


def camera_picture(
    contents: Contents, fit: Fitted, name: str, behind: Backdrop | None = None, among: Collection[str] | None = None
) -> str:
    """One camera's picture with all layers, as `<svg viewBox="0 0 width height">`.

    Args:
        contents: of the report.
        fit: of the whole sample; only where people walk is taken from it.
        name: of a camera of the rig, with a pose or without.
        behind: of `backdrop`; looked for where None.
        among: the cameras that are drawn, and whose people are; None: all.
    """
    camera = contents.rig[name]
    behind = backdrop(contents, name) if behind is None else behind
    sheet = Sheet(camera, behind, "currentColor" if behind.uri is None else "#fff")
    near = contents if among is None else _part_of(contents, {name, *among})
    clocks, _ = clocks_of(near)
    now = fit_sample(near, sample_at(near, clocks.get(name) or Clock(1.0), np.array([behind.frame])))
    width, height = camera.lens.size
    layers = [
        element("g", ground_layer(sheet, fit, among is not None), class_="layer-grid"),
        element("g", reference_layer(sheet), class_="layer-lines"),
        element("g", other_cameras(sheet, contents, among), class_="layer-cameras"),
        element("g", model_layer(sheet, now), class_="layer-model"),
        element("g", boxes_layer(sheet, contents, now), class_="layer-boxes"),
        element("g", joints_layer(sheet, contents, now), class_="layer-joints"),
    ]
    grid_m = grid_spacing(*ground_seen(fit, camera, among is not None))
    return element(
        "svg", _canvas(sheet), element("g", layers, transform="translate(0.5 0.5)"), _notes(sheet, grid_m),
        viewBox=f"0 0 {width} {height}", class_="camera-picture", role="img",
        aria_label=f"Camera {clip_text(name)}, frame {behind.frame}: ground grid, horizon and verticals, observed boxes, boxes "
        "of the model",
        xmlns="http://www.w3.org/2000/svg", data_frame=behind.frame, font_family="sans-serif",
    )  # fmt: skip


def _part_of(contents: Contents, names: Collection[str]) -> Contents:
    """The same contents with some of the cameras."""
    return replace(contents, rig=replace(contents.rig, cameras=tuple(one for one in contents.rig if one.name in names)))


def _canvas(sheet: Sheet) -> Html:
    """The picture, or a blank sheet."""
    width, height = sheet.camera.lens.size
    blank = element(
        "rect", width=width, height=height, fill="currentColor", fill_opacity=0.06, stroke="currentColor", stroke_opacity=0.3,
        class_="canvas",
    )  # fmt: skip
    if sheet.backdrop.uri is None:
        return blank
    covered = sheet.backdrop.size
    picture = element(
        "image", href=sheet.backdrop.uri, width=covered[0], height=covered[1], preserveAspectRatio="none", class_="frame"
    )
    return picture if covered == (width, height) else join(blank, picture)


def _notes(sheet: Sheet, grid_m: float) -> Html:
    """Frame and grid, below in the picture; above it why there is no picture or no drawing."""
    width, height = sheet.camera.lens.size
    told = [f"frame {sheet.backdrop.frame}"]
    if sheet.camera.pose is not None:
        told.append(f"grid {grid_m:g} m")
    else:
        told.append("not registered: no pose")
    lines = [sheet.text(", ".join(told), (0.6 * sheet.letters, height - 0.6 * sheet.letters), class_="picture-note")]
    if sheet.backdrop.note is not None:
        most = int(width / sheet.letters * 1.8)
        lines.append(
            element(
                "text", clip_text(sheet.backdrop.note, most), x=short(0.6 * sheet.letters), y=short(1.4 * sheet.letters),
                font_size=sheet.letters, fill="currentColor", fill_opacity=0.75, class_="picture-note",
            )
        )  # fmt: skip
    return join(*lines)


def rig_section(contents: Contents, fit: Fitted) -> Section:
    """The rig from above and in space."""
    posed = contents.rig.posed()
    if not len(posed):
        return Section("rig", "The rig", RIG_LEAD, nothing("No camera has a pose: there is nothing to draw."))
    who = f"{count(len(posed), 'camera')} and the trajectories of the people"
    above = plot("rig-above", rig_from_above(contents, fit), f"The rig from above: {who}")
    space = plot("rig-space", rig_in_space(contents, fit), f"The rig in space: {who}", kind="space")
    return Section("rig", "The rig", RIG_LEAD, element("div", plan_drawing(contents, fit), above, space, class_="stack"))


def pictures_section(contents: Contents, fit: Fitted, seen: Seen, tell: Progress) -> Section:
    """A panel for each camera: its picture with what was seen and what the rig makes of it, and its residuals."""
    panels = []
    for place, (name, behind) in enumerate(decoded_backdrops(contents, tell)):
        panels.append(camera_panel(contents, fit, seen, place, name, behind))
    return Section("views", "Camera views", VIEWS_LEAD, join(layer_switches(contents), panels), "Views")


def decoded_backdrops(contents: Contents, tell: Progress) -> Iterator[tuple[str, Backdrop]]:
    """Each camera's name with the image behind its drawing, in the rig's order; the next ones are decoded meanwhile."""
    names = contents.rig.names
    with ThreadPoolExecutor(DECODERS) as decoders:  # decoding leaves Python to other threads
        waiting = deque[Future[Backdrop]]()
        for place, name in enumerate(names):
            for ahead in names[place + len(waiting) : place + DECODED_AHEAD]:
                waiting.append(decoders.submit(backdrop, contents, ahead))
            tell("report", place, len(names))
            yield name, waiting.popleft().result()
    tell("report", len(names), len(names))


def layer_switches(contents: Contents) -> Html:
    """A box for each layer that a picture has, for all pictures at once."""
    seen, posed = contents.observations.cameras.values(), len(contents.rig.posed()) > 0
    with_boxes, with_joints = any(len(one.boxes) for one in seen), any(len(one.keypoints) for one in seen)
    there = {
        "grid": posed,
        "lines": posed,
        "cameras": posed,
        "boxes": with_boxes,
        "model": posed and with_boxes,
        "joints": with_joints,
    }
    boxes = [
        element("label", element("input", type="checkbox", checked=True, data_layer=layer), name)
        for layer, name in LAYERS
        if there[layer]
    ]
    return element("fieldset", element("legend", "Overlays"), boxes, class_="layers") if boxes else Html("")


def camera_panel(
    contents: Contents, fit: Fitted, seen: Seen, place: int, name: str, behind: Backdrop,
    among: Collection[str] | None = None, more: Html | None = None,
) -> Html:  # fmt: skip
    """One camera, on the image behind its drawing.

    Args:
        contents: of the report.
        fit: of the whole sample.
        seen: of all cameras.
        place: in the rig.
        name: of the camera.
        behind: of `decoded_backdrops`.
        among: as of `camera_picture`.
        more: what stands below the pictures.
    """
    entry, residual = contents.document.entry(name), residual_px(contents, name)
    boxes, joints = entry.boxes, entry.keypoints
    facts = [
        count(seen.people[name], "person", "people"),
        *([f"{figure(boxes, 0)} boxes"] if boxes or not joints else []),
        *([f"{joints:.0f} observations with keypoints"] if joints else []),
        f"residual {figure(residual, 1, ' px')}",
    ]
    if contents.rig[name].pose is None:
        facts.append("no pose")
    head = element("h3", element("span", swatch(place), name), element("small", ", ".join(facts)))
    pictures = [
        element("figure", Html(camera_picture(contents, fit, name, behind, among)), element("figcaption", "View")),
        element("figure", Html(residual_map(contents, fit, name)), element("figcaption", "Residuals over the image")),
    ]
    return element(
        "article", head, element("div", pictures, class_="view-pictures"), more, class_="view", aria_label=f"Camera {name}"
    )
