"""Pictures of the cameras: observations and their model, drawn over an image of the video as one SVG.

Layers: the ground's grid, the horizon and plumb lines, other cameras, the model's boxes, the observed boxes, joints.
Coordinates within the inner group are those of the camera's pixels; their origin is the middle of the first pixel.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from passerby.common.progress import Progress
from passerby.core.colours import camera_colour
from passerby.core.observations import Clock
from passerby.report.contents import Contents
from passerby.report.distances import residual_px
from passerby.report.fitted import Fitted, fit_sample
from passerby.report.layers import (
    boxes_layer,
    draw_other_cameras,
    grid_spacing,
    ground_layer,
    ground_seen,
    joints_layer,
    model_layer,
    reference_layer,
)
from passerby.report.recommendations import Point
from passerby.report.rendering import Section, plot, render, section
from passerby.report.residuals import residual_map
from passerby.report.rig_plots import rig_from_above, rig_in_space
from passerby.report.sampling import clocks_of, sample_at
from passerby.report.seen import Seen
from passerby.report.sheet import Backdrop, Sheet, backdrop, clip_text, label_at
from passerby.report.site_map import plan_drawing
from passerby.report.tables import Table, count, figure

LAYERS = (
    ("grid", "ground grid"),
    ("lines", "horizon and verticals"),
    ("cameras", "other cameras"),
    ("boxes", "observed boxes"),
    ("model", "boxes of the model"),
    ("joints", "keypoints"),
)
DECODERS = 2
"""Number of videos from which images are decoded in parallel, during the drawing."""
DECODED_AHEAD = 16
"""Most images that are decoded before they are drawn, 100 kB each."""


def camera_picture(
    contents: Contents, fit: Fitted, name: str, behind: Backdrop | None = None, among: Collection[str] | None = None
) -> Markup:
    """Draw one camera's picture with all layers, as `<svg viewBox="0 0 width height">`.

    Args:
        contents: of the report.
        fit: of the whole sample; only the region where people walk is used.
        name: of a camera of the rig, with or without a pose.
        behind: result of `backdrop`; None: it is computed here.
        among: only these cameras are drawn, and people from their observations; None: all.
    """
    camera = contents.rig[name]
    behind = backdrop(contents, name) if behind is None else behind
    sheet = Sheet(camera, behind, "currentColor" if behind.uri is None else "#fff")
    near = contents if among is None else _part_of(contents, {name, *among})
    clocks, _ = clocks_of(near)
    now = fit_sample(near, sample_at(near, clocks.get(name) or Clock(1.0), np.array([behind.frame])))
    told = [f"frame {behind.frame}"]
    if camera.pose is None:
        told.append("not registered: no pose")
    else:
        told.append(f"grid {grid_spacing(*ground_seen(fit, camera, among is not None)):g} m")
    (width, height), letters = camera.lens.size, sheet.letters
    return render(
        "picture.html", sheet=sheet, name=clip_text(name), ground=ground_layer(sheet, fit, among is not None),
        lines=reference_layer(sheet), others=draw_other_cameras(sheet, contents, among), bodies=model_layer(sheet, now),
        boxes=boxes_layer(sheet, contents, now), joints=joints_layer(sheet, contents, now),
        note=label_at(", ".join(told), (0.6 * letters, height - 0.6 * letters)),
        why=behind.note and label_at(behind.note, (0.6 * letters, 1.4 * letters), int(width / letters * 1.8)),
    )  # fmt: skip


def _part_of(contents: Contents, names: Collection[str]) -> Contents:
    """Return the contents with only the named cameras."""
    return replace(contents, rig=replace(contents.rig, cameras=tuple(one for one in contents.rig if one.name in names)))


def rig_section(contents: Contents, fit: Fitted) -> Section:
    """Return the section with the rig from above and in space."""
    posed, drawn = contents.rig.posed(), []
    if len(posed):
        who = f"{count(len(posed), 'camera')} and the trajectories of the people"
        drawn.append(plot("rig-above", rig_from_above(contents, fit), f"The rig from above: {who}"))
        drawn.append(plot("rig-space", rig_in_space(contents, fit), f"The rig in space: {who}", kind="space"))
    return section("rig", "The rig", site=False, plan=plan_drawing(contents, fit), plots=drawn)


def pictures_section(contents: Contents, fit: Fitted, seen: Seen, tell: Progress) -> Section:
    """Return the section with a panel for each camera: its picture with observations and model, and its residuals."""
    panels = [
        camera_panel(contents, fit, seen, place, name, behind)
        for place, (name, behind) in enumerate(decode_backdrops(contents, tell))
    ]
    return section("views", "Views", site=False, layers=layer_switches(contents), panels=panels)


def decode_backdrops(contents: Contents, tell: Progress) -> Iterator[tuple[str, Backdrop]]:
    """Yield each camera's name and backdrop image, in the rig's order; the next images are decoded in the meantime."""
    names = contents.rig.names
    with ThreadPoolExecutor(DECODERS) as decoders:  # decoding releases Python's lock
        waiting = deque[Future[Backdrop]]()
        for place, name in enumerate(names):
            for ahead in names[place + len(waiting) : place + DECODED_AHEAD]:
                waiting.append(decoders.submit(backdrop, contents, ahead))
            tell("report", place, len(names))
            yield name, waiting.popleft().result()
    tell("report", len(names), len(names))


def layer_switches(contents: Contents) -> list[tuple[str, str]]:
    """Return the layers that the pictures have, with their names."""
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
    return [(layer, name) for layer, name in LAYERS if there[layer]]


def camera_panel(
    contents: Contents, fit: Fitted, seen: Seen, place: int, name: str, behind: Backdrop,
    among: Collection[str] | None = None, problems: Sequence[Point] = (), tables: Sequence[tuple[str, Table]] = (),
) -> Markup:  # fmt: skip
    """Return the panel of one camera: its picture, residuals, figures, problems and tables.

    Args:
        contents: of the report.
        fit: of the whole sample.
        seen: of all cameras.
        place: position of the camera in the rig.
        name: of the camera.
        behind: result of `decode_backdrops`.
        among: as in `camera_picture`.
        problems: of the camera, below the pictures.
        tables: tables with titles; a reader can open them.
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
    return render(
        "camera.html", name=name, colour=camera_colour(place), facts=facts, problems=problems, tables=tables,
        picture=camera_picture(contents, fit, name, behind, among), residuals=residual_map(contents, fit, name),
    )  # fmt: skip
