"""The rig in space, as a plotly figure in plain values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.colours import camera_colour, person_colour
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.ground_layer import AXIS_COLOURS, grid_lines
from passerby.report.rig_geometry import FRUSTUM_SHARE, Stage, frustum, joined, stage_of, thinned_parts
from passerby.report.rig_labels import hover_words, posed_cameras, told, unregistered

Figure = dict[str, Any]
Trace = dict[str, Any]

MOST_PLACES = 6000
"""Of ways."""
FAINT = "rgba(128,128,128,0.6)"
"""Lines of the ground: seen on white and on near-black."""
UP_COLOUR = "#3e7bfa"
SCENE_SIZE = 1.6
"""Of the longest side of what is drawn, in plotly's own units, in which it also tells where the eye is."""


def rig_in_space(contents: Contents, fit: Fitted) -> Figure:
    """Cameras with what they see, the ground, the trajectories of people and which way is up.

    `layout.meta.views` lists views: {label, camera: {eye, center, up}}, for `scene.camera`.
    """
    stage = stage_of(contents.rig, fit.ways.xy)
    data = [_ground(stage), *_axes(stage), *_ways(fit), *draw_cameras_in_space(contents.rig, stage)]
    size = stage.high - stage.low
    unit = SCENE_SIZE / float(size.max())
    views = _views(contents, stage, unit)
    axes = {
        f"{name}axis": {
            "range": [round(float(stage.low[k]), 3), round(float(stage.high[k]), 3)],
            "title": {"text": f"{name}, m"},
            "showspikes": False,
            "showgrid": False,
            "zeroline": False,
            "nticks": 4 if name == "z" else 8,
        }
        for k, name in enumerate("xyz")
    }
    ratio = {name: round(float(size[k]) * unit, 4) for k, name in enumerate("xyz")}
    scene = {**axes, "aspectmode": "manual", "aspectratio": ratio, "camera": views[0]["camera"], "dragmode": "orbit"}
    legend = {"itemsizing": "constant", "orientation": "h", "y": 0, "yanchor": "bottom"}
    meta = {"views": views, "unregistered": unregistered(contents.rig)}
    layout = {"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "legend": legend, "meta": meta}
    return {"data": data, "layout": layout}


def _lines(points: list[list[float | None]], **more: Any) -> Trace:
    """A trace in space of lines with gaps; hovering over it tells nothing, unless `more` says what."""
    x, y, z = points if points else ([], [], [])
    return {"type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, "hoverinfo": "skip", "showlegend": False, **more}


def _ground(stage: Stage) -> Trace:
    begin, end = grid_lines(stage.low[:2], stage.high[:2], stage.spacing)
    low, high = np.append(stage.low[:2], 0.0), np.append(stage.high[:2], 0.0)
    lines = [np.clip(np.stack([a, b]), low, high) for a, b in zip(begin, end, strict=True)]
    # A line that lies outside what is drawn would be moved onto its border.
    inside = [line for line, a, b in zip(lines, begin, end, strict=True) if _on_itself(line, a, b)]
    return _lines(joined(inside), name=f"ground, {stage.spacing:g} m", line={"color": FAINT, "width": 1.5})


def _on_itself(line: Floats, begin: Floats, end: Floats) -> bool:
    """Whether a cut-off line (2, 3) lies on the line that it was cut from."""
    constant = begin == end
    return bool(np.array_equal(line[0][constant], begin[constant]))


def _axes(stage: Stage) -> list[Trace]:
    """x, y and up, from the world's origin."""
    length = min(stage.spacing, 0.25 * stage.reach)
    out = []
    for k, (label, colour) in enumerate({**AXIS_COLOURS, "z, up": UP_COLOUR}.items()):
        end = np.zeros((2, 3))
        end[1, k] = length
        out.append(
            _lines(
                joined([end]), mode="lines+text", text=["", label], textposition="top center", textfont={"color": colour},
                line={"color": colour, "width": 5}, name=f"axis {label}",
            )
        )  # fmt: skip
    return out


def _ways(fit: Fitted) -> list[Trace]:
    """The ways over the ground, one trace a colour."""
    ways, by_colour = fit.ways, dict[str, list[NDArray[np.int64]]]()
    for rows in thinned_parts(ways, MOST_PLACES):
        by_colour.setdefault(person_colour(int(ways.identity[rows[0]])), []).append(rows)
    out = []
    for number, colour in enumerate(sorted(by_colour)):
        parts = by_colour[colour]
        points = [np.column_stack([ways.xy[rows], np.full(len(rows), 0.02)]) for rows in parts]
        who = [np.column_stack([ways.identity[rows], ways.seconds[rows]]) for rows in parts]
        identity, seconds = joined(who, 1)
        shown = {
            "name": "trajectories of people", "legendgroup": "ways", "showlegend": number == 0, "opacity": 0.75,
            "line": {"color": colour, "width": 2.5}, "hoverinfo": "text",
            "hovertext": [
                "" if one is None else f"person {one:.0f}<br>{when:.1f} s" for one, when in zip(identity, seconds, strict=True)
            ],
        }  # fmt: skip
        out.append(_lines(joined(points), **shown))
    return out


def draw_cameras_in_space(rig: Rig, stage: Stage) -> list[Trace]:
    """Of each camera its frustum, with its name at the centre."""
    out = []
    for place, camera in posed_cameras(rig):
        border = frustum(camera, FRUSTUM_SHARE * stage.reach)
        corners = border[:: max(1, len(border) // 4)][:4]
        strokes = [camera.centre[None], np.concatenate([border, border[:1]]), *(np.stack([camera.centre, p]) for p in corners)]
        points = joined(strokes, 3)
        colour, words = camera_colour(place), hover_words(camera)
        name, group = told(camera.name), f"camera {place}"
        foot = np.stack([camera.centre, camera.centre * (1, 1, 0)])
        shown = {"line": {"color": colour, "width": 3}, "hoverinfo": "text", "hovertext": words, "name": name}
        out.append(_lines(points, legendgroup=group, showlegend=True, **shown))
        out.append(_lines(joined([foot], 3), line={"color": colour, "width": 1.5, "dash": "dot"}, legendgroup=group, name=name))
        x, y, z = joined([camera.centre[None]], 3)
        out.append({
            "type": "scatter3d", "mode": "markers+text", "x": x, "y": y, "z": z, "text": [name], "textposition": "top center",
            "textfont": {"color": colour}, "marker": {"color": colour, "size": 4}, "hoverinfo": "text", "hovertext": [words],
            "legendgroup": group, "showlegend": False, "name": name,
        })  # fmt: skip
    return out


def _views(contents: Contents, stage: Stage, unit: float) -> list[dict[str, Any]]:
    """Where the eye may be, in plotly's units: the middle of what is drawn is 0."""
    around = 0.5 * (stage.low + stage.high)
    middle = (stage.middle + (0, 0, 1.0) - around) * unit
    far = np.clip(2.9 * stage.reach * unit, 0.5, 2.2)
    up = np.array([0.0, 0.0, 1.0])
    whole = np.zeros(3)
    # What is near looks large: the middle of the picture lies on this side of the rig's.
    oblique = np.array([0.55, -0.75, 0.0])
    nearer = middle + 0.15 * far * oblique
    found = [
        ("Oblique", nearer + far * (0.8 * oblique + (0, 0, 0.55)), nearer),
        # Straight down a turning view does not know which way is up.
        ("From above", whole + (0, -0.01, 1.35 * SCENE_SIZE), whole),
        ("Along x", middle + far * np.array([-1.0, 0.0, 0.12]), middle),
        ("Along y", middle + far * np.array([0.0, -1.0, 0.12]), middle),
    ]
    for _, camera in posed_cameras(contents.rig):
        assert camera.pose is not None
        eye = (camera.centre - around) * unit
        found.append((f"From {told(camera.name)}", eye, eye + 0.5 * camera.pose.R_cw[2]))
    return [
        {"label": label, "camera": {"eye": _point(eye), "center": _point(centre), "up": _point(up)}}
        for label, eye, centre in found
    ]


def _point(values: Floats) -> dict[str, float]:
    return {name: round(float(values[k]), 4) + 0.0 for k, name in enumerate("xyz")}
