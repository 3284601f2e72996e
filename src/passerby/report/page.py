"""The report as one HTML file that opens anywhere: no network, no dates, the same bytes for the same calibration."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable
from importlib import resources
from pathlib import Path

from passerby.common.progress import Progress, silent
from passerby.interchange.storage.atomic import write_text
from passerby.report.camera_table import camera_section
from passerby.report.contents import Contents
from passerby.report.distances import distances_section
from passerby.report.fitted import fit_people
from passerby.report.headline import headline_section, scene_name, verdict_pill
from passerby.report.html import Html, Section, element
from passerby.report.lens_table import lens_section
from passerby.report.people import heights_section, scale_section
from passerby.report.places import pictures_section, rig_section
from passerby.report.seen import seen_in
from passerby.report.timeline import timeline_section
from passerby.report.view_graph import view_graph_section
from passerby.report.workings import files_section, settings_section, stages_section


def report_page(contents: Contents, progress: Progress | None = None) -> str:
    """The page as HTML, the same for the same contents.

    Args:
        contents: of a calibration, or of an output folder.
        progress: told of "report", camera by camera, as their pictures are drawn.
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
    return _document(contents, [section for maker in makers if (section := maker()) is not None])


def write_report(contents: Contents, path: Path, progress: Progress | None = None) -> None:
    """Write the page, whole or not at all. Raises `InputError` where `path` is not writable."""
    write_text(path, report_page(contents, progress))


def _document(contents: Contents, sections: list[Section]) -> str:
    """Head, bar, sections, scripts."""
    from plotly.offline import get_plotlyjs

    scripts = [get_plotlyjs(), _asset("page.js")]
    name = scene_name(contents)
    head = element(
        "head",
        element("meta", charset="utf-8"),
        # Before anything that could run: only these two scripts may, and nothing may be fetched from anywhere.
        element("meta", http_equiv="Content-Security-Policy", content=_policy(scripts)),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", name="referrer", content="no-referrer"),
        element("title", f"{name}: {contents.verdict} – Passerby"),
        element("style", Html(_asset("page.css"))),
    )
    body = element(
        "body",
        element("a", "Skip to the verdict", href="#main", class_="skip"),
        _bar(contents, sections),
        element("main", [section.render() for section in sections], id="main", tabindex="-1"),
        _footer(contents),
        element(
            "noscript", element("p", "Plots and sorting need JavaScript; all figures are in the tables.", class_="nothing")
        ),
        [element("script", Html(script)) for script in scripts],
    )
    return "<!DOCTYPE html>\n" + element("html", head, body, lang="en") + "\n"


def _policy(scripts: list[str]) -> str:
    """The content security policy: these scripts by their hashes, styles in the page, pictures in the page, nothing else."""
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    allowed = " ".join(f"'sha256-{one}'" for one in hashes)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
        "connect-src 'none'; form-action 'none'; base-uri 'none'"
    )


def _bar(contents: Contents, sections: list[Section]) -> Html:
    """The scene, the verdict, the way to each section, and the switch between light and dark."""
    links = [element("li", element("a", section.short or section.title, href=f"#{section.anchor}")) for section in sections[1:]]
    return element(
        "header",
        element("div", element("span", scene_name(contents), class_="scene"), verdict_pill(contents), class_="who"),
        element("nav", element("ul", links), aria_label="Sections"),
        element("button", "Theme", type="button", id="theme", class_="quiet", aria_label="Theme: as the system"),
        class_="bar",
    )


def _footer(contents: Contents) -> Html:
    """By what the page was made."""
    return element(
        "footer",
        element("p", f"Made by Passerby {contents.document.passerby or ''} from calibration.json, rig.toml and tracks/."),
    )


def _asset(name: str) -> str:
    """A file of this package as text."""
    return resources.files("passerby.report").joinpath(name).read_text(encoding="utf-8")
