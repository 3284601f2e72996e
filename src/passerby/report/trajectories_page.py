"""Trajectories of people as a page that opens without a network: from above, and in space, with the cameras. Drawn by
plotly.
"""

from __future__ import annotations

from html import escape

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.colours import person_colour
from passerby.core.trajectories import Trajectories
from passerby.interchange.formats.drawing import Way, ways_of
from passerby.report.rig_geometry import joined, stage_of
from passerby.report.rig_plots import Trace, draw_cameras_from_above, draw_cameras_in_space, draw_ground_seen

MOST_PLACES = 24_000
"""Drawn of all people together; of more every n-th. In each of two views a place takes 70 bytes, plotly's own code 4.7 MB."""
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
    from plotly.subplots import make_subplots

    stage, people = stage_of(rig, found.xyz[:, :2]), ways_of(found)
    every = max(1, -(-len(found) // MOST_PLACES))
    figure = make_subplots(
        rows=1, cols=2, column_widths=[0.5, 0.5], horizontal_spacing=0.03, specs=[[{"type": "xy"}, {"type": "scene"}]],
        subplot_titles=("From above", "In 3D: the body centre"),
    )  # fmt: skip
    flat = [trace for n, way in enumerate(people) for trace in _draw_way(way, every, listed=n < LEGEND)]
    solid = [trace for way in people for trace in _draw_way(way, every, listed=False, in_space=True)]
    figure.add_traces([*draw_cameras_in_space(rig, stage), *solid], rows=1, cols=2)
    figure.add_traces([*draw_ground_seen(rig, stage), *flat, *draw_cameras_from_above(rig, stage)], rows=1, cols=1)
    metres = {"title": {"text": "x, m"}, "zeroline": False}
    figure.update_xaxes(**metres)
    figure.update_yaxes(title={"text": "y, m"}, scaleanchor="x", scaleratio=1, zeroline=False)
    figure.update_scenes(
        aspectmode="data", camera={"eye": {"x": 1.1, "y": -2.0, "z": 1.5}}, xaxis={"title": {"text": "x, m"}},
        yaxis={"title": {"text": "y, m"}}, zaxis={"title": {"text": "z, m"}, "range": [stage.low[2], 1.4 * stage.high[2]]},
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


def _draw_way(way: Way, every: int, *, listed: bool, in_space: bool = False) -> list[Trace]:
    """A person's line, broken between parts; of each part every n-th place, and its ends."""
    rows = [np.union1d(np.arange(part.start, part.stop, every), [part.stop - 1]) for part in way.parts]
    x, y, z = joined([way.xyz[part] for part in rows])
    told = joined([np.column_stack([way.time_s, way.sigma_m, way.cameras])[part] for part in rows])
    hover = (
        f"person {way.identity}<br>%{{customdata[0]:.2f}} s<br>%{{x:.2f}}, %{{y:.2f}} m<br>sigma %{{customdata[1]:.2f}} m, "
        "%{customdata[2]} cameras<extra></extra>"
    )
    colour = person_colour(way.identity)
    common = {
        "mode": "lines", "name": f"person {way.identity}", "legendgroup": f"person {way.identity}", "showlegend": listed,
        "customdata": list(zip(*told, strict=True)), "hovertemplate": hover, "x": x, "y": y,
    }  # fmt: skip
    if in_space:
        return [{"type": "scatter3d", "z": z, "line": {"color": colour, "width": 3}, **common}]
    return [{"type": "scatter", "line": {"color": colour, "width": 2}, **common}]


def _ordinal(number: int) -> str:
    """2nd, 3rd, 4th, 11th, 21st."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
