"""The map of a site, and the site in space, as few traces for any number of cameras.

The module also draws the rig on a floor plan: cameras, their views, people's trajectories, and the residual of each placement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.colours import person_colour
from passerby.interchange.calibration_json import PlanEntry, ResidualEntry
from passerby.interchange.plan_picture import read_plan_picture
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.parts import Parts
from passerby.report.rendering import Plot, plot, plot_text
from passerby.report.rig_geometry import (
    WEDGE_SHARE,
    Stage,
    escape_name,
    faint,
    find_posed_cameras,
    frustum,
    hover_words,
    join_stretches,
    sigma_ellipses,
    stage_of,
    unregistered,
    wedge,
)
from passerby.report.rig_plots import (
    Figure,
    Trace,
    draw_cameras_from_above,
    draw_crowd,
    draw_ellipses,
    draw_ground_seen,
    draw_passages,
    layout_from_above,
)
from passerby.report.seen import zone_colour
from passerby.report.sheet import data_uri
from passerby.report.tables import count, figure
from passerby.report.view_graph import Link

REACH_M = 12.0
"""Largest distance to which a camera's view is drawn: people of sites are rarely farther away."""
SPREAD_M = 8.0
"""Largest depth of a drawn frustum."""
CELLS = 160
"""Number of cells of the map of people's positions, in one direction."""
ELLIPSE_SPACINGS = 4.0
"""Ellipses are scaled for a drawing of at most this many median distances between neighbouring cameras: the longest semi-axis
is then about a quarter of such a distance."""
BEYOND = 0
"""Zone number of cameras without a zone."""
LINKS = (("weak", "#b86e00", True), ("fair", "#4c8df6", False), ("strong", "#2b8a57", False))
"""Words of pairs, their colours, and whether they are shown at first: only weak pairs are, as they require attention."""
CORNERS = 4
MARKED = "#e5484d"
NO_ZONE = "#808080"
MOST_PLACES = 8000
"""Most positions of people that are drawn; of more, every n-th is drawn."""
GOOD, WRONG = "#12805c", "#e5484d"
MARGIN = 0.03
"""Margin around the drawn region, as a share of its longer side."""


def site_map(
    contents: Contents, fit: Fitted, zones: Mapping[str, int], links: Sequence[Link], marked: Mapping[str, str]
) -> Figure:
    """Draw the map of a site. The page's script reads `layout.meta` to place names where there is space and to show one zone.

    Args:
        contents: of the report.
        fit: of the whole sample.
        zones: of the cameras, from `zones_of`.
        links: pairs of cameras; the used ones are drawn.
        marked: by camera, a word for what is wrong, only for cameras with a problem.
    """
    rig, stage = contents.rig, stage_of(contents.rig, fit.ways.xy)
    ellipses = sigma_ellipses(rig, min(stage.extent, ELLIPSE_SPACINGS * _spacing(contents)))
    by_zone = _group_by_zone(contents, zones)
    ground, cameras = draw_site(contents, zones, stage)
    data = [
        *draw_crowd(fit, stage, CELLS),
        *ground,
        *_links(contents, links),
        *draw_passages(contents),
        *draw_ellipses(ellipses),
        *cameras,
        *_mark_problems(contents, marked),
        {"type": "scatter", "mode": "text", "x": [], "y": [], "text": [], "hoverinfo": "skip", "showlegend": False},
    ]  # fmt: skip
    posed = find_posed_cameras(rig)
    missing = unregistered(rig)
    layout: dict[str, Any] = {
        **layout_from_above(stage), "height": 680,
        "meta": {
            "magnification": ellipses.factor, "unregistered": missing,
            "cameras": {
                "place": [place for place, _ in posed], "name": [escape_name(camera.name) for _, camera in posed],
                "x": [round(float(camera.centre[0]), 2) for _, camera in posed],
                "y": [round(float(camera.centre[1]), 2) for _, camera in posed],
                "first": [int(camera.name in marked) for _, camera in posed],
            },
            "zones": [_zone_box(zone, some) for zone, some in by_zone.items() if zone != BEYOND],
        },
    }  # fmt: skip
    return {"data": data, "layout": layout}


def draw_site(contents: Contents, zones: Mapping[str, int], stage: Stage) -> tuple[list[Trace], list[Trace]]:
    """Return traces of each zone: the nearby ground that its cameras see, and the cameras."""
    by_zone, reach = _group_by_zone(contents, zones), min(WEDGE_SHARE * stage.reach, REACH_M)
    return [_views(zone, some, reach) for zone, some in by_zone.items()], _cameras(by_zone, 0.3 * reach)


