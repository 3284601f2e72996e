"""The report's templates, filled in by Jinja2: modules compute values, markup stands in `templates/`.

No text can become markup: all that is put in is escaped, but for what templates made.
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
"""Values that a template names."""


@cache
def environment() -> Environment:
    """The templates. Names that no value has are errors."""
    made = Environment(
        loader=PackageLoader("passerby.report"), autoescape=True, undefined=StrictUndefined, auto_reload=False,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters |= {"short": short, "shortened": shortened_text, "listed": list_names}
    made.policies["json.dumps_kwargs"] = {"ensure_ascii": True, "allow_nan": False, "separators": (",", ":")}
    return made


def render(template: str, **values: Any) -> Markup:
    """A template of `templates/`, filled in."""
    return Markup(environment().get_template(template).render(values))


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    anchor: str
    name: str
    """In the navigation."""
    html: Markup


def section(anchor: str, name: str, **values: Any) -> Section:
    """A part of the page, from the template that is called like its anchor."""
    return Section(anchor, name, render(f"{anchor}.html", **values))


@dataclass(frozen=True, eq=False)
class Plot:
    """A plotly figure that the page's script draws."""

    identifier: str
    label: str
    """What it shows, for those who cannot see it."""
    kind: str
    """flat, map or space; map gets buttons that move the view, space those that turn it, and a note where WebGL is missing."""
    figure: Mapping[str, Any] | None
    """None where it is a file beside the page."""


def plot(identifier: str, figure: Mapping[str, Any], label: str, *, kind: str = "flat", parts: Parts | None = None) -> Plot:
    """A plotly figure ({"data", "layout"}).

    Args:
        identifier: of the element, unique on the page.
        figure: without colours of text, grid and background; "var(--name)" stands for a colour of the style.
        label: as of `Plot`.
        kind: as of `Plot`.
        parts: where the figure is put, for the page to load when it is about to be seen; None: into the page.
    """
    if parts is not None:
        parts.add(identifier, figure)
    return Plot(identifier, label, kind, plain(figure) if parts is None else None)


def short(value: float) -> str:
    """To a tenth of a pixel, without needless zeros."""
    return f"{round(float(value), 1) + 0.0:g}"


def plot_text(text: str) -> str:
    """Text for a plotly figure, which reads some HTML and fills in `%{...}`."""
    return escape(text, quote=False).replace("%{", "%&#8203;{")
