"""The list of a site's cameras: what is wrong with each, its zone, and its figures, to be searched and sorted."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.common.text import shortened_text
from passerby.interchange.calibration_json import GroupEntry
from passerby.interchange.output_folder import REPORT_FILE
from passerby.report.camera_table import LEAD, NO_POSE, camera_rows, swatch, weak_cameras
from passerby.report.contents import Contents
from passerby.report.html import Section, element, join
from passerby.report.recommendations import Reported, reported_doubts
from passerby.report.seen import Seen
from passerby.report.tables import Cell, Column, data_table, text
from passerby.report.values import MISSING

STATES = ("no pose", "problem", "stands out", "good", "other group")
"""What a camera may be, in the order of the list."""
ZONE = Column("Zone", numeric=False, hint="part of the map")
STATE = Column("State", numeric=False, hint="whether the camera has problems, or its figures stand out")
PROBLEM = Column("What is wrong", numeric=False)
FIRST = ("Position std", "Rotation std")
"""Figures that stand before the others."""
LONGEST = 160
"""Letters of a problem in the list; the summary has it in full."""


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
        problem = _elsewhere(groups[name]) if name in groups else _problem(words)
        zone = zones.get(name)
        ranked.append((STATES.index(state), place, [head, _zone(zone), _state(state), problem, *(row[one] for one in order)]))
    for name, group in groups.items():
        if name not in contents.rig.names:
            empty = [Cell(MISSING, None, numeric=True)] * len(order)
            ranked.append((len(STATES), len(ranked), [text(name), _zone(None), _state(STATES[-1]), _elsewhere(group), *empty]))
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


def _elsewhere(group: GroupEntry) -> Cell:
    """Where a camera of a further group is reported."""
    return text(element("a", f"see group {group.group}", href=f"{group.folder}/{REPORT_FILE}"), f"group {group.group}")
