"""How a rig and a calibration look in a notebook: a table and the rig from above, as HTML without script or style sheet.

Text and lines take the notebook's own colour, so that both are readable on light and on dark ground. All text is escaped.
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
from passerby.report.html import Child, Html, element
from passerby.report.rig_geometry import posed_cameras, sigma_ellipses, wedge

WIDTH, TALLEST = 380, 360
"""Of the picture, pixels."""
BELOW = 26
"""Pixels for the bar of lengths and what the ellipses are."""
REACH_SHARE = 0.35
"""So much of the rig's extent is drawn of what each camera sees: all of it would cover the others."""
SIGMA = "#e5484d"
"""Of the ellipses, as in the report."""
NUMBER = "text-align:right;padding:1px 8px;font-variant-numeric:tabular-nums"
NAME = "text-align:left;padding:1px 8px;white-space:nowrap"
VERDICTS = {"accepted": ("#118855", "✓"), "doubtful": ("#b36b00", "!"), "refused": ("#d0342c", "✗")}
"""Colour of a verdict's frame, and its sign: colours alone tell nothing to some."""
MOST_NOTES = 12
"""Findings beyond are counted: the report has them all."""


def rig_html(rig: Rig) -> str:
    """A rig as a table of its cameras beside the rig from above."""
    verdict = None if rig.verdict is None else _pill(rig.verdict)
    posed = len(rig.posed())
    head = _head(element("b", "Rig"), verdict, f"{posed} of {_count(len(rig), 'camera')} with a pose")
    return _card(head, _place_side_by_side(_camera_table(rig), rig_svg(rig)))


def output_folder_html(folder: OutputFolder) -> str:
    """What a calibration has written, as `result_html`."""
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
    """How a calibration ended, as a person reads it."""

    verdict: str
    reasons: Sequence[str]
    findings: Sequence[str]
    all_cameras: int
    """Those without a pose too."""


def result_html(title: str, rig: Rig, outcome: Outcome, cameras: Sequence[CameraEntry], *, clocked: bool) -> str:
    """A calibration: the verdict with its reasons, the cameras, the rig from above, and what is odd about the input.

    Args:
        title: the scene's name.
        rig: all cameras that are listed.
        outcome: how it ended.
        cameras: of each camera of the rig, its entry of `calibration.json`.
        clocked: give a column of clock offsets.
    """
    head = _head(
        element("b", title), _pill(outcome.verdict),
        f"{len(rig.posed())} of {_count(outcome.all_cameras, 'camera')} registered",
    )  # fmt: skip
    return _card(
        head, _list("", outcome.reasons),
        _place_side_by_side(_camera_table(rig, _list_columns(cameras, clocked)), rig_svg(rig)),
        _notes(outcome.findings),
    )  # fmt: skip


def _list_columns(cameras: Sequence[CameraEntry], clocked: bool) -> list[tuple[str, list[str]]]:
    """Columns of what the cameras saw, from their entries in `calibration.json`."""
    columns = [
        ("residual px", [_number(one.median_residual_px, 1) for one in cameras]),
        ("people", [_number(one.people, 0) for one in cameras]),
    ]
    return [*columns, *([("time offset s", [_number(one.time_offset_s, 3) for one in cameras])] if clocked else [])]


def _notes(findings: Sequence[str]) -> Html | None:
    """The first findings, and how many there are besides."""
    notes = list(findings[:MOST_NOTES])
    if len(findings) > MOST_NOTES:
        notes.append(f"and {len(findings) - MOST_NOTES} more")
    return _list("Notes", notes)


def rig_svg(rig: Rig) -> Html | None:
    """The rig from above, x to the right and y up, with what each camera sees nearby and its one-sigma ellipse."""
    posed = posed_cameras(rig)
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
        """Pixels of places (N, 2), metres."""
        return np.asarray((np.atleast_2d(points) - low) * unit * (1, -1) + (0, size[1]))

    sigmas = sigma_ellipses(rig, extent)
    shapes = [
        _grid(low, high, unit, at),
        *(_draw_seen_ground(at(outline), camera_colour(place)) for (place, _), outline in zip(posed, wedges, strict=True)),
        *(_sigma(at(outline)) for outline in sigmas.outlines),
        *(_mark(place, camera, at, float(size[0])) for place, camera in posed),
    ]
    ellipses = f"red: one sigma{sigmas.times}" if sigmas.outlines else ""
    shapes.append(_text(ellipses, float(size[0]) - 4, float(size[1]) + 16, 11, anchor="end"))
    title = "The rig from above, x to the right, y up" + (f"; {ellipses}" if ellipses else "")
    return element(
        "svg", element("title", title), shapes, viewBox=f"0 0 {size[0]:.0f} {size[1] + BELOW:.0f}", width=f"{size[0]:.0f}",
        height=f"{size[1] + BELOW:.0f}", role="img", style="max-width:100%;height:auto;color:inherit",
    )  # fmt: skip


def _grid(low: Floats, high: Floats, unit: float, at: Callable[[Floats], Floats]) -> list[Html]:
    """Lines of the ground, a bar that tells how long their distance is, and the origin where it is within."""
    spacing = _choose_round_length(float((high - low).max()) / 6)
    lines = []
    for axis in range(2):
        for value in np.arange(np.ceil(low[axis] / spacing), np.floor(high[axis] / spacing) + 1) * spacing:
            ends = np.array([low, high])
            ends[:, axis] = value
            (x1, y1), (x2, y2) = at(ends)
            lines.append(_line(x1, y1, x2, y2, "currentColor", 0.5, opacity=0.25))
    corner = at(np.array([[low[0], low[1]]]))[0] + (6.0, 20.0)
    bar = _line(corner[0], corner[1], corner[0] + spacing * unit, corner[1], "currentColor", 2.0)
    label = _text(f"{spacing:g} m", corner[0], corner[1] - 4, 11)
    return [*lines, bar, label, *(_axes(spacing, at) if ((low < 0) & (high > 0)).all() else [])]


