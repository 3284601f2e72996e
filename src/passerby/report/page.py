"""The report as HTML. It needs no network and contains no dates: the same calibration gives the same bytes."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np
from markupsafe import Markup

from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.colours import person_colour
from passerby.core.trajectories import Trajectories
from passerby.interchange.formats.drawing import Way, ways_of
from passerby.interchange.output_folder import remove_report_parts
from passerby.interchange.storage.atomic import write_text
from passerby.report.camera_table import camera_section, lens_section, weak_cameras
from passerby.report.contents import Contents
from passerby.report.distances import distances_section, site_distances_section
from passerby.report.fitted import Fitted, fit_people
from passerby.report.headline import headline_section, scene_name
from passerby.report.parts import Parts, parts_beside
from passerby.report.people import heights_section, scale_section, timeline_section
from passerby.report.pictures import pictures_section, rig_section
from passerby.report.rendering import Section, plot, render, section
from passerby.report.rig_geometry import join_stretches, stage_of
from passerby.report.rig_plots import Trace, draw_cameras_from_above, draw_cameras_in_space, draw_ground_seen
from passerby.report.seen import find_seen, is_site, zones_of
from passerby.report.site_map import plan_drawing, site_in_space, site_map
from passerby.report.site_views import problems_by_camera, site_camera_section, site_views_section
from passerby.report.tables import count
from passerby.report.view_graph import Link, links_of, site_graph_section, view_graph_section
from passerby.report.workings import files_section, settings_section, stages_section

MOST_PLACES = 24_000
"""Most positions of all people that are drawn; of more, every n-th is drawn. A position takes 70 bytes in each of two views,
plotly's own code 4.7 MB."""
LEGEND = 60
"""Most people in the legend; more would cover the page. All people are drawn."""


def report_page(contents: Contents, progress: Progress | None = None) -> str:
    """Return the page as HTML in one file, for any number of cameras. The same contents give the same page.

    Args:
        contents: of a calibration, or of an output folder.
        progress: called with "report" for each camera whose picture is drawn.
    """
    tell = progress or silent
    seen, fit = find_seen(contents), fit_people(contents)
    sections = [
        headline_section(contents, seen),
        camera_section(contents, seen),
        lens_section(contents),
        rig_section(contents, fit),
        pictures_section(contents, fit, seen, tell),
        view_graph_section(contents, seen),
        timeline_section(contents, seen.spells),
        heights_section(contents),
        scale_section(contents),
        distances_section(contents),
        stages_section(contents, seen),
        settings_section(contents),
        files_section(contents),
    ]
    return html_document(contents, sections)


def write_report(contents: Contents, path: Path, progress: Progress | None = None) -> None:
    """Write the page atomically, after the files beside it for a site. Raises `InputError` if a file cannot be written."""
    if is_site(contents):
        with parts_beside(path) as parts:
            write_text(path, site_page(contents, parts, progress or silent))
            remove_report_parts(path, but=parts.stamp)
    else:
        write_text(path, report_page(contents, progress))
        remove_report_parts(path)


def site_page(contents: Contents, parts: Parts, tell: Progress) -> str:
    """Return the page of a site as HTML and write the files that it loads later. The same contents give the same bytes.

    Args:
        contents: of a calibration, or of an output folder.
        parts: receives the files, and is moved to its final folder.
        tell: called with "report" for each camera whose picture is drawn.

    Raises:
        OSError: a file cannot be written.
    """
    seen, fit, zones = find_seen(contents), fit_people(contents), zones_of(contents)
    links, told = links_of(contents, seen), problems_by_camera(contents)
    sections = [
        headline_section(contents, seen),
        site_camera_section(contents, seen, zones),
        site_rig_section(contents, fit, zones, links, parts),
        site_views_section(contents, fit, seen, links, told, parts, tell),
        site_graph_section(contents, links),
        timeline_section(contents, seen.spells, parts),
        lens_section(contents),
        heights_section(contents, parts),
        scale_section(contents),
        site_distances_section(contents),
        stages_section(contents, seen),
        settings_section(contents),
        files_section(contents, several=True),
    ]
    return html_document(contents, sections, parts)


