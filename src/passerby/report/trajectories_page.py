"""The ways of people as a page that opens without a network: from above, and in space, with the cameras. Drawn by plotly."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.trajectories import Trajectories

MOST_PLACES = 24_000
"""Drawn of all people together; of more every n-th. In each of two views a place takes 70 bytes, plotly's own code 4.7 MB."""
COLOURS = (
    "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22", "#5254a3",
    "#8ca252", "#ad494a", "#a55194", "#6b6ecf", "#b5cf6b", "#e7ba52", "#ce6dbd", "#637939", "#843c39", "#7b4173",
)  # fmt: skip
CAMERA_COLOUR = "#333333"
LOOK_M = 2.0
"""Length of the stroke that tells where a camera looks."""
LEGEND = 60
"""People in the legend at most; more would cover the page. All are drawn."""


def trajectories_page(found: Trajectories, rig: Rig, title: str, note: str = "") -> str:
    """HTML, the same for the same input.

    Args:
        found: the ways.
        rig: their cameras; those without a pose are left out.
        title: of the page.
        note: a sentence below it.
    """
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=1, cols=2, column_widths=[0.5, 0.5], horizontal_spacing=0.03, specs=[[{"type": "xy"}, {"type": "scene"}]],
        subplot_titles=("From above", "In 3D: the body centre"),
    )  # fmt: skip
    _draw_cameras(figure, go, rig)
    every = max(1, -(-len(found) // MOST_PLACES))
    for number, identity in enumerate(found.people.tolist()):
        _draw_person(figure, go, found, int(identity), every, COLOURS[number % len(COLOURS)], number < LEGEND)
    metres = {"title": {"text": "x, m"}, "zeroline": False}
    figure.update_xaxes(**metres)
    figure.update_yaxes(title={"text": "y, m"}, scaleanchor="x", scaleratio=1, zeroline=False)
    figure.update_scenes(
        aspectmode="data", camera={"eye": {"x": 1.1, "y": -2.0, "z": 1.5}}, xaxis={"title": {"text": "x, m"}},
        yaxis={"title": {"text": "y, m"}}, zaxis={"title": {"text": "z, m"}, "rangemode": "tozero"},
    )  # fmt: skip
    figure.update_layout(
        template="plotly_white", margin={"l": 50, "r": 10, "t": 40, "b": 45}, hovermode="closest",
        legend={"itemsizing": "constant"}, autosize=True,
    )  # fmt: skip
    thinned = f" Every {_ordinal(every)} position is drawn." if every > 1 else ""
    body = figure.to_html(
        full_html=False, include_plotlyjs=True, div_id="trajectories", default_height="82vh", config={"displaylogo": False}
    )
    head = f'<meta charset="utf-8"><title>{escape(title)}</title>'
    style = "<style>body{font-family:sans-serif;margin:1em}p{margin:.3em 0;color:#444}h1{font-size:1.3em;margin:0}</style>"
    told = f"<h1>{escape(title)}</h1><p>{escape(note)}{thinned}</p>"
    return f"<!doctype html>\n<html><head>{head}{style}</head><body>{told}{body}</body></html>\n"


def _draw_cameras(figure: Any, go: Any, rig: Rig) -> None:
    """The cameras, and a stroke each along the optical axis."""
    posed = [camera for camera in rig.posed() if camera.pose is not None]
    centre = np.array([camera.centre for camera in posed]).reshape(-1, 3)
    axis = np.array([camera.pose.R_cw[2] for camera in posed if camera.pose is not None]).reshape(-1, 3)
    x, y, z = (_strokes(a, b) for a, b in zip(centre.T, (centre + LOOK_M * axis).T, strict=True))
    names = [camera.name for camera in posed]
    hover = "camera %{text}<br>%{x:.2f}, %{y:.2f}, %{customdata:.2f} m<extra></extra>"
    line = {"color": CAMERA_COLOUR, "width": 2}
    common = {"legendgroup": "cameras", "name": "cameras"}
    strokes = {**common, "mode": "lines", "showlegend": False, "hoverinfo": "skip"}
    figure.add_trace(go.Scatter(x=x, y=y, line=line, **strokes), row=1, col=1)
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, line=line, **strokes), row=1, col=2)
    marks = {**common, "mode": "markers+text", "text": names, "customdata": _short(centre[:, 2]), "hovertemplate": hover}
    place = {"x": _short(centre[:, 0]), "y": _short(centre[:, 1])}
    square = {"symbol": "square", "size": 10, "color": CAMERA_COLOUR}
    figure.add_trace(go.Scatter(**place, marker=square, textposition="top center", **marks), row=1, col=1)
    small = {"symbol": "square", "size": 4, "color": CAMERA_COLOUR}
    figure.add_trace(go.Scatter3d(**place, z=_short(centre[:, 2]), marker=small, showlegend=False, **marks), row=1, col=2)


def _strokes(begin: Floats, end: Floats) -> list[float | None]:
    """Begins and ends, parted by gaps."""
    return [value for a, b in zip(_short(begin), _short(end), strict=True) for value in (a, b, None)]


def _draw_person(figure: Any, go: Any, found: Trajectories, identity: int, every: int, colour: str, listed: bool) -> None:
    """One line a person in both views, broken between parts."""
    rows = _drawn(found, identity, every)
    part = found.part[rows]
    broken = np.flatnonzero(np.diff(part)) + 1
    columns = [found.xyz[rows, 0], found.xyz[rows, 1], found.xyz[rows, 2], found.time_s[rows], found.sigma_m[rows]]
    columns.append(found.cameras[rows].astype(np.float64))
    x, y, z, *rest = (_gapped(column, broken) for column in columns)
    told = [list(row) for row in zip(*rest, strict=True)]
    hover = (
        f"person {identity}<br>%{{customdata[0]:.2f}} s<br>%{{x:.2f}}, %{{y:.2f}} m<br>sigma %{{customdata[1]:.2f}} m, "
        "%{customdata[2]} cameras<extra></extra>"
    )
    line = {"color": colour, "width": 2}
    common = {
        "mode": "lines",
        "name": f"person {identity}",
        "legendgroup": str(identity),
        "customdata": told,
        "hovertemplate": hover,
    }
    figure.add_trace(go.Scatter(x=x, y=y, line=line, showlegend=listed, **common), row=1, col=1)
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, line={**line, "width": 3}, showlegend=False, **common), row=1, col=2)


def _ordinal(number: int) -> str:
    """2nd, 3rd, 4th, 11th, 21st."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def _drawn(found: Trajectories, identity: int, every: int) -> Ints:
    """Rows of a person: every n-th, and the first and the last of each part."""
    rows = np.flatnonzero(found.identity == identity)
    part = found.part[rows]
    ends = np.flatnonzero(np.diff(part, prepend=part[:1] - 1) | np.diff(part, append=part[-1:] + 1))
    return np.asarray(rows[np.union1d(np.arange(0, len(rows), every), ends)], dtype=np.int64)


def _gapped(values: Floats, broken: Ints) -> list[float | None]:
    """Values to the centimetre, nothing where a part ends."""
    return _short(np.insert(values, broken, np.nan))


def _short(values: Sequence[float] | Floats) -> list[float | None]:
    """To two digits; None where there is no number. Adding zero turns -0.0 into 0.0."""
    return [round(value, 2) + 0.0 if np.isfinite(value) else None for value in np.asarray(values, dtype=np.float64).tolist()]
