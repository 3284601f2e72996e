"""A rig and a calibration in a notebook: a table and the rig from above, as HTML without script or style sheet.

Text and lines take the notebook's own colour, so both are readable on light and dark backgrounds. All text is escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Rig
from passerby.core.colours import camera_colour
from passerby.interchange.calibration_json import CameraEntry
from passerby.interchange.output_folder import OutputFolder
from passerby.report.rendering import Row, render
from passerby.report.rig_geometry import find_posed_cameras, sigma_ellipses, wedge
from passerby.report.tables import UNKNOWN, count, figure

WIDTH, TALLEST = 380, 360
"""Width and largest height of the picture, pixels."""
BELOW = 26
"""Height of the space below for the scale bar and the note about the ellipses, pixels."""
REACH_SHARE = 0.35
"""Length of a camera's drawn view, as a share of the rig's extent: full views would cover each other."""
MOST_NOTES = 12
"""Most findings that are shown. Further ones are only counted; the report has all of them."""


def rig_html(rig: Rig) -> str:
    """Show a rig as a table of its cameras beside the rig from above."""
    words = f"{len(rig.posed())} of {count(len(rig), 'camera')} with a pose"
    return _render("Rig", rig, rig.verdict, words)


def output_folder_html(folder: OutputFolder) -> str:
    """Show the output folder of a calibration with `result_html`."""
    document = folder.document
    cameras = [document.entry(name) for name in folder.rig.names]
    return result_html(
        document.name or folder.path.name,
        folder.rig,
        Outcome(folder.verdict, folder.reasons, document.findings, folder.all_cameras),
        cameras,
        clocked=any(one.time_offset_s for one in cameras),
    )


@dataclass(frozen=True)
class Outcome:
    """Verdict and texts of a calibration, for a reader."""

    verdict: str
    reasons: Sequence[str]
    findings: Sequence[str]
    all_cameras: int
    """Number of cameras, including those without a pose."""


def result_html(title: str, rig: Rig, outcome: Outcome, cameras: Sequence[CameraEntry], *, clocked: bool) -> str:
    """Show a calibration: the verdict with its reasons, the cameras, the rig from above, and findings about the input.

    Args:
        title: the scene's name.
        rig: all cameras that are listed.
        outcome: verdict and texts of the calibration.
        cameras: for each camera of the rig, its entry of `calibration.json`.
        clocked: whether to add a column of clock offsets.
    """
    words = f"{len(rig.posed())} of {count(outcome.all_cameras, 'camera')} registered"
    columns = _list_columns(cameras, clocked)
    return _render(title, rig, outcome.verdict, words, columns, outcome.reasons, _notes(outcome.findings))


def _render(
    title: str, rig: Rig, verdict: str | None, words: str, more: Sequence[tuple[str, Sequence[str]]] = (),
    reasons: Sequence[str] = (), notes: Sequence[str] = (),
) -> str:  # fmt: skip
    """Fill in the template with a table row for each camera; `more` has further columns with their cells."""
    with_sigma = any(camera.sigma is not None for camera in rig)
    sigmas = ("± mm", "± deg") if with_sigma else ()
    rows = [
        {
            "name": camera.name, "colour": camera_colour(place),
            "cells": [*_cells(camera, with_sigma), *(cells[place] for _, cells in more)],
        }
        for place, camera in enumerate(rig)
    ]  # fmt: skip
    columns = ["x m", "y m", "height m", "heading deg", "tilt deg", *sigmas, *(title for title, _ in more)]
    return render(
        "notebook.html", title=title, verdict=verdict, words=words, reasons=reasons, columns=columns, rows=rows,
        above=draw_from_above(rig), notes=notes,
    )  # fmt: skip


def _list_columns(cameras: Sequence[CameraEntry], clocked: bool) -> list[tuple[str, list[str]]]:
    """Return columns about the cameras' observations, from their entries in `calibration.json`."""
    columns = [
        ("residual px", [_number(one.median_residual_px, 1) for one in cameras]),
        ("people", [_number(one.people, 0) for one in cameras]),
    ]
    return [*columns, *([("time offset s", [_number(one.time_offset_s, 3) for one in cameras])] if clocked else [])]


def _notes(findings: Sequence[str]) -> list[str]:
    """Return the first findings, and a count of the others."""
    more = len(findings) - MOST_NOTES
    return [*findings[:MOST_NOTES], *([f"and {more} more"] if more > 0 else [])]


