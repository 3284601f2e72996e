"""The rig in space and from above, as plotly figures in plain values: {"data": [...], "layout": {...}}.

The figures set no colours of text, grid and background: the page sets these for its light and dark styles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.colours import camera_colour, person_colour
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.layers import AXIS_COLOURS, grid_lines
from passerby.report.rig_geometry import (
    CELLS,
    FRUSTUM_SHARE,
    WEDGE_SHARE,
    SigmaEllipses,
    Stage,
    density,
    escape_name,
    faint,
    find_posed_cameras,
    frustum,
    hover_words,
    join_stretches,
    sigma_ellipses,
    stage_of,
    thin_parts,
    unregistered,
    wedge,
)

Figure = dict[str, Any]
Trace = dict[str, Any]
PASSED = "#8e4ec6"
CROWD = "76,141,246"
"""Red, green, blue of the map of people's positions."""
FEW_PLACES = 40
"""Fewer positions than this are drawn as points."""
CROWDED = 0.06
"""Cameras that are nearer to each other than this share of the drawn extent have their names on different sides."""
SIDES = ("middle right", "middle left", "top right", "bottom left")
MOST_PLACES = 6000
"""Approximate largest number of drawn positions in trajectories."""
FAINT = "rgba(128,128,128,0.6)"
"""Colour of the ground's lines: visible on white and on near-black."""
UP_COLOUR = "#3e7bfa"
SCENE_SIZE = 1.6
"""Length of the scene's longest side in plotly's own units; positions of the eye are in the same units."""


def rig_from_above(contents: Contents, fit: Fitted) -> Figure:
    """Draw the rig from above: cameras, the ground they see, the uncertainty of their positions, and the people's positions.

    `layout.meta.magnification` is the factor by which the ellipses are magnified.
    """
    rig, stage = contents.rig, stage_of(contents.rig, fit.ways.xy)
    ellipses = sigma_ellipses(rig, stage.extent)
    cameras = draw_cameras_from_above(rig, stage)
    ground = draw_ground_seen(rig, stage)
    data = [*draw_crowd(fit, stage), *ground, *draw_passages(contents), *draw_ellipses(ellipses), *cameras]
    missing = unregistered(rig)
    layout: dict[str, Any] = {
        **layout_from_above(stage), "height": 620,
        "meta": {"magnification": ellipses.factor, "unregistered": missing},
    }  # fmt: skip
    if missing:
        layout["annotations"] = [{
            "text": "not registered: " + ", ".join(missing), "xref": "paper", "yref": "paper", "x": 0, "y": 1,
            "xanchor": "left", "yanchor": "top", "showarrow": False,
        }]  # fmt: skip
    return {"data": data, "layout": layout}


def layout_from_above(stage: Stage) -> Figure:
    """Return the common layout of plots from above: both axes in metres with one scale, margins and the legend."""
    return {
        "xaxis": {"title": {"text": "x, m"}, "range": _range(stage, 0), "zeroline": False, "constrain": "domain"},
        "yaxis": {
            "title": {"text": "y, m"}, "range": _range(stage, 1), "zeroline": False, "scaleanchor": "x", "scaleratio": 1,
            "constrain": "domain",
        },
        "margin": {"l": 56, "r": 16, "t": 16, "b": 52}, "hovermode": "closest",
        "legend": {"itemsizing": "constant", "orientation": "h", "y": -0.1, "yanchor": "top"},
    }  # fmt: skip


def _range(stage: Stage, axis: int) -> list[float]:
    return [round(float(stage.low[axis]), 3), round(float(stage.high[axis]), 3)]


def draw_crowd(fit: Fitted, stage: Stage, cells: int = CELLS) -> list[Trace]:
    """Draw the people's positions as a map with `cells` cells in one direction, or as points if they are few."""
    places = fit.ways.xy
    if len(places) < FEW_PLACES:
        xs, ys = join_stretches([places]) if len(places) else ([], [])
        marker = {"color": f"rgba({CROWD},0.7)", "size": 5}
        few = {"type": "scatter", "mode": "markers", "x": xs, "y": ys, "marker": marker, "name": "people", "hoverinfo": "skip"}
        return [few] if len(places) else []
    x, y, share = density(places, stage.low[:2], stage.high[:2], cells)
    columns, rows = np.flatnonzero(share.any(axis=0)), np.flatnonzero(share.any(axis=1))
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    # The square root, so that a person who stood still for long does not make all trajectories faint.
    values = np.sqrt(share[part] / share.max())
    return [{
        "type": "heatmap", "x": np.round(x[part[1]], 3).tolist(), "y": np.round(y[part[0]], 3).tolist(),
        "z": [[round(value, 2) if value > 0 else None for value in row] for row in values.tolist()], "zmin": 0, "zmax": 1,
        "colorscale": [[0, f"rgba({CROWD},0.12)"], [1, f"rgba({CROWD},0.85)"]], "showscale": False, "hoverinfo": "skip",
        "name": "where people were", "showlegend": True,
    }]  # fmt: skip


