"""The report of a site: a page that opens at once, and files with what one camera or one plot needs."""

from __future__ import annotations

from passerby.common.progress import Progress
from passerby.report.camera_table import weak_cameras
from passerby.report.contents import Contents
from passerby.report.distances import site_distances_section
from passerby.report.document import html_document
from passerby.report.fitted import Fitted, fit_people
from passerby.report.floor_plan import plan_drawing
from passerby.report.headline import headline_section
from passerby.report.html import Section, element, nothing, plot
from passerby.report.lens_table import lens_section
from passerby.report.parts import Parts
from passerby.report.people import heights_section, scale_section
from passerby.report.places import RIG_LEAD
from passerby.report.seen import seen_in
from passerby.report.site import zones_of
from passerby.report.site_map import site_in_space, site_map
from passerby.report.site_table import problems_by_camera, site_camera_section
from passerby.report.site_views import site_views_section
from passerby.report.timeline import timeline_section
from passerby.report.values import count
from passerby.report.view_graph import Link, links_of, site_graph_section
from passerby.report.workings import files_section, settings_section, stages_section


def site_page(contents: Contents, parts: Parts, tell: Progress) -> str:
    """The page as HTML; what it loads later goes into files. Both are the same for the same contents.

    Args:
        contents: of a calibration, or of an output folder.
        parts: gets the files, and their place.
        tell: called with "report", camera by camera, as their pictures are drawn.

    Raises:
        OSError: a file cannot be written.
    """
    seen, fit, zones = seen_in(contents), fit_people(contents), zones_of(contents)
    links, told = links_of(contents, seen), problems_by_camera(contents)
    sections: list[Section | None] = [
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
    return html_document(contents, [section for section in sections if section is not None], parts)


def site_rig_section(contents: Contents, fit: Fitted, zones: dict[str, int], links: list[Link], parts: Parts) -> Section:
    """The site as a map and in space."""
    posed = contents.rig.posed()
    if not len(posed):
        return Section("rig", "The site", RIG_LEAD, nothing("No camera has a pose: there is nothing to draw."), "Map")
    lead = (
        f"{RIG_LEAD} Names appear where there is room: zoom in by drawing a frame or with the buttons, and double-click to see "
        "all. Click on a camera to see its picture."
    )
    marked = dict.fromkeys(problems_by_camera(contents), "problem")
    for names in weak_cameras(contents).values():
        marked |= dict.fromkeys(names, "stands out")
    who = f"{count(len(posed), 'camera')} in {count(len(set(zones.values())), 'zone')}"
    above = plot("rig-above", site_map(contents, fit, zones, links, marked), f"Map of {who}", kind="map", parts=parts)
    space = plot("rig-space", site_in_space(contents, fit, zones), f"{who} in space", kind="space", parts=parts)
    plan = plan_drawing(contents, fit, zones, parts)
    return Section("rig", "The site", lead, element("div", plan, above, space, class_="stack"), "Map")
