"""The rig from above, as a plotly figure in plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.colours import camera_colour
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.rig_geometry import (
    CELLS,
    WEDGE_SHARE,
    SigmaEllipses,
    Stage,
    density,
    joined,
    sigma_ellipses,
    stage_of,
    wedge,
)  # fmt: skip
from passerby.report.rig_labels import faint, hover_words, posed_cameras, told, unregistered

Figure = dict[str, Any]
Trace = dict[str, Any]

CROWD = "76,141,246"
"""Red, green, blue of where people were."""
FEW_PLACES = 40
"""Fewer are drawn as points."""
CROWDED = 0.06
"""Names of cameras nearer to each other than this share of what is drawn stand on different sides."""
SIDES = ("middle right", "middle left", "top right", "bottom left")


def rig_from_above(contents: Contents, fit: Fitted) -> Figure:
    """The plan: cameras, what ground they see, how certain their places are, and where people were.

    `layout.meta.magnification` tells how many times as large the ellipses are drawn.
    """
    rig, stage = contents.rig, stage_of(contents.rig, fit.ways.xy)
    ellipses = sigma_ellipses(rig, stage.extent)
    cameras = draw_cameras_from_above(rig, stage)
    data = [*draw_crowd(fit, stage), *draw_ground_seen(rig, stage), *draw_ellipses(ellipses), *cameras]
    missing = unregistered(rig)
    layout: dict[str, Any] = {
        **seen_from_above(stage), "height": 620,
        "meta": {"magnification": ellipses.factor, "unregistered": missing},
    }  # fmt: skip
    if missing:
        layout["annotations"] = [{
            "text": "not registered: " + ", ".join(missing), "xref": "paper", "yref": "paper", "x": 0, "y": 1,
            "xanchor": "left", "yanchor": "top", "showarrow": False,
        }]  # fmt: skip
    return {"data": data, "layout": layout}


def seen_from_above(stage: Stage) -> Figure:
    """What layouts of plots from above have in common: both axes in metres, of one scale, margins and the legend."""
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
    """Where people were: a map of so many cells in a direction, or points where there are few."""
    places = fit.ways.xy
    if len(places) < FEW_PLACES:
        xs, ys = joined([places]) if len(places) else ([], [])
        marker = {"color": f"rgba({CROWD},0.7)", "size": 5}
        few = {"type": "scatter", "mode": "markers", "x": xs, "y": ys, "marker": marker, "name": "people", "hoverinfo": "skip"}
        return [few] if len(places) else []
    x, y, share = density(places, stage.low[:2], stage.high[:2], cells)
    columns, rows = np.flatnonzero(share.any(axis=0)), np.flatnonzero(share.any(axis=1))
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    # The root, so that one who stood still for long does not outshine everybody's ways.
    values = np.sqrt(share[part] / share.max())
    return [{
        "type": "heatmap", "x": np.round(x[part[1]], 3).tolist(), "y": np.round(y[part[0]], 3).tolist(),
        "z": [[round(value, 2) if value > 0 else None for value in row] for row in values.tolist()], "zmin": 0, "zmax": 1,
        "colorscale": [[0, f"rgba({CROWD},0.12)"], [1, f"rgba({CROWD},0.85)"]], "showscale": False, "hoverinfo": "skip",
        "name": "where people were", "showlegend": True,
    }]  # fmt: skip


def draw_ground_seen(rig: Rig, stage: Stage) -> list[Trace]:
    """The ground that each camera sees nearby."""
    out = []
    for place, camera in posed_cameras(rig):
        x, y = joined([wedge(camera, WEDGE_SHARE * stage.reach)])
        colour = camera_colour(place)
        out.append({
            "type": "scatter", "mode": "lines", "x": x, "y": y, "fill": "toself", "fillcolor": faint(colour, 0.13),
            "line": {"color": faint(colour, 0.7), "width": 1}, "hoverinfo": "skip", "showlegend": False,
            "legendgroup": f"camera {place}", "name": told(camera.name),
        })  # fmt: skip
    return out


def draw_ellipses(ellipses: SigmaEllipses) -> list[Trace]:
    """One trace with the ellipses of all cameras that have sigmas."""
    if not ellipses.outlines:
        return []
    x, y = joined(ellipses.outlines, 4)
    name = f"1 sigma{ellipses.times}" + ("" if ellipses.directed else " (circles: directions unknown)")
    return [{
        "type": "scatter", "mode": "lines", "x": x, "y": y, "fill": "toself", "fillcolor": "rgba(229,72,77,0.18)",
        "line": {"color": "#e5484d", "width": 1.5}, "hoverinfo": "skip", "name": name,
    }]  # fmt: skip


def draw_cameras_from_above(rig: Rig, stage: Stage) -> list[Trace]:
    """Of each camera a mark with its name, and a stroke where it looks."""
    out = []
    near, taken = CROWDED * stage.extent, list[tuple[Floats, str]]()
    for place, camera in posed_cameras(rig):
        assert camera.pose is not None
        ahead = camera.pose.R_cw[2, :2]
        level = float(np.hypot(*ahead))
        tip = camera.centre[:2] + 0.07 * stage.reach * ahead / max(level, 1e-9)
        x, y = joined([np.stack([camera.centre[:2], tip])], 3)
        used = {side for where, side in taken if np.hypot(*(where - camera.centre[:2])) < near}
        sides = ("top", "bottom") if ahead[1] <= 0 else ("bottom", "top")
        side = next((one for one in (f"{sides[0]} center", f"{sides[1]} center", *SIDES) if one not in used), SIDES[0])
        taken.append((camera.centre[:2], side))
        out.append({
            "type": "scatter", "mode": "lines+markers+text", "x": x, "y": y, "text": [told(camera.name), ""],
            "textposition": side, "marker": {"color": camera_colour(place), "size": [10, 0], "symbol": "square"},
            "line": {"color": camera_colour(place), "width": 3}, "hoverinfo": "text", "hovertext": [hover_words(camera), ""],
            "name": told(camera.name), "legendgroup": f"camera {place}", "showlegend": False, "cliponaxis": False,
        })  # fmt: skip
    return out