def draw_ground_seen(rig: Rig, stage: Stage) -> list[Trace]:
    """Draw the ground near each camera that it sees."""
    out = []
    for place, camera in find_posed_cameras(rig):
        x, y = join_stretches([wedge(camera, WEDGE_SHARE * stage.reach)])
        colour = camera_colour(place)
        out.append({
            "type": "scatter", "mode": "lines", "x": x, "y": y, "fill": "toself", "fillcolor": faint(colour, 0.13),
            "line": {"color": faint(colour, 0.7), "width": 1}, "hoverinfo": "skip", "showlegend": False,
            "legendgroup": f"camera {place}", "name": escape_name(camera.name),
        })  # fmt: skip
    return out


def draw_ellipses(ellipses: SigmaEllipses) -> list[Trace]:
    """Draw the ellipses of all cameras that have sigmas, as one trace."""
    if not ellipses.outlines:
        return []
    x, y = join_stretches(ellipses.outlines, 4)
    name = f"1 sigma{ellipses.times}" + ("" if ellipses.directed else " (circles: directions unknown)")
    return [{
        "type": "scatter", "mode": "lines", "x": x, "y": y, "fill": "toself", "fillcolor": "rgba(229,72,77,0.18)",
        "line": {"color": "#e5484d", "width": 1.5}, "hoverinfo": "skip", "name": name,
    }]  # fmt: skip


def draw_cameras_from_above(rig: Rig, stage: Stage) -> list[Trace]:
    """Draw for each camera a mark with its name, and a stroke in its viewing direction."""
    out = []
    near, taken = CROWDED * stage.extent, list[tuple[Floats, str]]()
    for place, camera in find_posed_cameras(rig):
        assert camera.pose is not None
        ahead = camera.pose.R_cw[2, :2]
        level = float(np.hypot(*ahead))
        tip = camera.centre[:2] + 0.07 * stage.reach * ahead / max(level, 1e-9)
        x, y = join_stretches([np.stack([camera.centre[:2], tip])], 3)
        used = {side for where, side in taken if np.hypot(*(where - camera.centre[:2])) < near}
        sides = ("top", "bottom") if ahead[1] <= 0 else ("bottom", "top")
        side = next((one for one in (f"{sides[0]} center", f"{sides[1]} center", *SIDES) if one not in used), SIDES[0])
        taken.append((camera.centre[:2], side))
        out.append({
            "type": "scatter", "mode": "lines+markers+text", "x": x, "y": y, "text": [escape_name(camera.name), ""],
            "textposition": side, "marker": {"color": camera_colour(place), "size": [10, 0], "symbol": "square"},
            "line": {"color": camera_colour(place), "width": 3}, "hoverinfo": "text", "hovertext": [hover_words(camera), ""],
            "name": escape_name(camera.name), "legendgroup": f"camera {place}", "showlegend": False, "cliponaxis": False,
        })  # fmt: skip
    return out


def draw_passages(contents: Contents) -> list[Trace]:
    """Draw dashed lines between groups of cameras that only people who pass from one group to the other connect."""
    at = {camera.name: camera.centre[:2] for _, camera in find_posed_cameras(contents.rig)}
    joined = [
        one for one in contents.document.diagnostics or () if one.code == "groups_joined" and set(one.cameras) <= at.keys()
    ]  # fmt: skip
    if not joined:
        return []
    x, y = join_stretches([np.stack([at[name] for name in one.cameras]) for one in joined], 1)
    return [{
        "type": "scatter", "mode": "lines", "x": x, "y": y, "hoverinfo": "skip", "name": "joined by people who pass",
        "line": {"color": PASSED, "width": 3, "dash": "dash"},
    }]  # fmt: skip


