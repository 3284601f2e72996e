"""`docs/reliability.md`: one table over all parts, then each part's own section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from pages.kept import code_digest
from pages.page import table, yes
from pages.sections import Found, Heading, Section, SectionedPage
from reliability.runs import CODE

HEAD = """# Reliability

This page compares Passerby's own statements with the truth. Do its sigmas match its errors? How near are the errors to the
least possible ones? Does its verdict accept a wrong rig? Does it name the intrinsics that are wrong, and no others? Does the
monitor detect a camera that moved, without false alarms? Can a damaged file or a fault of the machine destroy finished work or
cause a wrong answer without a warning?
"""
HEADINGS: Mapping[str, Heading] = {
    "coverage": Heading("Sigmas"),
    "bound": Heading("Errors against the Cramer-Rao bound"),
    "verdict": Heading("The verdict"),
    "lenses": Heading("Stated intrinsics"),
    "monitor": Heading("The monitor"),
    "fuzz": Heading("Untrusted files"),
    "faults": Heading("Faults of the machine"),
}
"""Of the parts, as `--only` takes them, in their order on the page."""


@dataclass(frozen=True)
class Line:
    """One line of the table over all parts."""

    what: str
    seen: str
    goal: str
    reached: bool


def part_found(lines: Sequence[Line], text: str, *, quick: bool) -> Found:
    """What a part found: its lines of the table, and Markdown of its section without the title."""
    note = "*A quick run: a few cases, too few for conclusions.*\n\n" if quick else ""
    return Found(note + text.strip(), {"lines": [asdict(line) for line in lines]})


def reliability_page() -> SectionedPage:
    """The page of all parts. What took time may have been kept from an earlier run."""
    return SectionedPage("reliability", _head, HEADINGS, code_digest(*CODE), timed=False)


def _head(sections: Sequence[Section]) -> str:
    """The table over all parts."""
    rows = []
    for section in sections:
        lines = section.facts.get("lines", ())
        rows += [(line["what"], line["seen"], line["goal"], yes(line["reached"])) for line in lines]
        rows += [] if lines else [(section.part, "not run", "", "")]
    return f"{HEAD}\n{table(('what', 'seen', 'goal', 'reached'), rows)}"
