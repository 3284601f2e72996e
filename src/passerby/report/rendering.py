"""The report's templates, filled in by Jinja2: modules compute values, and `templates/` contains the markup.

No text can become markup: all values are escaped, except markup that templates made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from html import escape
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from passerby.common.text import list_names, shortened_text
from passerby.interchange.storage.text_formats import plain
from passerby.report.parts import Parts

Row = dict[str, Any]
"""Values by the names that a template uses."""


@cache
def environment() -> Environment:
    """Return the environment of the templates. A name without a value is an error."""
    made = Environment(
        loader=PackageLoader("passerby.report"), autoescape=True, undefined=StrictUndefined, auto_reload=False,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters |= {"short": short, "shortened": shortened_text, "listed": list_names}
    made.policies["json.dumps_kwargs"] = {"ensure_ascii": True, "allow_nan": False, "separators": (",", ":")}
    return made


def render(template: str, **values: Any) -> Markup:
    """Fill in a template of `templates/`."""
    return Markup(environment().get_template(template).render(values))


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    anchor: str
    name: str
    """Name in the navigation."""
    html: Markup


def section(anchor: str, name: str, **values: Any) -> Section:
    """Return a part of the page from the template that has the name of its anchor."""
    return Section(anchor, name, render(f"{anchor}.html", **values))


@dataclass(frozen=True, eq=False)
class Plot:
    """A plotly figure that the page's script draws."""

    identifier: str
    label: str
    """Description of the figure for screen readers."""
    kind: str
    """flat, map or space. A map has buttons that move the view; a space has buttons that turn it, and a note without WebGL."""
    figure: Mapping[str, Any] | None
    """None if the figure is a file beside the page."""


def plot(identifier: str, figure: Mapping[str, Any], label: str, *, kind: str = "flat", parts: Parts | None = None) -> Plot:
    """Make a plot from a plotly figure ({"data", "layout"}).

    Args:
        identifier: of the element, unique on the page.
        figure: without colours of text, grid and background; "var(--name)" stands for a colour of the style sheet.
        label: as in `Plot`.
        kind: as in `Plot`.
        parts: receives the figure, which the page loads when it is about to be visible; None: the figure is in the page.
    """
    if parts is not None:
        parts.add(identifier, figure)
    return Plot(identifier, label, kind, plain(figure) if parts is None else None)


def short(value: float) -> str:
    """Write a length to a tenth of a pixel, without trailing zeros."""
    return f"{round(float(value), 1) + 0.0:g}"


def plot_text(text: str) -> str:
    """Escape text for a plotly figure, because plotly interprets some HTML and fills in `%{...}`."""
    return escape(text, quote=False).replace("%{", "%&#8203;{")
