"""HTML in which no text can become markup: whatever is not `Html` already is escaped when it is put in."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import Any

from passerby.interchange.storage.text_formats import plain
from passerby.report.parts import Parts

TOOLS = {"map": "Move the view", "space": "Rotate the view"}
"""What the buttons of a kind of plot do."""
VOID = frozenset({"meta", "input", "br", "link"})


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


Child = str | Html | None | Iterable["Child"]
Attribute = str | int | float | bool | None


def element(name: str, /, *children: Child, **attributes: Attribute) -> Html:
    """`<name attributes>children</name>`.

    Text and attributes are escaped. `class_` becomes `class`, underscores become hyphens; True is an attribute without a
    value, None and False leave it out.
    """
    told = "".join(_attribute(key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items())
    return Html(f"<{name}{told}>" if name in VOID else f"<{name}{told}>{join(*children)}</{name}>")


def join(*children: Child) -> Html:
    """Children one after the other, text escaped."""
    return Html("".join(_piece(child) for child in children))


def _piece(child: Child) -> str:
    if child is None:
        return ""
    if isinstance(child, Html):
        return child
    if isinstance(child, str):
        return escape(child)
    return "".join(_piece(one) for one in child)


def _attribute(name: str, value: Attribute) -> str:
    if value is None or value is False:
        return ""
    return f" {name}" if value is True else f' {name}="{escape(str(value))}"'


def data_script(identifier: str, value: Any) -> Html:
    """JSON for the page's script. No text in it can end the element or begin another."""
    text = json.dumps(plain(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    safe = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return Html(f'<script type="application/json" id="{escape(identifier)}">{safe}</script>')


def plot_text(text: str) -> str:
    """Text for a plotly figure, which reads some HTML and fills in `%{...}`."""
    return escape(text, quote=False).replace("%{", "%&#8203;{")


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    anchor: str
    title: str
    lead: str
    """What it shows and how to read it, one or two sentences."""
    body: Html
    short: str = ""
    """What the navigation calls it; empty: as the title."""

    def render(self) -> Html:
        """The section as HTML."""
        heading = f"{self.anchor}-title"
        return element(
            "section",
            element("h2", self.title, id=heading),
            element("p", self.lead, class_="lead") if self.lead else None,
            self.body,
            id=self.anchor,
            aria_labelledby=heading,
        )


def nothing(why: str) -> Html:
    """What a section says that has nothing to show."""
    return element("p", why, class_="nothing")


def plot(identifier: str, figure: Any, label: str, *, kind: str = "flat", parts: Parts | None = None) -> Html:
    """A plotly figure ({"data", "layout"}) that the page's script draws.

    Args:
        identifier: of the element, unique on the page.
        figure: without colours of text, grid and background; "var(--name)" stands for a colour of the style.
        label: what it shows, for those who cannot see it.
        kind: flat, map or space; map gets buttons that move the view, space those that turn it, and a note where WebGL is
            missing.
        parts: where the figure is put, for the page to load when it is about to be seen; None: into the page.
    """
    tools = element("div", class_="view-buttons", role="group", aria_label=TOOLS[kind]) if kind in TOOLS else None
    if parts is not None:
        parts.add(identifier, figure)
    return element(
        "div",
        tools,
        element(
            "div",
            id=identifier,
            class_=f"plot plot-{kind}",
            role="img",
            aria_label=label,
            tabindex="-1",
            data_part=None if parts is None else identifier,
        ),
        data_script(f"{identifier}-figure", figure) if parts is None else None,
        class_="plot-box",
    )