def _axes(length: float, at: Callable[[Floats], Floats]) -> list[Html]:
    """The origin with x in red and y in green, as long as a square of the grid."""
    (x0, y0), (x1, y1), (x2, y2) = at(np.array([[0.0, 0.0], [length, 0.0], [0.0, length]]))
    ends = (x1, y1, "#d0342c", "x"), (x2, y2, "#118855", "y")
    return [part for x, y, colour, name in ends for part in (_line(x0, y0, x, y, colour, 2.0), _text(name, x + 3, y - 3, 11))]


def _choose_round_length(metres: float) -> float:
    """1, 2 or 5 times a power of ten, about as long."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda factor: abs(np.log(factor * power / metres))))


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, width: float, *, opacity: float = 1.0) -> Html:
    return element(
        "line", x1=f"{x1:.1f}", y1=f"{y1:.1f}", x2=f"{x2:.1f}", y2=f"{y2:.1f}", stroke=colour, stroke_width=width,
        stroke_opacity=opacity,
    )  # fmt: skip


def _text(text: str, x: float, y: float, size: int, *, anchor: str = "start") -> Html:
    style = f"font:{size}px system-ui,sans-serif"
    return element("text", text, x=f"{x:.1f}", y=f"{y:.1f}", fill="currentColor", style=style, text_anchor=anchor)


def _path(points: Floats) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _draw_seen_ground(outline: Floats, colour: str) -> Html:
    """The ground that a camera sees nearby, pixels (N, 2)."""
    return element("polygon", points=_path(outline), fill=colour, fill_opacity=0.15, stroke=colour, stroke_opacity=0.7)


def _sigma(outline: Floats) -> Html:
    """A camera's ellipse of one sigma, pixels (N, 2)."""
    return element("polygon", points=_path(outline), fill=SIGMA, fill_opacity=0.25, stroke=SIGMA, stroke_width=1.5)


def _mark(place: int, camera: Camera, at: Callable[[Floats], Floats], width: float) -> list[Html]:
    """A camera's place and name, to the side where there is more room."""
    x, y = at(camera.centre[None, :2])[0]
    dot = element("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=4, fill=camera_colour(place), stroke="currentColor")
    left = x > width / 2
    return [dot, _text(camera.name, x + (-6 if left else 6), y - 6, 12, anchor="end" if left else "start")]


def _camera_table(rig: Rig, more: Sequence[tuple[str, Sequence[str]]] = ()) -> Html:
    """One row a camera; `more` has further columns with their cells."""
    with_sigma = any(camera.sigma is not None for camera in rig)
    sigmas = ("± mm", "± deg") if with_sigma else ()
    columns = ("x m", "y m", "height m", "heading deg", "tilt deg", *sigmas, *(title for title, _ in more))
    header = [element("th", "camera", style=NAME), *(element("th", title, style=NUMBER) for title in columns)]
    rows = [
        element(
            "tr",
            element("th", _swatch(place), camera.name, scope="row", style=NAME + ";font-weight:normal"),
            [element("td", cell, style=NUMBER) for cell in (*_cells(camera, with_sigma), *(cells[place] for _, cells in more))],
        )
        for place, camera in enumerate(rig)
    ]
    style = "border-collapse:collapse;font-size:13px;background:none;color:inherit"
    return element("table", element("thead", element("tr", header)), element("tbody", rows), style=style)


def _cells(camera: Camera, with_sigma: bool) -> list[str]:
    """Place and direction of a camera, and their sigmas."""
    pose, sigma = camera.pose, camera.sigma
    if pose is None:
        return ["–"] * (7 if with_sigma else 5)
    sure = [_number(None if sigma is None else 1000 * sigma.position_m, 0)]
    sure.append(_number(None if sigma is None else sigma.orientation_deg, 2))
    place = [_number(float(value), 3) for value in pose.centre]
    return [*place, _number(pose.heading_deg, 1), _number(pose.tilt_deg, 1), *(sure if with_sigma else ())]


def _number(value: float | None, digits: int) -> str:
    """A figure; a dash where there is none, a word where it is infinite. Adding zero turns -0.0 into 0.0."""
    if value is not None and not np.isfinite(value):
        return "unknown"
    return "–" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def _swatch(place: int) -> Html:
    """The camera's colour."""
    style = f"display:inline-block;width:9px;height:9px;margin-right:6px;background:{camera_colour(place)}"
    return element("span", style=style, aria_hidden="true")


def _pill(verdict: str) -> Html:
    """The verdict in a frame of its colour."""
    colour, sign = VERDICTS.get(verdict, ("currentColor", "?"))
    style = f"border:1.5px solid {colour};border-radius:9px;padding:0 8px;margin:0 8px;white-space:nowrap"
    return element("span", f"{sign} {verdict}", style=style)


def _head(*parts: Child) -> Html:
    return element("div", parts, style="margin-bottom:6px")


def _list(title: str, lines: Sequence[str]) -> Html | None:
    """Sentences one below the other; nothing where there are none."""
    if not lines:
        return None
    heading = element("div", title, style="margin-top:6px") if title else None
    points = [element("li", line) for line in lines]
    return element("div", heading, element("ul", points, style="margin:2px 0 6px;padding-left:20px"))


def _place_side_by_side(*parts: Child) -> Html:
    """Parts beside each other, or below where there is no room."""
    return element("div", parts, style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-start")


def _card(*parts: Child) -> str:
    return str(element("div", parts, style="font:13px system-ui,sans-serif;color:inherit;max-width:1100px"))


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
