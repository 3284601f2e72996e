"""`docs/reliability.md`: one table over all parts, then each part's own section."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from paper.page import Page, table, write_page
from passerby.interchange.storage.atomic import write_text
from reliability.runs import code_digest

HEAD = """# Reliability

This page compares Passerby's own statements with the truth. Do its sigmas match its errors? Does its verdict accept a wrong
rig? Does the monitor detect a camera that moved, without false alarms? Can a damaged file or a fault of the machine destroy
finished work or cause a wrong answer without a warning?
"""


@dataclass(frozen=True)
class Line:
    """One line of the table over all parts."""

    what: str
    seen: str
    goal: str
    reached: bool


@dataclass(frozen=True)
class Part:
    """What one part found."""

    name: str
    """Of the part, as `--only` takes it."""
    title: str
    lines: Sequence[Line]
    text: str
    """Markdown of its section, without the title."""


def save(part: Part, folder: Path, *, quick: bool) -> None:
    """Keep a part for the page, with the code that it was run on."""
    content = asdict(part) | {"code": code_digest(), "quick": quick}
    write_text(folder / f"{part.name}.part.json", json.dumps(content, indent=1) + "\n")


def page(names: Sequence[str], folder: Path) -> Page:
    """The page of all parts that were run, in the order of the names."""
    rows, sections = [], []
    for name in names:
        path = folder / f"{name}.part.json"
        if not path.is_file():
            rows.append((name, "not run", "", ""))
            continue
        content = json.loads(path.read_text(encoding="utf-8"))
        notes = ["\n*A quick run: a few cases, too few for conclusions.*\n"] if content["quick"] else []
        if content["code"] != code_digest():
            notes.append("\n*Run on an earlier state of the code than the newest part of this page.*\n")
        rows += [
            (line["what"], line["seen"], line["goal"], "yes" if line["reached"] else "**no**") for line in content["lines"]
        ]
        sections.append(f"## {content['title']}\n{''.join(notes)}\n{content['text'].strip()}\n")
    summary = table(("what", "seen", "goal", "reached"), rows)
    return Page("reliability", "\n".join([HEAD, summary, "", *sections]))


def write(names: Sequence[str], kept: Path, out: Path, command: str) -> Path:
    """Write the page from the parts that are kept."""
    return write_page(page(names, kept), out, command)