def site_rig_section(contents: Contents, fit: Fitted, zones: dict[str, int], links: list[Link], parts: Parts) -> Section:
    """Return the section with the map of the site and its view in space."""
    posed = contents.rig.posed()
    marked = dict.fromkeys(problems_by_camera(contents), "problem")
    for names in weak_cameras(contents).values():
        marked |= dict.fromkeys(names, "stands out")
    who = f"{count(len(posed), 'camera')} in {count(len(set(zones.values())), 'zone')}"
    drawn = []
    if len(posed):
        map_, space = site_map(contents, fit, zones, links, marked), site_in_space(contents, fit, zones)
        drawn.append(plot("rig-above", map_, f"Map of {who}", kind="map", parts=parts))
        drawn.append(plot("rig-space", space, f"{who} in space", kind="space", parts=parts))
    return section("rig", "Map", site=True, plan=plan_drawing(contents, fit, zones, parts), plots=drawn)


def html_document(contents: Contents, sections: Sequence[Section | None], parts: Parts | None = None) -> str:
    """Return the page from its head, navigation bar, sections and scripts.

    Args:
        contents: of the report.
        sections: in their order; None for a section without content.
        parts: files that the page loads when it needs them. Plotly's code becomes such a file too, because it takes a third of
            a second before anything is visible. They are moved to their final folder. None: the page is one file.

    Raises:
        OSError: the files cannot be moved to their final folder.
    """
    from plotly.offline import get_plotlyjs

    scripts = [get_plotlyjs(), _asset("page.js")]
    if parts is not None:
        parts.add_script("plotly", scripts[0])
        scripts = [_asset("page.js"), _asset("site.js")]
    page = render(
        "page.html", parts=None if parts is None else parts.place(), policy=_policy(scripts, parts is not None),
        scene=scene_name(contents), verdict=contents.verdict, style=Markup(_asset("page.css")),
        sections=[section for section in sections if section is not None], version=contents.document.passerby or "",
        scripts=[Markup(script) for script in scripts],
    )  # fmt: skip
    return f"{page}\n"


def _policy(scripts: list[str], load: bool) -> str:
    """Return the content security policy: it allows these scripts by their hashes, and styles and pictures in the page only.

    Args:
        scripts: of the page.
        load: whether they may load other scripts. The policy names no address for these, as the page may be in any folder.
    """
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    allowed = " ".join(f"'sha256-{one}'" for one in hashes) + (" 'strict-dynamic'" if load else "")
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
        "connect-src 'none'; form-action 'none'; base-uri 'none'"
    )


def _asset(name: str) -> str:
    """Read a file of this package as text."""
    return resources.files("passerby.report").joinpath(name).read_text(encoding="utf-8")


def trajectories_page(found: Trajectories, rig: Rig, title: str, note: str = "") -> str:
    """Return a page of HTML with trajectories and cameras, from above and in 3D. The same input gives the same page.

    Args:
        found: the trajectories.
        rig: the cameras; those without a pose are left out.
        title: of the page.
        note: a sentence below the title.
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
    drawn = figure.to_html(
        full_html=False, include_plotlyjs=True, div_id="trajectories", default_height="82vh", config={"displaylogo": False}
    )
    page = render("trajectories.html", title=title, note=note, every=every, ordinal=_ordinal(every), figure=Markup(drawn))
    return f"{page}\n"


def _draw_way(way: Way, every: int, *, listed: bool, in_space: bool = False) -> list[Trace]:
    """Return a person's trajectory as a line with gaps between stretches: every n-th position of each stretch, and its ends."""
    rows = [np.union1d(np.arange(part.start, part.stop, every), [part.stop - 1]) for part in way.parts]
    x, y, z = join_stretches([way.xyz[part] for part in rows])
    told = join_stretches([np.column_stack([way.time_s, way.sigma_m, way.cameras])[part] for part in rows])
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
    """Write an ordinal number: 2nd, 3rd, 4th, 11th, 21st."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
