"""What a camera saw and what the calibration makes of it, drawn over a picture of its video: one SVG.

Layers: the ground's grid, the horizon and plumb lines, other cameras, the model's boxes, the boxes that were seen, joints.
Coordinates within the inner group are those of the camera's pixels, whose origin is the middle of the first one.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from passerby.core.observations import Clock
from passerby.report.backdrop import Backdrop, backdrop
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted, fit_sample
from passerby.report.ground_layer import grid_spacing, ground_layer, ground_seen, other_cameras
from passerby.report.html import Html, element, join
from passerby.report.people_layers import boxes_layer, joints_layer, model_layer
from passerby.report.reference_layer import reference_layer
from passerby.report.residuals import residual_map
from passerby.report.sampling import clocks_of, sample_at
from passerby.report.sheet import Sheet, clip_text, short

__all__ = ["camera_picture", "residual_map"]


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