def site_in_space(contents: Contents, fit: Fitted, zones: Mapping[str, int]) -> Figure:
    """Draw the cameras of a site in space, one colour per zone; `layout.meta.views` lists the views."""
    stage = stage_of(contents.rig, fit.ways.xy)
    size = stage.high - stage.low
    depth = min(0.16 * stage.reach, SPREAD_M)
    data = [_frusta(zone, some, depth) for zone, some in _group_by_zone(contents, zones).items()]
    unit = 1.6 / float(size.max())
    ratio = {name: round(max(float(size[k]) * unit, 0.05), 4) for k, name in enumerate("xyz")}
    axes = {
        f"{name}axis": {
            "range": [round(float(stage.low[k]), 3), round(float(stage.high[k]), 3)], "title": {"text": f"{name}, m"},
            "showspikes": False, "zeroline": False, "nticks": 3 if name == "z" else 8,
        }
        for k, name in enumerate("xyz")
    }  # fmt: skip
    views = [
        {"label": label, "camera": {"eye": dict(zip("xyz", eye, strict=True)), "up": {"x": 0, "y": 0, "z": 1}}}
        for label, eye in (("Oblique", (0.5, -1.2, 0.8)), ("From above", (0.0, -0.01, 2.0)), ("Along x", (-1.6, 0.0, 0.2)),
                           ("Along y", (0.0, -1.6, 0.2)))
    ]  # fmt: skip
    scene = {**axes, "aspectmode": "manual", "aspectratio": ratio, "camera": views[0]["camera"], "dragmode": "orbit"}
    legend = {"itemsizing": "constant", "orientation": "h", "y": 0, "yanchor": "bottom"}
    return {
        "data": data,
        "layout": {"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "legend": legend, "meta": {"views": views}},
    }


Placed = list[tuple[int, Camera]]
"""Cameras, each after its position in the rig."""


def _group_by_zone(contents: Contents, zones: Mapping[str, int]) -> dict[int, Placed]:
    """Group the cameras with poses by zone, ascending."""
    found: dict[int, Placed] = {}
    for place, camera in find_posed_cameras(contents.rig):
        found.setdefault(zones.get(camera.name, BEYOND), []).append((place, camera))
    return dict(sorted(found.items()))


def _spacing(contents: Contents) -> float:
    """Return the median distance between a camera and its nearest neighbour, metres; infinite for a single camera."""
    centres = np.array([camera.centre[:2] for camera in contents.rig.posed()])
    return float(np.median(np.asarray(cKDTree(centres).query(centres, k=2)[0])[:, 1]))


def _title(zone: int) -> str:
    return f"zone {zone}" if zone != BEYOND else "no zone"


def _colour(zone: int) -> str:
    return zone_colour(zone) if zone != BEYOND else NO_ZONE


def _views(zone: int, cameras: Placed, reach: float) -> Trace:
    """Draw the nearby ground that the cameras of a zone see."""
    x, y = join_stretches([wedge(camera, reach) for _, camera in cameras], 1)
    return {
        "type": "scatter", "mode": "lines", "x": x, "y": y, "fill": "toself", "fillcolor": faint(_colour(zone), 0.1),
        "line": {"color": faint(_colour(zone), 0.5), "width": 1}, "hoverinfo": "skip", "showlegend": False,
        "legendgroup": _title(zone), "name": _title(zone),
    }  # fmt: skip


def _cameras(by_zone: Mapping[int, Placed], stroke: float) -> list[Trace]:
    """Draw the cameras of each zone as marks with strokes of a length in metres along their viewing directions."""
    out = []
    for zone, cameras in by_zone.items():
        common = {"legendgroup": _title(zone), "name": _title(zone)}
        ahead = [_find_heading(camera, stroke) for _, camera in cameras]
        x, y = join_stretches(ahead, 2)
        out.append({
            "type": "scatter", "mode": "lines", "x": x, "y": y, "line": {"color": _colour(zone), "width": 2},
            "hoverinfo": "skip", "showlegend": False, **common,
        })  # fmt: skip
        out.append({
            "type": "scatter", "mode": "markers", "x": [round(float(camera.centre[0]), 2) for _, camera in cameras],
            "y": [round(float(camera.centre[1]), 2) for _, camera in cameras], "customdata": [place for place, _ in cameras],
            "marker": {"color": _colour(zone), "size": 7, "symbol": "square"}, "hoverinfo": "text",
            "hovertext": [f"{hover_words(camera)}<br>{_title(zone)}" for _, camera in cameras], "showlegend": True, **common,
        })  # fmt: skip
    return out


def _find_heading(camera: Camera, length: float) -> Floats:
    """Return the ends (2, 2) of a stroke from a camera along its horizontal viewing direction, metres."""
    assert camera.pose is not None
    towards = camera.pose.R_cw[2, :2]
    return np.stack([camera.centre[:2], camera.centre[:2] + length * towards / max(float(np.hypot(*towards)), 1e-9)])


def _links(contents: Contents, links: Sequence[Link]) -> list[Trace]:
    """Draw lines between the cameras of used pairs, one trace for each word of confidence."""
    at = {camera.name: camera.centre[:2] for _, camera in find_posed_cameras(contents.rig)}
    out = []
    for word, colour, shown in LINKS:
        lines = [
            np.stack([at[one.first], at[one.second]])
            for one in links
            if one.word == word and {one.first, one.second} <= at.keys()
        ]
        if lines:
            x, y = join_stretches(lines, 1)
            out.append({
                "type": "scatter", "mode": "lines", "x": x, "y": y, "line": {"color": colour, "width": 1.5},
                "hoverinfo": "skip", "name": f"{word} pairs", "visible": True if shown else "legendonly",
            })  # fmt: skip
    return out


def _mark_problems(contents: Contents, marked: Mapping[str, str]) -> list[Trace]:
    """Draw rings around cameras with problems."""
    some = [(camera, marked[camera.name]) for _, camera in find_posed_cameras(contents.rig) if camera.name in marked]
    if not some:
        return []
    return [{
        "type": "scatter", "mode": "markers", "x": [round(float(camera.centre[0]), 2) for camera, _ in some],
        "y": [round(float(camera.centre[1]), 2) for camera, _ in some], "hoverinfo": "skip",
        "marker": {"color": MARKED, "size": 15, "symbol": "circle-open", "line": {"width": 2}},
        "name": "problem, or stands out",
    }]  # fmt: skip


def _zone_box(zone: int, cameras: Placed) -> dict[str, Any]:
    """Return a zone's number, median position, lowest and highest x and y, metres, and colour."""
    at = np.array([camera.centre[:2] for _, camera in cameras])
    low, high = at.min(axis=0) - REACH_M / 2, at.max(axis=0) + REACH_M / 2
    return {
        "zone": zone, "at": np.round(np.median(at, axis=0), 2), "x": np.round([low[0], high[0]], 2),
        "y": np.round([low[1], high[1]], 2), "colour": _colour(zone),
    }  # fmt: skip


def _frusta(zone: int, cameras: Placed, depth: float) -> Trace:
    """Draw the frusta of a zone's cameras as one trace."""
    strokes, words = [], list[str]()
    for number, (_, camera) in enumerate(cameras):
        border = frustum(camera, depth)
        corners = border[:: max(1, len(border) // CORNERS)][:CORNERS]
        top = camera.centre[None]
        points = [top] if not len(corners) else [np.concatenate([top, corner[None]]) for corner in corners]
        line = np.concatenate([*points, corners, corners[:1]]) if len(corners) else top
        strokes.append(line)
        words += [*([""] if number else []), *([hover_words(camera)] * len(line))]
    x, y, z = join_stretches(strokes, 2)
    return {
        "type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, "line": {"color": _colour(zone), "width": 2},
        "hoverinfo": "text", "hovertext": words, "name": _title(zone), "showlegend": True,
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class PlanDrawing:
    """The floor plan with the rig drawn on it."""

    plot: Plot
    caption: str


def plan_drawing(
    contents: Contents, fit: Fitted, zones: Mapping[str, int] | None = None, parts: Parts | None = None
) -> PlanDrawing | None:
    """Draw the plan with the rig, with a caption; None if no plan defines the world frame, or no camera has a pose.

    Args:
        contents: of the report.
        fit: of the whole sample.
        zones: of a site's cameras, which are drawn as few traces for any number; None for a rig.
        parts: of a site's page; receives the figure.
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
    return PlanDrawing(plot("rig-plan", _figure(layers, stage, background), told, parts=parts), f"{told}{note}")


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
    """Return the plan's picture as plotly's background image, or None and a note that it is missing."""
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
    """Draw the trajectories of all people, one colour per person."""
    ways, every = fit.ways, max(1, -(-len(fit.ways) // MOST_PLACES))
    out = list[Trace]()
    for identity in np.unique(ways.identity).tolist():
        own = np.flatnonzero(ways.identity == identity)
        parts = [ways.xy[own[ways.part[own] == part]][::every] for part in np.unique(ways.part[own])]
        x, y = join_stretches(parts)
        out.append({
            "type": "scatter", "mode": "lines", "x": x, "y": y, "line": {"color": person_colour(identity), "width": 1},
            "opacity": 0.7, "hoverinfo": "skip", "showlegend": not out, "name": "people", "legendgroup": "people",
        })  # fmt: skip
    return out


def _draw_residuals(residuals: tuple[ResidualEntry, ...], plan: PlanEntry) -> list[Trace]:
    """Draw a cross at each stated placement and a line to its position by the rig; placements left out are red."""
    out = list[Trace]()
    for used, colour, name in ((True, GOOD, "placed on the plan"), (False, WRONG, "left out")):
        some = [row for row in residuals if row.used == used and row.stated_m is not None]
        if not some:
            continue
        lines = [np.array([row.stated_m, row.found_m or row.stated_m]) for row in some]
        x, y = join_stretches(lines, 3)
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
