"""The floor plan with the rig drawn on it: cameras, what they see, people's trajectories, and how far off each placement is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.colours import person_colour
from passerby.interchange.calibration_json import PlanEntry, ResidualEntry
from passerby.interchange.plan_picture import read_plan_picture
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.html import Html, element, join, plot, plot_text
from passerby.report.parts import Parts
from passerby.report.rig_geometry import Stage, joined, stage_of
from passerby.report.rig_plots import Figure, Trace, draw_cameras_from_above, draw_crowd, draw_ground_seen
from passerby.report.sheet import data_uri
from passerby.report.site_map import CELLS, draw_site
from passerby.report.tables import count, figure

MOST_PLACES = 8000
"""Of people that are drawn; of more every n-th."""
GOOD, WRONG = "#12805c", "#e5484d"
MARGIN = 0.03
"""Around what is drawn, as a share of it."""


def plan_drawing(
    contents: Contents, fit: Fitted, zones: Mapping[str, int] | None = None, parts: Parts | None = None
) -> Html | None:
    """The plan as a plot with its caption; None where no plan set the frame, or no camera has a pose.

    Args:
        contents: of the report.
        fit: of the whole sample.
        zones: of a site's cameras: few traces are drawn then, whatever their number; None for a rig.
        parts: of a site's page: gets the figure.
    """
    world = contents.document.world
    if world is None or world.plan is None or not len(contents.rig.posed()):
        return None
    residuals = world.residuals or ()
    off = [row.off_m for row in residuals if row.used and row.off_m is not None]
    left_out = sum(not row.used for row in residuals)
    told = f"The plan: {count(len(residuals), 'placement')} of cameras and points. A line runs from where each was placed to "
    told += "where the rig has it"
    told += f"; median {figure(float(np.median(off)), 2, ' m')}" if off else ""
    told += f". Red: {left_out} left out." if left_out else "."
    background, note = _background(world.plan, contents.document.scene_file)
    stage = stage_of(contents.rig, fit.ways.xy)
    if zones is None:
        people, cameras = _draw_ways(fit), draw_cameras_from_above(contents.rig, stage)
        ground = draw_ground_seen(contents.rig, stage)
    else:
        people, (ground, cameras) = draw_crowd(fit, stage, CELLS), draw_site(contents, zones, stage)
    layers = [*people, *ground, *_draw_residuals(residuals, world.plan), *cameras]
    drawn = plot("rig-plan", _figure(layers, stage, background), told, parts=parts)
    return join(drawn, element("p", f"{told}{note}", class_="note"))


def _figure(data: list[Trace], stage: Stage, background: dict[str, Any] | None) -> Figure:
    low, high = stage.low[:2], stage.high[:2]
    if background is not None:
        corner = np.array([background["x"], background["y"] - background["sizey"]])
        low = np.minimum(low, corner)
        high = np.maximum(high, corner + (background["sizex"], background["sizey"]))
    pad = MARGIN * float((high - low).max())
    axes = {
        key: {"title": {"text": f"{key[0]}, m"}, "range": [round(float(low[axis] - pad), 3), round(float(high[axis] + pad), 3)],
              "zeroline": False, "showgrid": background is None, "constrain": "domain"}
        for axis, key in enumerate(("xaxis", "yaxis"))
    }  # fmt: skip
    axes["yaxis"] |= {"scaleanchor": "x", "scaleratio": 1}
    layout: dict[str, Any] = {
        **axes, "height": 680, "margin": {"l": 56, "r": 16, "t": 16, "b": 52}, "hovermode": "closest",
        "legend": {"itemsizing": "constant", "orientation": "h", "y": -0.1, "yanchor": "top"},
        "images": [] if background is None else [background],
    }  # fmt: skip
    return {"data": data, "layout": layout}


def _background(plan: PlanEntry, scene_file: str | None) -> tuple[dict[str, Any] | None, str]:
    """The picture below the drawing, or why there is none."""
    try:
        picture = read_plan_picture(Path(plan.image) if scene_file is None else Path(scene_file).parent / plan.image)
    except InputError:
        return None, " The picture of the plan is not where it was, and is not shown."
    height, width = picture.shape[:2]
    unit, (u, v) = plan.metres_per_pixel, plan.origin
    return {
        "source": data_uri(picture), "xref": "x", "yref": "y", "x": (-0.5 - u) * unit, "y": (v + 0.5) * unit,
        "sizex": width * unit, "sizey": height * unit, "sizing": "stretch", "layer": "below",
    }, ""  # fmt: skip


def _draw_ways(fit: Fitted) -> list[Trace]:
    """Everybody's trajectory, in one colour a person."""
    ways, every = fit.ways, max(1, -(-len(fit.ways) // MOST_PLACES))
    out = list[Trace]()
    for identity in np.unique(ways.identity).tolist():
        own = np.flatnonzero(ways.identity == identity)
        parts = [ways.xy[own[ways.part[own] == part]][::every] for part in np.unique(ways.part[own])]
        x, y = joined(parts)
        out.append({
            "type": "scatter", "mode": "lines", "x": x, "y": y, "line": {"color": person_colour(identity), "width": 1},
            "opacity": 0.7, "hoverinfo": "skip", "showlegend": not out, "name": "people", "legendgroup": "people",
        })  # fmt: skip
    return out


def _draw_residuals(residuals: tuple[ResidualEntry, ...], plan: PlanEntry) -> list[Trace]:
    """A cross where each placement was clicked, and a line to where the rig has it; those left out in red."""
    out = list[Trace]()
    for used, colour, name in ((True, GOOD, "placed on the plan"), (False, WRONG, "left out")):
        some = [row for row in residuals if row.used == used and row.stated_m is not None]
        if not some:
            continue
        lines = [np.array([row.stated_m, row.found_m or row.stated_m]) for row in some]
        x, y = joined(lines, 3)
        words = [_hover(row, plan) for row in some]
        out.append({
            "type": "scatter", "mode": "lines", "x": x, "y": y, "line": {"color": colour, "width": 2}, "hoverinfo": "skip",
            "showlegend": False, "name": name,
        })  # fmt: skip
        where: Floats = np.array([row.stated_m for row in some])
        out.append({
            "type": "scatter", "mode": "markers", "x": where[:, 0].round(3).tolist(), "y": where[:, 1].round(3).tolist(),
            "marker": {"color": colour, "size": 9, "symbol": "x-thin", "line": {"color": colour, "width": 2}}, "name": name,
            "hoverinfo": "text", "hovertext": words,
        })  # fmt: skip
    return out


def _hover(row: ResidualEntry, plan: PlanEntry) -> str:
    what = f"camera {row.camera}" if row.point is None else f"point {row.point} in camera {row.camera}"
    off = "above the horizon" if row.off_m is None else f"{row.off_m:.2f} m, {row.off_m / plan.metres_per_pixel:.0f} px off"
    return plot_text(f"{what}: {off}")
