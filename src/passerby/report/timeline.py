"""Timeline of observations, and when: bars, or how many at once where there are too many bars to tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.colours import person_colour
from passerby.report.contents import Contents
from passerby.report.html import Html, Section, element, join, nothing, plot, plot_text
from passerby.report.parts import Parts
from passerby.report.seen import Spells, lanes_of, merge_spells
from passerby.report.site import EMBEDDED_CAMERAS
from passerby.report.values import count

MOST_BARS = 1500
"""Distinguishable at a laptop's width; of more, the number of people at once is drawn, and the bars of one person who is
chosen."""
MOST_LANES = 14
"""People at once in one camera whose bars can be distinguished."""
MOST_KEPT = 20_000
"""Stretches in the page at most, 60 bytes each."""
BINS = 400
LANE_PX, ROW_PX = 7, 26
HIGHEST_PX, LEAST_ROW_PX = 1500, 3
"""Of more rows than fit into this height, each is lower, to the least; names stand at some."""
NAME_PX = 13
"""Between names."""
MINUTES_FROM_S = 900.0
TITLE = "Timeline of observations"


def timeline_section(contents: Contents, spells: Spells, parts: Parts | None = None) -> Section:
    """A row for each camera, a bar for each stretch in which it saw a person.

    Args:
        contents: of the report.
        spells: of all cameras.
        parts: of a page of many cameras: gets the figure.
    """
    if not len(spells):
        return Section("timeline", TITLE, "", nothing("There are no tracks with identities."), "Timeline")
    kept = merge_spells(spells, MOST_KEPT)
    rows = _rows(len(contents.rig), kept)
    if rows.crowded:
        lead = (
            "One row per camera. A stronger colour means more people at the same time. Select a person to see their trajectory."
        )
    else:
        lead = "One row per camera, and one bar for each interval in which it saw a person. The same colour is the same person."
    lead += " A camera whose marks never overlap in time with those of another camera shares no observations with it."
    label = f"Timeline of {count(len(kept.people), 'person', 'people')} in {count(len(contents.rig), 'camera')}"
    figure = _figure(contents, kept, rows)
    body = join(_chooser(kept.people.tolist()), plot("timeline-plot", figure, label, parts=parts), _merged_note(spells, kept))
    return Section("timeline", TITLE, lead, body, "Timeline")


def _chooser(people: Sequence[int]) -> Html:
    """A list from which one person is chosen."""
    options = [element("option", "everybody", value=""), *(element("option", f"person {one}", value=one) for one in people)]
    return element("p", element("label", "Show ", element("select", options, id="timeline-person")), class_="tools")


def _merged_note(spells: Spells, kept: Spells) -> Html | None:
    """That short breaks were closed, where they were."""
    if len(kept) == len(spells):
        return None
    told = f"{len(spells)} intervals are drawn as {len(kept)}: the shortest gaps between them are closed."
    return element("p", told, class_="note")


@dataclass(frozen=True, eq=False)
class _Rows:
    """Where the bars stand, pixels from above."""

    centre: Floats
    """(N,) of each bar."""
    width: Floats
    """(N,) of each bar."""
    heights: Floats
    """(C,) of the cameras' rows."""
    crowded: bool
    """Whether the bars are too many to tell apart."""


