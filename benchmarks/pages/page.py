"""A page of results: Markdown, its plots, and the note on the machine that stands below."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

from pages.commit import commit
from passerby.interchange.storage.atomic import write_bytes, write_text

PACKAGES = ("passerby", "numpy", "scipy", "poselib")
"""Whose versions decide over the last digits."""
FOOT = "Written by `"
"""Begins the last paragraph of a page."""
WIDEST = 60
"""Characters that a column of a table is padded to: in a column of sentences most of the page would be spaces."""


@dataclass(frozen=True)
class Page:
    """One page of results."""

    name: str
    """File name without ending."""
    text: str
    """Markdown; its links to the plots are relative."""
    plots: Mapping[str, str | bytes] = field(default_factory=dict)
    """File name -> SVG text, or the bytes of another picture. Names begin with the page's own."""
    commit_in_text: bool = False
    """Whether the text names the commits itself; else the foot of the page names that of this run."""
    further: tuple[Page, ...] = ()
    """Pages that the same run writes; a name may begin with a folder."""


def write_page(page: Page, folder: Path, command: str) -> Path:
    """Write a page, its plots and its further pages, these first, and return the page's path.

    Args:
        page: what to write.
        folder: made where it is missing.
        command: what was typed; it stands at the foot of the page, with the commit, the machine and the versions.

    Raises:
        InputError: the folder is not writable.
    """
    for name, plot in page.plots.items():
        write_bytes(folder / name, plot if isinstance(plot, bytes) else plot.encode("utf-8"))
    for further in page.further:
        write_page(further, folder, command)
    path = folder / f"{page.name}.md"
    write_text(path, signed(page, command))
    return path


def publish(pages: Page | Iterable[Page], folder: Path | None, command: str) -> None:
    """Write a page whenever there is more of it, and print it when it is whole.

    Args:
        pages: the page, or the same page again and again as it grows.
        folder: where it is written; None: it is printed only.
        command: what was typed.

    Raises:
        InputError: the folder is not writable.
    """
    page = None
    for page in [pages] if isinstance(pages, Page) else pages:
        if folder is not None:
            path = write_page(page, folder, command)
    if page is not None:
        print(signed(page, command) + ("" if folder is None else f"\nwritten to {path}\n"), flush=True)


def signed(page: Page, command: str) -> str:
    """The page's text with the command that wrote it, the commit, the machine and the versions at its foot."""
    code = "" if page.commit_in_text else f", code of commit {commit()},"
    return f"{page.text.rstrip()}\n\n{FOOT}{command}`{code} on: {machine_note()}\n"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; columns are padded so that it reads well as text, up to `WIDEST` characters."""
    cells = [list(head), *([str(cell) for cell in row] for row in rows)]
    widths = [min(WIDEST, max(3, *(len(row[column]) for row in cells))) for column in range(len(head))]
    lines = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in cells]
    return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])


def number(value: float | None, digits: int = 1) -> str:
    """A figure, or a dash where it is undefined."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def errors(mm: float | None, degrees: float | None) -> str:
    """Position and orientation error."""
    return f"{number(mm)} mm {number(degrees, 3)}°"


def reached(values: Sequence[float | None], acceptable: Sequence[float], aim: Sequence[float]) -> str:
    """`aim`, `acceptable` or `missed`: the worst of the figures decides."""
    if any(value is None for value in values):
        return "**missed**"
    known = [value for value in values if value is not None]
    if all(value <= limit for value, limit in zip(known, aim, strict=True)):
        return "aim"
    return "acceptable" if all(value <= limit for value, limit in zip(known, acceptable, strict=True)) else "**missed**"


def yes(condition: bool) -> str:
    """Whether a goal is met."""
    return "yes" if condition else "**no**"


def load() -> float:
    """Mean number of running processes over the last minute."""
    return os.getloadavg()[0]


def machine_note() -> str:
    """What the figures were made on."""
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    return f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, {versions}."


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
