"""The cameras of a site: their list, to be searched and sorted, and the view of one camera, each in a file of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from passerby.common.progress import Progress
from passerby.common.text import shortened_text
from passerby.interchange.calibration_json import GroupEntry
from passerby.interchange.output_folder import REPORT_FILE
from passerby.report.camera_table import LEAD, NO_POSE, camera_rows, swatch, weak_cameras
from passerby.report.contents import Contents
from passerby.report.distances import distances_from, distances_table, solved_distances
from passerby.report.fitted import Fitted
from passerby.report.html import Html, Section, element, join
from passerby.report.parts import Parts
from passerby.report.pictures import VIEWS_LEAD, camera_panel, decoded_backdrops, layer_switches
from passerby.report.recommendations import Reported, reported_doubts
from passerby.report.seen import Seen, neighbours_of
from passerby.report.tables import MISSING, Cell, Column, data_table, text
from passerby.report.view_graph import Link, pairs_table

MOST_PARTNERS = 24
"""Pairs that are listed with a camera: in one hall each camera may have one with all others."""
STATES = ("no pose", "problem", "stands out", "good", "other group")
"""What a camera may be, in the order of the list."""
ZONE = Column("Zone", numeric=False, hint="part of the map")
STATE = Column("State", numeric=False, hint="whether the camera has problems, or its figures stand out")
PROBLEM = Column("What is wrong", numeric=False)
FIRST = ("Position std", "Rotation std")
"""Figures that stand before the others."""
LONGEST = 160
"""Letters of a problem in the list; the summary has it in full."""


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
            more.append(_fold_list("Distances to the nearest cameras", nearest))
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
    return _fold_list(title, pairs_table("camera-pairs", contents, ordered, copy=False))


def _fold_list(title: str, content: Html) -> Html:
    return element("details", element("summary", title), content)


def site_camera_section(contents: Contents, seen: Seen, zones: Mapping[str, int]) -> Section:
    """A row for each camera, those with problems first, and for those of further groups, with a link to their report."""
    weak = weak_cameras(contents)
    columns, rows = camera_rows(contents, seen, weak)
    order = sorted(range(1, len(columns)), key=lambda one: columns[one].title not in FIRST)
    told = problems_by_camera(contents)
    groups = {name: group for group in contents.document.groups or () for name in group.cameras}
    ranked = []
    for place, (camera, row) in enumerate(zip(contents.rig, rows, strict=True)):
        name = camera.name
        state = state_of(camera.pose is not None, name, told, weak) if name not in groups else STATES[-1]
        head = text(element("a", name, href=f"#camera={place}", class_="name"), name)
        words = " ".join(doubt.point.problem for doubt in told.get(name, ())) or ("" if camera.pose is not None else NO_POSE)
        problem = _link_other_group(groups[name]) if name in groups else _problem(words)
        zone = zones.get(name)
        ranked.append((STATES.index(state), place, [head, _zone(zone), _state(state), problem, *(row[one] for one in order)]))
    for name, group in groups.items():
        if name not in contents.rig.names:
            empty = [Cell(MISSING, None, numeric=True)] * len(order)
            ranked.append(
                (len(STATES), len(ranked), [text(name), _zone(None), _state(STATES[-1]), _link_other_group(group), *empty])
            )
    ranked.sort(key=lambda one: one[:2])
    heads = [columns[0], ZONE, STATE, PROBLEM, *(columns[one] for one in order)]
    table = data_table("cameras-table", "Cameras", heads, [cells for *_, cells in ranked])
    lead = f"{LEAD} A camera's name leads to its picture. Zones are parts of the map, for finding cameras on it."
    return Section("cameras", "Cameras", lead, table)


def problems_by_camera(contents: Contents) -> dict[str, list[Reported]]:
    """The problems of the rig, by the cameras that they are about."""
    found: dict[str, list[Reported]] = {}
    for doubt in reported_doubts(contents.document):
        for name in doubt.cameras:
            found.setdefault(name, []).append(doubt)
    return found


def state_of(posed: bool, name: str, told: Mapping[str, list[Reported]], weak: Mapping[str, frozenset[str]]) -> str:
    """One of `STATES` for a camera of this rig."""
    if not posed:
        return STATES[0]
    if name in told:
        return STATES[1]
    return STATES[2] if any(name in names for names in weak.values()) else STATES[3]


def _zone(zone: int | None) -> Cell:
    if zone is None:
        return text(MISSING, "")
    return text(join(swatch(zone - 1), str(zone)), str(zone))


def _state(state: str) -> Cell:
    return text(element("span", state, class_=f"state state-{state.replace(' ', '-')}"), state)


def _problem(words: str) -> Cell:
    """The problems of a camera, shortened."""
    return text(element("small", shortened_text(words, LONGEST), class_="why") if words else "", words)


def _link_other_group(group: GroupEntry) -> Cell:
    """Where a camera of a further group is reported."""
    return text(element("a", f"see group {group.group}", href=f"{group.folder}/{REPORT_FILE}"), f"group {group.group}")
