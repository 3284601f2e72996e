"""The report as HTML that opens anywhere: no network, no dates, the same bytes for the same calibration.

It is one file, and beyond `site.EMBEDDED_CAMERAS` a page with files beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from passerby.common.progress import Progress, silent
from passerby.interchange.output_folder import remove_report_parts
from passerby.interchange.storage.atomic import write_text
from passerby.report.camera_table import camera_section
from passerby.report.contents import Contents
from passerby.report.distances import distances_section
from passerby.report.document import html_document
from passerby.report.fitted import fit_people
from passerby.report.headline import headline_section
from passerby.report.html import Section
from passerby.report.lens_table import lens_section
from passerby.report.parts import parts_beside
from passerby.report.people import heights_section, scale_section
from passerby.report.places import pictures_section, rig_section
from passerby.report.seen import seen_in
from passerby.report.site import is_site
from passerby.report.site_page import site_page
from passerby.report.timeline import timeline_section
from passerby.report.view_graph import view_graph_section
from passerby.report.workings import files_section, settings_section, stages_section


def report_page(contents: Contents, progress: Progress | None = None) -> str:
    """The page as HTML in one file, the same for the same contents, for any number of cameras.

    Args:
        contents: of a calibration, or of an output folder.
        progress: called with "report", camera by camera, as their pictures are drawn.
    """
    tell = progress or silent
    seen, fit = seen_in(contents), fit_people(contents)
    makers: list[Callable[[], Section | None]] = [
        lambda: headline_section(contents, seen),
        lambda: camera_section(contents, seen),
        lambda: lens_section(contents),
        lambda: rig_section(contents, fit),
        lambda: pictures_section(contents, fit, seen, tell),
        lambda: view_graph_section(contents, seen),
        lambda: timeline_section(contents, seen.spells),
        lambda: heights_section(contents),
        lambda: scale_section(contents),
        lambda: distances_section(contents),
        lambda: stages_section(contents, seen),
        lambda: settings_section(contents),
        lambda: files_section(contents),
    ]
    return html_document(contents, [section for maker in makers if (section := maker()) is not None])


def write_report(contents: Contents, path: Path, progress: Progress | None = None) -> None:
    """Write the page, whole or not at all, after the files beside it, of many cameras. Raises `InputError` where it cannot."""
    if is_site(contents):
        with parts_beside(path) as parts:
            write_text(path, site_page(contents, parts, progress or silent))
            remove_report_parts(path, but=parts.stamp)
    else:
        write_text(path, report_page(contents, progress))
        remove_report_parts(path)
