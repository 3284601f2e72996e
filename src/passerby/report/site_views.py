"""The camera that is looked at: its picture and what belongs to it, of each camera in a file of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from passerby.common.progress import Progress
from passerby.report.contents import Contents
from passerby.report.distances import distances_from, distances_table, solved_distances
from passerby.report.fitted import Fitted
from passerby.report.html import Html, Section, element, join
from passerby.report.parts import Parts
from passerby.report.places import VIEWS_LEAD, camera_panel, decoded_backdrops, layer_switches
from passerby.report.recommendations import Reported
from passerby.report.seen import Seen
from passerby.report.site import neighbours_of
from passerby.report.view_graph import Link, pairs_table

MOST_PARTNERS = 24
"""Pairs that are listed with a camera: in one hall each camera may have one with all others."""


def site_views_section(
    contents: Contents, fit: Fitted, seen: Seen, links: Sequence[Link],
    problems: Mapping[str, Sequence[Reported]], parts: Parts, tell: Progress,
) -> Section:  # fmt: skip
    """A field for a camera's name, and the place of its panel; the panels are files.

    Args:
        contents: of the report.
        fit: of the whole sample.
        seen: of all cameras.
        links: all pairs.
        problems: by camera, what is reported about it.
        parts: gets the panels.
        tell: called for each camera.
    """
    near = neighbours_of(contents.rig, seen)
    by_camera: dict[str, list[Link]] = {name: [] for name in contents.rig.names}
    for link in links:
        by_camera[link.first].append(link)
        by_camera[link.second].append(link)
    posed, solved = list(contents.rig.posed()), solved_distances(contents)
    for place, (name, behind) in enumerate(decoded_backdrops(contents, tell)):
        camera = contents.rig[name]
        more = [_problems(problems.get(name, ())), _pairs(contents, by_camera[name])]
        if camera.pose is not None and len(posed) > 1:
            nearest = distances_table("camera-distances", distances_from(camera, posed, solved), copy=False)
            more.append(_folded("Distances to the nearest cameras", nearest))
        panel = camera_panel(contents, fit, seen, place, name, behind, near[name], join(*more))
        parts.add(part_name(place), {"html": panel})
    body = join(_chooser(contents), layer_switches(contents), element("div", id="camera-view", tabindex="-1"))
    return Section("views", "Camera views", f"One camera at a time. {VIEWS_LEAD}", body, "Views")


def part_name(place: int) -> str:
    """The file of the camera with this place in the rig."""
    return f"camera-{place}"


def _chooser(contents: Contents) -> Html:
    """A field for a camera's name, with those that there are, and buttons for the cameras before and after it."""
    names = [element("option", value=name) for name in contents.rig.names]
    field = element("input", id="camera-name", list="camera-names", autocomplete="off", spellcheck="false", size=24)
    return element(
        "div",
        element("label", "Camera ", field),
        element("datalist", names, id="camera-names"),
        element("button", "Previous camera", type="button", class_="quiet", data_step=-1),
        element("button", "Next camera", type="button", class_="quiet", data_step=1),
        element("output", id="camera-note"),
        class_="tools chooser",
    )


def _problems(doubts: Sequence[Reported]) -> Html | None:
    """The problems of the camera."""
    if not doubts:
        return None
    rows = [element("li", element("b", doubt.point.problem), " ", doubt.point.remedy) for doubt in doubts]
    return element("ul", rows, class_="camera-problems")


def _pairs(contents: Contents, links: Sequence[Link]) -> Html | None:
    """The pairs of a camera, first those that are used, of these the ones that share most."""
    if not links:
        return None
    ordered = sorted(links, key=lambda link: (not link.used, -link.shared.sightings))[:MOST_PARTNERS]
    title = "Pairs with other cameras" + (f": {len(ordered)} of {len(links)}" if len(ordered) < len(links) else "")
    return _folded(title, pairs_table("camera-pairs", contents, ordered, copy=False))


def _folded(title: str, content: Html) -> Html:
    return element("details", element("summary", title), content)
