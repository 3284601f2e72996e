"""Sections about people: their heights, the evidence that determines the scale, and the timeline of observations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.colours import person_colour
from passerby.core.figures import CueFigures, StarFigures, StarScale, heights_of
from passerby.report.contents import Contents
from passerby.report.parts import Parts
from passerby.report.rendering import Section, plot, plot_text, section
from passerby.report.seen import EMBEDDED_CAMERAS, Spells, lanes_of, merge_spells
from passerby.report.tables import Column, Table, count, number, share_cell, text
from passerby.solver.cues import cue_in_words

MOST_BARS = 1500
"""Most bars that are distinguishable at a laptop's width. If there are more, the page draws the number of people at a time, and
the bars of one person whom the reader chooses."""
MOST_LANES = 14
"""Most people at a time in one camera whose bars are distinguishable."""
MOST_KEPT = 20_000
"""Most stretches in the page, 60 bytes each."""
BINS = 400
LANE_PX, ROW_PX = 7, 26
HIGHEST_PX, LEAST_ROW_PX = 1500, 3
"""Largest total height of the rows and least height of a row: rows that do not fit are made lower, with names at only some."""
NAME_PX = 13
"""Least distance between names."""
MINUTES_FROM_S = 900.0


def heights_section(contents: Contents, parts: Parts | None = None) -> Section:
    """Return the section with the people's estimated and assumed heights; `parts` of a page of many cameras gets the figure."""
    heights = heights_of(contents.figures)
    if not heights:
        return section("heights", "Heights", drawn=None, method=contents.document.method)
    prior = contents.document.scene.scale
    mean, sd = prior.person_height_m, prior.person_height_sd_m
    label = (
        f"Heights of {count(len(heights), 'person', 'people')}, {min(heights.values()):.2f} to {max(heights.values()):.2f} m"
    )
    drawn = plot("heights-plot", _figure(heights, mean, sd, _read_stated_heights(contents)), label, parts=parts)
    return section("heights", "Heights", drawn=drawn, words=_describe_heights(heights, mean, sd))


def _read_stated_heights(contents: Contents) -> dict[str, tuple[float, float]]:
    """Return height and standard deviation, metres, of the people whose heights the scene file states, by identity."""
    return {str(cue.identity): (cue.stated_m, cue.sd_m) for cue in contents.figures.scale.cues if cue.kind == "person"}