def rig_in_space(contents: Contents, fit: Fitted) -> Figure:
    """Draw the rig in space: cameras with their frusta, the ground, the trajectories of people, and the axes.

    `layout.meta.views` lists views: {label, camera: {eye, center, up}}, for `scene.camera`.
    """
    stage = stage_of(contents.rig, fit.ways.xy)
    data = [_ground(stage), *_axes(stage), *_draw_trajectories(fit), *draw_cameras_in_space(contents.rig, stage)]
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
    """Return a trace in space of lines with gaps; it has no text on hover, unless `more` sets one."""
    x, y, z = points if points else ([], [], [])
    return {"type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, "hoverinfo": "skip", "showlegend": False, **more}


def _ground(stage: Stage) -> Trace:
    begin, end = grid_lines(stage.low[:2], stage.high[:2], stage.spacing)
    low, high = np.append(stage.low[:2], 0.0), np.append(stage.high[:2], 0.0)
    lines = [np.clip(np.stack([a, b]), low, high) for a, b in zip(begin, end, strict=True)]
    # Clipping moves a line outside the drawn region onto its border: such lines are left out.
    inside = [line for line, a, b in zip(lines, begin, end, strict=True) if _lies_on_source(line, a, b)]
    return _lines(join_stretches(inside), name=f"ground, {stage.spacing:g} m", line={"color": FAINT, "width": 1.5})


def _lies_on_source(line: Floats, begin: Floats, end: Floats) -> bool:
    """Check whether a clipped line (2, 3) lies on the line from which it was clipped."""
    constant = begin == end
    return bool(np.array_equal(line[0][constant], begin[constant]))


def _axes(stage: Stage) -> list[Trace]:
    """Draw the axes x, y and up from the world's origin."""
    length = min(stage.spacing, 0.25 * stage.reach)
    out = []
    for k, (label, colour) in enumerate({**AXIS_COLOURS, "z, up": UP_COLOUR}.items()):
        end = np.zeros((2, 3))
        end[1, k] = length
        out.append(
            _lines(
                join_stretches([end]), mode="lines+text", text=["", label], textposition="top center",
                textfont={"color": colour}, line={"color": colour, "width": 5}, name=f"axis {label}",
            )
        )  # fmt: skip
    return out


def _draw_trajectories(fit: Fitted) -> list[Trace]:
    """Draw the trajectories on the ground, one trace per colour."""
    ways, by_colour = fit.ways, dict[str, list[NDArray[np.int64]]]()
    for rows in thin_parts(ways, MOST_PLACES):
        by_colour.setdefault(person_colour(int(ways.identity[rows[0]])), []).append(rows)
    out = []
    for number, colour in enumerate(sorted(by_colour)):
        parts = by_colour[colour]
        points = [np.column_stack([ways.xy[rows], np.full(len(rows), 0.02)]) for rows in parts]
        who = [np.column_stack([ways.identity[rows], ways.seconds[rows]]) for rows in parts]
        identity, seconds = join_stretches(who, 1)
        shown = {
            "name": "trajectories of people", "legendgroup": "ways", "showlegend": number == 0, "opacity": 0.75,
            "line": {"color": colour, "width": 2.5}, "hoverinfo": "text",
            "hovertext": [
                "" if one is None else f"person {one:.0f}<br>{when:.1f} s" for one, when in zip(identity, seconds, strict=True)
            ],
        }  # fmt: skip
        out.append(_lines(join_stretches(points), **shown))
    return out


def draw_cameras_in_space(rig: Rig, stage: Stage) -> list[Trace]:
    """Draw the frustum of each camera, with its name at the camera centre."""
    out = []
    for place, camera in find_posed_cameras(rig):
        border = frustum(camera, FRUSTUM_SHARE * stage.reach)
        corners = border[:: max(1, len(border) // 4)][:4]
        strokes = [camera.centre[None], np.concatenate([border, border[:1]]), *(np.stack([camera.centre, p]) for p in corners)]
        points = join_stretches(strokes, 3)
        colour, words = camera_colour(place), hover_words(camera)
        name, group = escape_name(camera.name), f"camera {place}"
        foot = np.stack([camera.centre, camera.centre * (1, 1, 0)])
        shown = {"line": {"color": colour, "width": 3}, "hoverinfo": "text", "hovertext": words, "name": name}
        out.append(_lines(points, legendgroup=group, showlegend=True, **shown))
        out.append(
            _lines(join_stretches([foot], 3), line={"color": colour, "width": 1.5, "dash": "dot"}, legendgroup=group, name=name)
        )
        x, y, z = join_stretches([camera.centre[None]], 3)
        out.append({
            "type": "scatter3d", "mode": "markers+text", "x": x, "y": y, "z": z, "text": [name], "textposition": "top center",
            "textfont": {"color": colour}, "marker": {"color": colour, "size": 4}, "hoverinfo": "text", "hovertext": [words],
            "legendgroup": group, "showlegend": False, "name": name,
        })  # fmt: skip
    return out


def _views(contents: Contents, stage: Stage, unit: float) -> list[dict[str, Any]]:
    """Return the views, in plotly's units: the middle of the drawn region is 0."""
    around = 0.5 * (stage.low + stage.high)
    middle = (stage.middle + (0, 0, 1.0) - around) * unit
    far = np.clip(2.9 * stage.reach * unit, 0.5, 2.2)
    up = np.array([0.0, 0.0, 1.0])
    whole = np.zeros(3)
    # Near objects look large in perspective: so the view is centred on a point nearer to the eye than the rig's middle.
    oblique = np.array([0.55, -0.75, 0.0])
    nearer = middle + 0.15 * far * oblique
    found = [
        ("Oblique", nearer + far * (0.8 * oblique + (0, 0, 0.55)), nearer),
        # A view straight down has no defined up direction, so the eye is slightly off.
        ("From above", whole + (0, -0.01, 1.35 * SCENE_SIZE), whole),
        ("Along x", middle + far * np.array([-1.0, 0.0, 0.12]), middle),
        ("Along y", middle + far * np.array([0.0, -1.0, 0.12]), middle),
    ]
    for _, camera in find_posed_cameras(contents.rig):
        assert camera.pose is not None
        eye = (camera.centre - around) * unit
        found.append((f"From {escape_name(camera.name)}", eye, eye + 0.5 * camera.pose.R_cw[2]))
    return [
        {"label": label, "camera": {"eye": _point(eye), "center": _point(centre), "up": _point(up)}}
        for label, eye, centre in found
    ]


def _point(values: Floats) -> dict[str, float]:
    return {name: round(float(values[k]), 4) + 0.0 for k, name in enumerate("xyz")}