def draw_from_above(rig: Rig) -> Row | None:
    """Draw the rig from above, x right, y up, with each camera's nearby view and one-sigma ellipse; None without poses."""
    posed = find_posed_cameras(rig)
    if not posed:
        return None
    centres = np.array([camera.centre[:2] for _, camera in posed])
    extent = max(float(np.ptp(centres, axis=0).max()), 2.0)
    wedges = [wedge(camera, REACH_SHARE * extent) for _, camera in posed]
    every = np.concatenate([centres, *wedges])
    low, high = every.min(axis=0) - 0.06 * extent, every.max(axis=0) + 0.06 * extent
    unit = min(WIDTH / (high[0] - low[0]), TALLEST / (high[1] - low[1]))
    size = (high - low) * unit

    def at(points: Floats) -> Floats:
        """Convert positions (N, 2), metres, to pixels."""
        return np.asarray((np.atleast_2d(points) - low) * unit * (1, -1) + (0, size[1]))

    sigmas = sigma_ellipses(rig, extent)
    ellipses = f"red: one sigma{sigmas.times}" if sigmas.outlines else ""
    return {
        "width": f"{size[0]:.0f}", "height": f"{size[1] + BELOW:.0f}", "ellipses": ellipses,
        **_grid(low, high, unit, at),
        "seen": [
            {"points": _path(at(one)), "colour": camera_colour(place)} for (place, _), one in zip(posed, wedges, strict=True)
        ],
        "sigmas": [_path(at(outline)) for outline in sigmas.outlines],
        "marks": [_mark(place, camera, at, float(size[0])) for place, camera in posed],
        "note": _text(ellipses, float(size[0]) - 4, float(size[1]) + 16, anchor="end"),
    }  # fmt: skip


def _grid(low: Floats, high: Floats, unit: float, at: Callable[[Floats], Floats]) -> Row:
    """Return the ground's grid, a bar with the length of its spacing, and the axes if the origin is in the drawn region."""
    spacing = _choose_round_length(float((high - low).max()) / 6)
    grid, axes = [], []
    for axis in range(2):
        for value in np.arange(np.ceil(low[axis] / spacing), np.floor(high[axis] / spacing) + 1) * spacing:
            ends = np.array([low, high])
            ends[:, axis] = value
            begin, end = at(ends)
            grid.append(_line(begin, end, "currentColor", 0.5, 0.25))
    corner = at(np.array([[low[0], low[1]]]))[0] + (6.0, 20.0)
    grid.append(_line(corner, corner + (spacing * unit, 0.0), "currentColor", 2.0))
    if ((low < 0) & (high > 0)).all():
        origin, *tips = at(np.array([[0.0, 0.0], [spacing, 0.0], [0.0, spacing]]))
        for name, tip, colour in zip("xy", tips, ("#d0342c", "#118855"), strict=True):
            axes.append((_line(origin, tip, colour, 2.0), _text(name, tip[0] + 3, tip[1] - 3)))
    return {"grid": grid, "spacing": _text(f"{spacing:g} m", corner[0], corner[1] - 4), "axes": axes}


def _choose_round_length(metres: float) -> float:
    """Return the length of the form 1, 2 or 5 times a power of ten that is nearest in ratio, metres."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda factor: abs(np.log(factor * power / metres))))


def _line(begin: Floats, end: Floats, colour: str, width: float, opacity: float = 1.0) -> Row:
    place = dict(zip(("x1", "y1", "x2", "y2"), (f"{one:.1f}" for one in (*begin, *end)), strict=True))
    return {**place, "colour": colour, "width": width, "opacity": opacity}


def _text(words: str, x: float, y: float, size: int = 11, *, anchor: str = "start") -> Row:
    return {"words": words, "x": f"{x:.1f}", "y": f"{y:.1f}", "size": size, "anchor": anchor}


def _path(points: Floats) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _mark(place: int, camera: Camera, at: Callable[[Floats], Floats], width: float) -> Row:
    """Return a camera's position and its name, which is on the side with more space."""
    x, y = at(camera.centre[None, :2])[0]
    left = x > width / 2
    name = _text(camera.name, x + (-6 if left else 6), y - 6, 12, anchor="end" if left else "start")
    return {"x": f"{x:.1f}", "y": f"{y:.1f}", "colour": camera_colour(place), "name": name}


def _cells(camera: Camera, with_sigma: bool) -> list[str]:
    """Return the texts of a camera's position, direction and sigmas; dashes without a pose."""
    pose, sigma = camera.pose, camera.sigma
    if pose is None:
        return ["–"] * (7 if with_sigma else 5)
    sure = [_number(None if sigma is None else 1000 * sigma.position_m, 0)]
    sure.append(_number(None if sigma is None else sigma.orientation_deg, 2))
    place = [_number(float(value), 3) for value in pose.centre]
    return [*place, _number(pose.heading_deg, 1), _number(pose.tilt_deg, 1), *(sure if with_sigma else ())]


def _number(value: float | None, digits: int) -> str:
    """Write a figure; a dash if there is none, `UNKNOWN` if it is infinite or NaN."""
    return figure(value, digits) if value is None or np.isfinite(value) else UNKNOWN