def _rows(n_cameras: int, spells: Spells) -> _Rows:
    """A row for each camera, with lanes in which no two bars overlap; one lane where they are too many."""
    lane, lanes = np.zeros(len(spells)), np.ones(n_cameras)
    for camera in range(n_cameras):
        own = np.flatnonzero(spells.camera == camera)
        if len(own):
            lane[own] = lanes_of(spells.begin[own], spells.end[own])
            lanes[camera] = lane[own].max() + 1
    if len(spells) > MOST_BARS or lanes.max() > MOST_LANES or n_cameras > EMBEDDED_CAMERAS:
        row = min(ROW_PX, max(LEAST_ROW_PX, HIGHEST_PX // n_cameras))
        heights = np.full(n_cameras, float(row))
        centre = np.asarray(row * (spells.camera + 0.5), dtype=np.float64)
        return _Rows(centre, np.full(len(spells), 0.5 * row), heights, True)
    heights = np.asarray(8.0 + LANE_PX * np.maximum(lanes, 2), dtype=np.float64)
    top = np.concatenate([[0.0], np.cumsum(heights)[:-1]])
    return _Rows(top[spells.camera] + 4 + LANE_PX * (lane + 0.5), np.full(len(spells), 0.85 * LANE_PX), heights, False)


def _figure(contents: Contents, spells: Spells, rows: _Rows) -> dict[str, Any]:
    """All bars are in `layout.meta.bars`, from which the page's script draws everybody's or one person's."""
    begin, end = spells.span
    minutes = spells.in_seconds and end - begin > MINUTES_FROM_S
    factor, unit = (60.0, "min") if minutes else (1.0, "s" if spells.in_seconds else "frames")
    names = [plot_text(_short(name)) for name in contents.rig.names]
    bars = {
        "type": "bar",
        "orientation": "h",
        "name": "people",
        "hovertemplate": "person %{customdata[0]}, %{customdata[1]}<br>"
        f"%{{customdata[2]:.1f}} to %{{customdata[3]:.1f}} {unit}<extra></extra>",
    }
    edges = np.concatenate([[0.0], np.cumsum(rows.heights)])
    every = max(1, -(-NAME_PX // int(rows.heights.min())))
    layout = {
        "barmode": "overlay",
        "bargap": 0,
        "showlegend": False,
        "height": int(70 + edges[-1]),
        "hovermode": "closest",
        "margin": {"l": 20, "r": 10, "t": 10, "b": 44},
        "xaxis": {"title": {"text": unit}, "range": [begin / factor, end / factor], "zeroline": False},
        "yaxis": {
            "tickvals": ((edges[1:] + edges[:-1]) / 2)[::every],
            "ticktext": names[::every],
            "range": [float(edges[-1]), 0.0],
            "fixedrange": True,
            "automargin": True,
            "showgrid": False,
            "zeroline": False,
        },
        "shapes": [
            {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": {"width": 1, "color": "var(--line)"}}
            for y in (edges[1:-1] if every == 1 else ())
        ],
        "meta": {"crowded": rows.crowded, "cameras": names, "bars": _bars(spells, rows, factor)},
    }
    data = [_crowd(len(names), spells, edges, factor, unit), bars] if rows.crowded else [bars]
    return {"data": data, "layout": layout}


def _short(name: str) -> str:
    return name if len(name) <= 16 else name[:15] + "…"


def _bars(spells: Spells, rows: _Rows, factor: float) -> dict[str, Any]:
    """Columns of all bars."""
    start, stop = np.round(spells.begin / factor, 3), np.round(spells.end / factor, 3)
    people = spells.people.tolist()
    return {
        "who": spells.identity,
        "camera": spells.camera,
        "begin": start,
        "end": stop,
        "y": np.round(rows.centre, 2),
        "width": float(rows.width[0]),
        "colours": dict(zip(map(str, people), map(person_colour, people), strict=True)),
    }


def _crowd(n_cameras: int, spells: Spells, edges: Floats, factor: float, unit: str) -> dict[str, Any]:
    """How many people each camera saw at once, in the mean over bins of time."""
    times = np.linspace(*spells.span, BINS + 1)
    number = np.zeros((n_cameras, BINS))
    for camera in range(n_cameras):
        own = spells.camera == camera
        seen = _ramps(times, spells.begin[own]) - _ramps(times, spells.end[own])
        number[camera] = np.diff(seen) / np.diff(times)
    return {
        "type": "heatmap",
        "x": np.round(times / factor, 4),
        "y": edges,
        "z": np.round(number, 2) + 0.0,
        "ygap": 3 if edges[1] - edges[0] > NAME_PX else 0,
        "colorscale": [[0, "var(--surface)"], [0.15, "var(--low)"], [1, "var(--high)"]],
        "colorbar": {"title": {"text": "people"}, "thickness": 12, "outlinewidth": 0},
        "hovertemplate": f"%{{x:.1f}} {unit}: %{{z:.1f}} people<extra></extra>",
    }


def _ramps(times: Floats, starts: Floats) -> Floats:
    """(T,) the sum of how long ago each start is, of those that have been."""
    starts = np.sort(starts)
    before = np.searchsorted(starts, times)
    return np.asarray(before * times - np.concatenate([[0.0], np.cumsum(starts)])[before])
