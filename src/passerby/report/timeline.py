"""Who was seen where, and when."""

from __future__ import annotations

from typing import Any

import numpy as np

from passerby.report.colours import person_colour
from passerby.report.contents import Contents
from passerby.report.html import Html, Section, element, join, nothing, plot, plot_text
from passerby.report.seen import Spells, lanes_of, merged
from passerby.report.values import count

MOST_BARS = 3000
"""Drawn at most: at a laptop's width of 1000 pixels, breaks of a pixel are long closed by then. A bar takes 60 bytes."""
LANE_PX, MOST_LANES = 7, 24
MINUTES_FROM_S = 900.0


def timeline_section(contents: Contents, spells: Spells) -> Section:
    """A row for each camera, a bar for each stretch in which it saw somebody."""
    lead = (
        "A row for each camera, a bar for each stretch in which it saw a person; the same colour is the same person. A camera "
        "whose bars never lie under another's saw nobody at the same time."
    )
    if not len(spells):
        return Section("timeline", "Who was seen where", lead, nothing("No tracks of known people are there."), "Timeline")
    drawn = merged(spells, MOST_BARS)
    people = drawn.people
    figure = _figure(contents, drawn)
    label = f"Timeline of {count(len(people), 'person', 'people')} in {count(len(contents.rig), 'camera')}"
    body = join(_chooser(people.tolist()), plot("timeline-plot", figure, label), _merged_note(spells, drawn))
    return Section("timeline", "Who was seen where", lead, body, "Timeline")


def _chooser(people: list[int]) -> Html:
    """A list from which one person is chosen."""
    options = [element("option", "everybody", value=""), *(element("option", f"person {one}", value=one) for one in people)]
    return element("p", element("label", "Show ", element("select", options, id="timeline-person")), class_="tools")


def _merged_note(spells: Spells, drawn: Spells) -> Html | None:
    """That short breaks were closed, where they were."""
    if len(drawn) == len(spells):
        return None
    return element(
        "p", f"{len(spells)} stretches are drawn as {len(drawn)}: the shortest breaks between them are closed.", class_="note"
    )


def _figure(contents: Contents, spells: Spells) -> dict[str, Any]:
    """A trace for each person."""
    begin, end = spells.span
    minutes = spells.in_seconds and end - begin > MINUTES_FROM_S
    factor = 60.0 if minutes else 1.0
    unit = "min" if minutes else "s" if spells.in_seconds else "frame"
    centre, width, heights = _rows(contents, spells)
    names = [plot_text(name) for name in contents.rig.names]
    traces = []
    for identity in spells.people.tolist():
        own = np.flatnonzero(spells.identity == identity)
        start, stop = np.round(spells.begin[own] / factor, 3), np.round(spells.end[own] / factor, 3)
        told = zip((names[place] for place in spells.camera[own]), start.tolist(), stop.tolist(), strict=True)
        traces.append(
            {
                "type": "bar",
                "orientation": "h",
                "name": f"person {identity}",
                "base": start,
                "x": np.round(stop - start, 3),
                "y": np.round(centre[own], 3),
                "width": np.round(width[own], 3),
                "marker": {"color": person_colour(identity), "line": {"width": 0}},
                "customdata": list(told),
                "hovertemplate": f"person {identity}, %{{customdata[0]}}<br>"
                f"%{{customdata[1]:.1f}} to %{{customdata[2]:.1f}} {unit}<extra></extra>",
            }
        )
    middles = np.cumsum(heights) - heights / 2
    layout = {
        "barmode": "overlay",
        "bargap": 0,
        "showlegend": False,
        "height": int(70 + heights.sum()),
        "hovermode": "closest",
        "margin": {"l": 20, "r": 10, "t": 10, "b": 44},
        "xaxis": {"title": {"text": unit}, "range": [begin / factor, end / factor], "zeroline": False},
        "yaxis": {
            "tickvals": middles,
            "ticktext": [plot_text(_short(name)) for name in contents.rig.names],
            "range": [float(heights.sum()), 0.0],
            "fixedrange": True,
            "automargin": True,
            "showgrid": False,
            "zeroline": False,
        },
        "shapes": [
            {
                "type": "line",
                "xref": "paper",
                "x0": 0,
                "x1": 1,
                "y0": edge,
                "y1": edge,
                "line": {"width": 1, "color": "var(--line)"},
            }
            for edge in np.cumsum(heights)[:-1]
        ],
    }
    return {"data": traces, "layout": layout}


def _short(name: str) -> str:
    return name if len(name) <= 16 else name[:15] + "…"


def _rows(contents: Contents, spells: Spells) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Middle and width of each bar, and the height of each camera's row, pixels."""
    n = len(contents.rig)
    most = max(1, min(MOST_LANES, 60 // n + 3))
    lane, lanes = np.zeros(len(spells)), np.ones(n)
    for camera in range(n):
        own = np.flatnonzero(spells.camera == camera)
        if len(own):
            lane[own] = lanes_of(spells.begin[own], spells.end[own])
            lanes[camera] = lane[own].max() + 1
    heights = 8 + LANE_PX * np.clip(lanes, 2, most)
    top = np.concatenate([[0.0], np.cumsum(heights)[:-1]])
    pitch = (heights - 8) / np.maximum(lanes, 2)
    centre = top[spells.camera] + 4 + pitch[spells.camera] * (lane + 0.5)
    return centre, 0.85 * pitch[spells.camera], heights
