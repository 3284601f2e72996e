"""`docs/reliability.md`: one table over all parts, then each part's own section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from pages.kept import code_digest
from pages.page import table, yes
from pages.sections import Found, Heading, Section, SectionedPage
from reliability.runs import CODE

HEAD = """# Reliability

What Passerby says of itself, held against the truth: are its sigmas as large as its errors, does its verdict let a wrong rig
pass, does the monitor see a camera that moved and keep silent otherwise, and does anything that a file or a machine does lose
finished work or give a silent wrong answer?
"""
HEADINGS: Mapping[str, Heading] = {
    "coverage": Heading("Sigmas"),
    "verdict": Heading("The verdict"),
    "monitor": Heading("The monitor"),
    "fuzz": Heading("Files from anybody"),
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
    note = "*A quick run: a few cases, too few to judge by.*\n\n" if quick else ""
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
