"""Heights of the people, and what tells how long a metre is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from passerby.core.colours import person_colour
from passerby.core.figures import CueFigures, StarFigures, StarScale, heights_of
from passerby.report.contents import Contents
from passerby.report.html import Html, Section, element, join, nothing, plot
from passerby.report.parts import Parts
from passerby.report.tables import Column, data_table, number, text
from passerby.report.values import count
from passerby.solver.cues import cue_in_words


def heights_section(contents: Contents, parts: Parts | None = None) -> Section:
    """The people's heights beside what was assumed of them; `parts` of a page of many cameras gets the figure."""
    lead = (
        "Each dot is a person, shortest first. The band is the assumed height of people: the mean and one standard deviation. "
        "Heights far outside the band usually come from false detections, or from tracks of more than one person."
    )
    heights = heights_of(contents.figures)
    if not heights:
        why = "The solver estimates no heights"
        if contents.document.method == "geopose":
            why += ': the method "geopose" assumes that all people are equally tall'
        return Section("heights", "Heights of the people", lead, nothing(f"{why}."), "Heights")
    prior = contents.document.scene.scale
    mean, sd = prior.person_height_m, prior.person_height_sd_m
    label = (
        f"Heights of {count(len(heights), 'person', 'people')}, {min(heights.values()):.2f} to {max(heights.values()):.2f} m"
    )
    drawn = plot("heights-plot", _figure(heights, mean, sd, _stated(contents)), label, parts=parts)
    body = join(drawn, _in_words(heights, mean, sd))
    return Section("heights", "Heights of the people", lead, body, "Heights")


def _stated(contents: Contents) -> dict[str, tuple[float, float]]:
    """Height and standard deviation of the people whom the scene file tells of."""
    return {str(cue.identity): (cue.stated_m, cue.sd_m) for cue in contents.figures.scale.cues if cue.kind == "person"}


def _figure(
    heights: Mapping[str, float], mean: float | None, sd: float | None, stated: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:
    """A dot for each person, the band behind."""
    order = sorted(heights, key=lambda who: (heights[who], who))
    places = {who: place for place, who in enumerate(order, start=1)}
    told = [who for who in order if who in stated]
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": "measured",
            "x": list(places.values()),
            "y": [round(heights[who], 4) for who in order],
            "marker": {"size": 9, "color": [person_colour(int(who)) if who.isdecimal() else "var(--accent)" for who in order]},
            "text": [f"person {who}" if who.isdecimal() else "person" for who in order],
            "hovertemplate": "%{text}: %{y:.2f} m<extra></extra>",
        }
    ]
    if told:
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": "stated",
                "x": [places[who] for who in told],
                "y": [stated[who][0] for who in told],
                "error_y": {"type": "data", "array": [stated[who][1] for who in told], "color": "var(--ink)"},
                "marker": {"size": 12, "symbol": "diamond-open", "color": "var(--ink)"},
                "hovertemplate": "stated: %{y:.2f} m<extra></extra>",
            }
        )
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
        "height": 300,
        "showlegend": bool(told),
        "margin": {"l": 52, "r": 10, "t": 10, "b": 40},
        "hovermode": "closest",
        "shapes": shapes,
        "xaxis": {
            "title": {"text": "people, by height"},
            "showticklabels": False,
            "range": [0.2, len(order) + 0.8],
            "zeroline": False,
            "showgrid": False,
        },
        "yaxis": {"title": {"text": "m"}, "range": _range(list(heights.values()), mean, sd), "zeroline": False},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
    }
    return {"data": data, "layout": layout}


def _range(heights: list[float], mean: float | None, sd: float | None) -> list[float]:
    """Of the axis: all heights and the band."""
    known = [*heights, *([mean - 1.3 * (sd or 0), mean + 1.3 * (sd or 0)] if mean is not None else [])]
    return [min(known) - 0.05, max(known) + 0.05]


def _in_words(heights: Mapping[str, float], mean: float | None, sd: float | None) -> Html:
    """Mean and spread, and how many are outside two standard deviations."""
    values = np.array(list(heights.values()))
    spread = f", standard deviation {values.std(ddof=1):.2f} m" if len(values) > 1 else ""
    told = f"Measured: {count(len(values), 'person', 'people')}, mean {values.mean():.2f} m{spread}."
    if mean is not None and sd:
        far = int(np.count_nonzero(np.abs(values - mean) > 2 * sd))
        told += (
            f" Assumed: {mean:.2f} ± {sd:.2f} m; {count(far, 'person is', 'people are')} more than two standard deviations "
            f"away."
        )
    return element("p", told, class_="note")


def scale_section(contents: Contents) -> Section:
    """The scale cues, what each says and how much it counts."""
    lead = (
        "The constraints that determine the scale. The weight is a constraint's share in the estimate. Alone is by how much "
        "all lengths would change if it were the only one. If two contradict each other, measure both again."
    )
    cues, figures = contents.figures.scale.cues, contents.document.figures
    if cues:
        body = _cue_table(cues)
    elif isinstance(figures, StarFigures):
        body = element("p", _geopose_scale(figures.scale))
    else:
        body = nothing("There is no rig, so nothing was measured: the scale was not determined.")
    return Section("scale", "Scale constraints", lead, body, "Scale")


def _geopose_scale(scale: StarScale) -> str:
    """The scale of the method "geopose", in words."""
    told = f"The scale comes from one constraint: {scale.from_}"
    told += f", {scale.height_m:.2f} m for everybody" if scale.height_m is not None else ""
    return told + (f", from {count(scale.people, 'person', 'people')}." if scale.people is not None else ".")


def _cue_table(cues: Sequence[CueFigures]) -> Html:
    """A row for each cue, its weight as a bar."""
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
        percent, off = 100 * cue.share, cue.residual_sigmas
        bar = element("span", class_="pull", style=f"width:{min(max(percent, 0.0), 100.0):.1f}%", aria_hidden="true")
        pull = number(percent, 1)
        rows.append(
            [
                text(cue_in_words(cue)),
                number(cue.stated_m, 3),
                number(cue.measured_m, 3),
                number(cue.sd_m, 3),
                number(off, 1, kind="stands-out" if abs(off) > 3 else "", sign=True),
                type(pull)(join(element("span", bar, class_="pull-box"), pull.shown), percent, "pull-cell", numeric=True),
                number(None if cue.own_scale is None else 100 * (cue.own_scale - 1), 1, sign=True),
                number(None if cue.own_sigma is None else 100 * cue.own_sigma, 1),
                text(", ".join(cue.disagrees_with or ()), kind="stands-out" if cue.disagrees_with else ""),
            ]
        )
    return data_table("scale-table", "Scale constraints", columns, rows)