def _figure(
    heights: Mapping[str, float], mean: float | None, sd: float | None, stated: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:
    """Draw a dot for each person, with the assumed heights as a band behind the dots."""
    order = sorted(heights, key=lambda who: (heights[who], who))
    places = {who: place for place, who in enumerate(order, start=1)}
    told = [who for who in order if who in stated]
    data: list[dict[str, Any]] = [{
        "type": "scatter", "mode": "markers", "name": "measured", "x": list(places.values()),
        "y": [round(heights[who], 4) for who in order],
        "marker": {"size": 9, "color": [person_colour(int(who)) if who.isdecimal() else "var(--accent)" for who in order]},
        "text": [f"person {who}" if who.isdecimal() else "person" for who in order],
        "hovertemplate": "%{text}: %{y:.2f} m<extra></extra>",
    }]  # fmt: skip
    if told:
        data.append({
            "type": "scatter", "mode": "markers", "name": "stated", "x": [places[who] for who in told],
            "y": [stated[who][0] for who in told],
            "error_y": {"type": "data", "array": [stated[who][1] for who in told], "color": "var(--ink)"},
            "marker": {"size": 12, "symbol": "diamond-open", "color": "var(--ink)"},
            "hovertemplate": "stated: %{y:.2f} m<extra></extra>",
        })  # fmt: skip
    shapes: list[dict[str, Any]] = []
    if mean is not None:
        across = {"xref": "paper", "x0": 0, "x1": 1, "layer": "below"}
        if sd is not None:
            shapes.append(
                {"type": "rect", **across, "y0": mean - sd, "y1": mean + sd, "fillcolor": "var(--band)", "line": {"width": 0}}
            )
        shapes.append(
            {"type": "line", **across, "y0": mean, "y1": mean, "line": {"width": 1.5, "dash": "dot", "color": "var(--muted)"}}
        )
    layout = {
        "height": 300, "showlegend": bool(told), "margin": {"l": 52, "r": 10, "t": 10, "b": 40}, "hovermode": "closest",
        "shapes": shapes,
        "xaxis": {
            "title": {"text": "people, by height"}, "showticklabels": False, "range": [0.2, len(order) + 0.8],
            "zeroline": False, "showgrid": False,
        },
        "yaxis": {"title": {"text": "m"}, "range": _range(list(heights.values()), mean, sd), "zeroline": False},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def _range(heights: list[float], mean: float | None, sd: float | None) -> list[float]:
    """Return the range of the axis, which contains all heights and the band."""
    known = [*heights, *([mean - 1.3 * (sd or 0), mean + 1.3 * (sd or 0)] if mean is not None else [])]
    return [min(known) - 0.05, max(known) + 0.05]


def _describe_heights(heights: Mapping[str, float], mean: float | None, sd: float | None) -> str:
    """Describe mean and spread of the heights, and the number of people beyond two assumed standard deviations."""
    values = np.array(list(heights.values()))
    spread = f", standard deviation {values.std(ddof=1):.2f} m" if len(values) > 1 else ""
    told = f"Measured: {count(len(values), 'person', 'people')}, mean {values.mean():.2f} m{spread}."
    if mean is not None and sd:
        far = int(np.count_nonzero(np.abs(values - mean) > 2 * sd))
        told += (
            f" Assumed: {mean:.2f} ± {sd:.2f} m; {count(far, 'person is', 'people are')} more than two standard deviations "
            f"away."
        )
    return told


def scale_section(contents: Contents) -> Section:
    """Return the section with the scale cues, their values and their weights."""
    cues, figures = contents.figures.scale.cues, contents.document.figures
    words = _geopose_scale(figures.scale) if isinstance(figures, StarFigures) else ""
    return section("scale", "Scale", table=_cue_table(cues) if cues else None, words=words)


def _geopose_scale(scale: StarScale) -> str:
    """Describe the scale of the method "geopose" in words."""
    told = f"The scale comes from one constraint: {scale.from_}"
    told += f", {scale.height_m:.2f} m for everybody" if scale.height_m is not None else ""
    return told + (f", from {count(scale.people, 'person', 'people')}." if scale.people is not None else ".")


def _cue_table(cues: Sequence[CueFigures]) -> Table:
    """Return a table with a row for each cue, its weight as a bar."""
    columns = [
        Column("Constraint", numeric=False),
        Column("Stated", "m"),
        Column("Measured", "m"),
        Column("1 sigma", "m"),
        Column("Residual", "sigmas"),
        Column("Weight", "%"),
        Column("Alone", "%"),
        Column("1 sigma", "%"),
        Column("Contradicts", numeric=False),
    ]
    rows = []
    for cue in cues:
        off = cue.residual_sigmas
        rows.append(
            [
                text(cue_in_words(cue)),
                number(cue.stated_m, 3),
                number(cue.measured_m, 3),
                number(cue.sd_m, 3),
                number(off, 1, kind="stands-out" if abs(off) > 3 else "", sign=True),
                share_cell(100 * cue.share, 1),
                number(None if cue.own_scale is None else 100 * (cue.own_scale - 1), 1, sign=True),
                number(None if cue.own_sigma is None else 100 * cue.own_sigma, 1),
                text(", ".join(cue.disagrees_with or ()), kind="stands-out" if cue.disagrees_with else ""),
            ]
        )
    return Table(identifier="scale-table", caption="Scale constraints", columns=columns, rows=rows)


def timeline_section(contents: Contents, spells: Spells, parts: Parts | None = None) -> Section:
    """Return the section with the timeline: a row for each camera, with a bar for each stretch in which it saw a person.

    Args:
        contents: of the report.
        spells: of all cameras.
        parts: of a page of many cameras; receives the figure.
    """
    if not len(spells):
        return section("timeline", "Timeline", drawn=None)
    kept = merge_spells(spells, MOST_KEPT)
    rows = _rows(len(contents.rig), kept)
    label = f"Timeline of {count(len(kept.people), 'person', 'people')} in {count(len(contents.rig), 'camera')}"
    drawn = plot("timeline-plot", _draw_figure(contents, kept, rows), label, parts=parts)
    return section(
        "timeline", "Timeline", drawn=drawn, crowded=rows.crowded, people=kept.people.tolist(), spells=len(spells),
        kept=len(kept),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Rows:
    """Vertical positions of the bars, pixels from the top."""

    centre: Floats
    """(N,) centre of each bar."""
    width: Floats
    """(N,) width of each bar."""
    heights: Floats
    """(C,) heights of the cameras' rows."""
    crowded: bool
    """Whether the bars are too many to be distinguished."""


def _rows(n_cameras: int, spells: Spells) -> _Rows:
    """Arrange a row for each camera, with lanes in which no two bars overlap; one lane per row if there are too many."""
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


def _draw_figure(contents: Contents, spells: Spells, rows: _Rows) -> dict[str, Any]:
    """Return the figure of the timeline. The page's script draws the bars of all people or of one from `layout.meta.bars`."""
    begin, end = spells.span
    minutes = spells.in_seconds and end - begin > MINUTES_FROM_S
    factor, unit = (60.0, "min") if minutes else (1.0, "s" if spells.in_seconds else "frames")
    names = [plot_text(_shorten(name)) for name in contents.rig.names]
    bars = {
        "type": "bar", "orientation": "h", "name": "people",
        "hovertemplate": "person %{customdata[0]}, %{customdata[1]}<br>"
        f"%{{customdata[2]:.1f}} to %{{customdata[3]:.1f}} {unit}<extra></extra>",
    }  # fmt: skip
    edges = np.concatenate([[0.0], np.cumsum(rows.heights)])
    every = max(1, -(-NAME_PX // int(rows.heights.min())))
    layout = {
        "barmode": "overlay", "bargap": 0, "showlegend": False, "height": int(70 + edges[-1]), "hovermode": "closest",
        "margin": {"l": 20, "r": 10, "t": 10, "b": 44},
        "xaxis": {"title": {"text": unit}, "range": [begin / factor, end / factor], "zeroline": False},
        "yaxis": {
            "tickvals": ((edges[1:] + edges[:-1]) / 2)[::every], "ticktext": names[::every], "range": [float(edges[-1]), 0.0],
            "fixedrange": True, "automargin": True, "showgrid": False, "zeroline": False,
        },
        "shapes": [
            {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": {"width": 1, "color": "var(--line)"}}
            for y in (edges[1:-1] if every == 1 else ())
        ],
        "meta": {"crowded": rows.crowded, "cameras": names, "bars": _bars(spells, rows, factor)},
    }  # fmt: skip
    data = [_crowd(len(names), spells, edges, factor, unit), bars] if rows.crowded else [bars]
    return {"data": data, "layout": layout}


def _shorten(name: str) -> str:
    return name if len(name) <= 16 else name[:15] + "…"


def _bars(spells: Spells, rows: _Rows, factor: float) -> dict[str, Any]:
    """Return the data of all bars as columns."""
    start, stop = np.round(spells.begin / factor, 3), np.round(spells.end / factor, 3)
    people = spells.people.tolist()
    return {
        "who": spells.identity, "camera": spells.camera, "begin": start, "end": stop, "y": np.round(rows.centre, 2),
        "width": float(rows.width[0]), "colours": dict(zip(map(str, people), map(person_colour, people), strict=True)),
    }  # fmt: skip


def _crowd(n_cameras: int, spells: Spells, edges: Floats, factor: float, unit: str) -> dict[str, Any]:
    """Draw the number of people that each camera saw at a time, as means over bins of time."""
    times = np.linspace(*spells.span, BINS + 1)
    number = np.zeros((n_cameras, BINS))
    for camera in range(n_cameras):
        own = spells.camera == camera
        seen = _ramps(times, spells.begin[own]) - _ramps(times, spells.end[own])
        number[camera] = np.diff(seen) / np.diff(times)
    return {
        "type": "heatmap", "x": np.round(times / factor, 4), "y": edges, "z": np.round(number, 2) + 0.0,
        "ygap": 3 if edges[1] - edges[0] > NAME_PX else 0,
        "colorscale": [[0, "var(--surface)"], [0.15, "var(--low)"], [1, "var(--high)"]],
        "colorbar": {"title": {"text": "people"}, "thickness": 12, "outlinewidth": 0},
        "hovertemplate": f"%{{x:.1f}} {unit}: %{{z:.1f}} people<extra></extra>",
    }  # fmt: skip


def _ramps(times: Floats, starts: Floats) -> Floats:
    """Return, for each of the times (T,), the sum of the times since all earlier starts."""
    starts = np.sort(starts)
    before = np.searchsorted(starts, times)
    return np.asarray(before * times - np.concatenate([[0.0], np.cumsum(starts)])[before])
