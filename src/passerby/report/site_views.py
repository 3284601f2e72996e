"""The cameras of a site: a list for searching and sorting, and the view of each camera, which is in a file of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from passerby.common.progress import Progress
from passerby.common.text import shortened_text
from passerby.core.colours import camera_colour
from passerby.interchange.calibration_json import GroupEntry
from passerby.interchange.output_folder import REPORT_FILE
from passerby.report.camera_table import NO_POSE, camera_rows, weak_cameras
from passerby.report.contents import Contents
from passerby.report.distances import distances_from, distances_table, read_solved_distances
from passerby.report.fitted import Fitted
from passerby.report.parts import Parts
from passerby.report.pictures import camera_panel, decode_backdrops, layer_switches
from passerby.report.recommendations import Reported, reported_doubts
from passerby.report.rendering import Section, section
from passerby.report.seen import Seen, neighbours_of
from passerby.report.tables import MISSING, Cell, Column, Table, number, text
from passerby.report.view_graph import Link, pairs_table

MOST_PARTNERS = 24
"""Most pairs that are listed with a camera: in one hall each camera may form pairs with all others."""
STATES = ("no pose", "problem", "stands out", "good", "other group")
"""States of a camera, in the order of the list."""
ZONE = Column("Zone", numeric=False, hint="part of the map")
STATE = Column("State", numeric=False, hint="whether the camera has problems, or its figures stand out")
PROBLEM = Column("What is wrong", numeric=False)
FIRST = ("Position std", "Rotation std")
"""Titles of the columns that come before the other figures."""
LONGEST = 160
"""Most letters of a problem in the list; the summary has the full text."""


def site_views_section(
    contents: Contents, fit: Fitted, seen: Seen, links: Sequence[Link],
    problems: Mapping[str, Sequence[Reported]], parts: Parts, tell: Progress,
) -> Section:  # fmt: skip
    """Return the section with a field for a camera's name and space for its panel; the panels are written to files.

    Args:
        contents: of the report.
        fit: of the whole sample.
        seen: of all cameras.
        links: all pairs.
        problems: by camera, the reported problems.
        parts: receives the panels.
        tell: called for each camera.
    """
    near = neighbours_of(contents.rig, seen)
    by_camera: dict[str, list[Link]] = {name: [] for name in contents.rig.names}
    for link in links:
        by_camera[link.first].append(link)
        by_camera[link.second].append(link)
    posed, solved = list(contents.rig.posed()), read_solved_distances(contents)
    for place, (name, behind) in enumerate(decode_backdrops(contents, tell)):
        camera = contents.rig[name]
        tables = _pairs(contents, by_camera[name])
        if camera.pose is not None and len(posed) > 1:
            nearest = distances_table("camera-distances", distances_from(camera, posed, solved), copy=False)
            tables.append(("Distances to the nearest cameras", nearest))
        points = [doubt.point for doubt in problems.get(name, ())]
        panel = camera_panel(contents, fit, seen, place, name, behind, near[name], points, tables)
        parts.add(part_name(place), {"html": panel})
    return section("views", "Views", site=True, names=contents.rig.names, layers=layer_switches(contents), panels=())


def part_name(place: int) -> str:
    """Return the name of the file of the camera with this position in the rig."""
    return f"camera-{place}"


def _pairs(contents: Contents, links: Sequence[Link]) -> list[tuple[str, Table]]:
    """Return a titled table of a camera's pairs: used pairs first, then by the number of shared observations."""
    if not links:
        return []
    ordered = sorted(links, key=lambda link: (not link.used, -link.shared.sightings))[:MOST_PARTNERS]
    title = "Pairs with other cameras" + (f": {len(ordered)} of {len(links)}" if len(ordered) < len(links) else "")
    return [(title, pairs_table("camera-pairs", contents, ordered, copy=False))]


def site_camera_section(contents: Contents, seen: Seen, zones: Mapping[str, int]) -> Section:
    """Return the section with a row for each camera, the worst states first; cameras of other groups link to their report."""
    weak = weak_cameras(contents)
    columns, rows = camera_rows(contents, seen, weak)
    order = sorted(range(1, len(columns)), key=lambda one: columns[one].title not in FIRST)
    told = problems_by_camera(contents)
    groups = {name: group for group in contents.document.groups or () for name in group.cameras}
    ranked = []
    for place, (camera, row) in enumerate(zip(contents.rig, rows, strict=True)):
        name = camera.name
        state = state_of(camera.pose is not None, name, told, weak) if name not in groups else STATES[-1]
        head = text(name, href=f"#camera={place}", inner="name")
        words = " ".join(doubt.point.problem for doubt in told.get(name, ())) or ("" if camera.pose is not None else NO_POSE)
        problem = _link_other_group(groups[name]) if name in groups else _problem(words)
        zone = zones.get(name)
        ranked.append((STATES.index(state), place, [head, _zone(zone), _state(state), problem, *(row[one] for one in order)]))
    for name, group in groups.items():
        if name not in contents.rig.names:
            empty = [number(None)] * len(order)
            ranked.append(
                (len(STATES), len(ranked), [text(name), _zone(None), _state(STATES[-1]), _link_other_group(group), *empty])
            )
    ranked.sort(key=lambda one: one[:2])
    heads = [columns[0], ZONE, STATE, PROBLEM, *(columns[one] for one in order)]
    table = Table(identifier="cameras-table", caption="Cameras", columns=heads, rows=[cells for *_, cells in ranked])
    return section("cameras", "Cameras", table=table, site=True)


def problems_by_camera(contents: Contents) -> dict[str, list[Reported]]:
    """Return the problems of the rig, by the cameras that they concern."""
    found: dict[str, list[Reported]] = {}
    for doubt in reported_doubts(contents.document):
        for name in doubt.cameras:
            found.setdefault(name, []).append(doubt)
    return found


def state_of(posed: bool, name: str, told: Mapping[str, list[Reported]], weak: Mapping[str, frozenset[str]]) -> str:
    """Return the state, one of `STATES`, of a camera of this rig."""
    if not posed:
        return STATES[0]
    if name in told:
        return STATES[1]
    return STATES[2] if any(name in names for names in weak.values()) else STATES[3]


def _zone(zone: int | None) -> Cell:
    if zone is None:
        return text(MISSING, "")
    return text(str(zone), colour=camera_colour(zone - 1))


def _state(state: str) -> Cell:
    return text(state, inner=f"state state-{state.replace(' ', '-')}")


def _problem(words: str) -> Cell:
    """Return a cell with the problems of a camera, shortened."""
    return text("", words, note=shortened_text(words, LONGEST), why=True)


def _link_other_group(group: GroupEntry) -> Cell:
    """Return a cell with a link to the report of another group's camera."""
    return text(f"see group {group.group}", f"group {group.group}", href=f"{group.folder}/{REPORT_FILE}")
