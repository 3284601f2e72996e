"""The HTML document around the sections of a report: head, bar, scripts, and the policy of what may run."""

from __future__ import annotations

import base64
import hashlib
from importlib import resources

from passerby.report.contents import Contents
from passerby.report.headline import scene_name, verdict_pill
from passerby.report.html import Html, Section, element
from passerby.report.parts import Parts


def html_document(contents: Contents, sections: list[Section], parts: Parts | None = None) -> str:
    """Head, bar, sections, scripts.

    Args:
        contents: of the report.
        sections: in their order.
        parts: files that the page loads when it needs them, as it does plotly's code then: a third of a second of work before
            anything is seen. They get their place. None: the page is all in one.

    Raises:
        OSError: the files cannot get their place.
    """
    from plotly.offline import get_plotlyjs

    scripts = [get_plotlyjs(), _asset("page.js")]
    if parts is not None:
        parts.add_script("plotly", scripts[0])
        scripts = [_asset("page.js"), _asset("site.js")]
    name = scene_name(contents)
    head = element(
        "head",
        element("meta", charset="utf-8"),
        # Before anything that could run: only these scripts may, and nothing else may be fetched from anywhere.
        element("meta", http_equiv="Content-Security-Policy", content=_policy(scripts, parts is not None)),
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
    return (
        "<!DOCTYPE html>\n" + element("html", head, body, lang="en", data_parts=None if parts is None else parts.place()) + "\n"
    )


def _policy(scripts: list[str], load: bool) -> str:
    """The content security policy: these scripts by their hashes, styles in the page, pictures in the page, nothing else.

    Args:
        scripts: of the page.
        load: whether they may load others; no address would do, as the page may lie anywhere.
    """
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    allowed = " ".join(f"'sha256-{one}'" for one in hashes) + (" 'strict-dynamic'" if load else "")
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
