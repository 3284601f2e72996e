"""`docs/reliability.md`: one table over all parts, then each part's own section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType

from pages.commit import commit
from pages.kept import code_behind, code_digest
from pages.page import Page, table, yes
from pages.sections import Found, Heading, Section, SectionedPage

HEAD = """# Reliability

This page compares Passerby's own statements with the truth. Do its sigmas match its errors? How near are the errors to the
least possible ones? Does its verdict accept a wrong rig? Does it name the intrinsics that are wrong, and no others? Does the
monitor detect a camera that moved, without false alarms? Can a damaged file or a fault of the machine destroy finished work or
cause a wrong answer without a warning? How much of the code that judges, tells and writes runs in the tests?
"""
HEADINGS: Mapping[str, Heading] = {
    "coverage": Heading("Sigmas"),
    "keypoints": Heading("Sigmas by keypoints"),
    "found": Heading("Sigmas where identities are found, after alignment, and of one person"),
    "freed": Heading("Sigmas where lenses are refined or unknown"),
    "videos": Heading("Sigmas from videos"),
    "bound": Heading("Errors against the Cramer-Rao bound"),
    "verdict": Heading("The verdict"),
    "lenses": Heading("Stated intrinsics"),
    "monitor": Heading("The monitor"),
    "fuzz": Heading("Untrusted files"),
    "faults": Heading("Faults of the machine"),
    "branches": Heading("Branch coverage"),
}
"""Of the parts, as `--only` takes them, in their order on the page."""


PARTS: Mapping[str, str] = MappingProxyType({
    "coverage": "coverage.run",
    "keypoints": "other_inputs.run_keypoints",
    "found": "other_inputs.run_found",
    "freed": "other_inputs.run_freed",
    "videos": "other_inputs.run_videos",
    "bound": "bound.run",
    "verdict": "battery.run",
    "lenses": "lenses.run",
    "monitor": "watch.run",
    "fuzz": "fuzz.run",
    "faults": "faults.run",
    "branches": "branches.run",
})  # fmt: skip
"""Part -> module of `reliability`, and its function that runs the part."""


@dataclass(frozen=True)
class Line:
    """One line of the table over all parts."""

    what: str
    seen: str
    goal: str
    reached: bool


def part_found(lines: Sequence[Line], text: str, *, quick: bool, further: tuple[Page, ...] = ()) -> Found:
    """What a part found: its lines of the table, and Markdown of its section without the title; and pages of its own."""
    note = "*A quick run: a few cases, too few for conclusions.*\n\n" if quick else ""
    return Found(note + text.strip(), {"lines": [asdict(line) for line in lines], "commit": commit(), "quick": quick}, further)


def reliability_page() -> SectionedPage:
    """The page of all parts. What took time may have been kept from an earlier run."""
    return SectionedPage("reliability", _head, HEADINGS, part_codes(), timed=False)


def part_codes() -> dict[str, str]:
    """Part -> digest of the code that its figures rest on: the package, and what measures the part."""
    return {part: code_digest(*code_behind(f"reliability.{run.partition('.')[0]}")) for part, run in PARTS.items()}


def is_whole(section: Section) -> bool:
    """Whether a part was run whole, on the code as it is now."""
    return section.code == part_codes()[section.part] and not section.facts.get("quick", True)


def _head(sections: Sequence[Section]) -> str:
    """The table over all parts."""
    rows = []
    for section in sections:
        lines = section.facts.get("lines", ())
        rows += [(line["what"], line["seen"], line["goal"], yes(line["reached"])) for line in lines]
        rows += [] if lines else [(section.part, "not run", "", "")]
    return f"{HEAD}\n{_origin(sections)}\n\n{table(('what', 'seen', 'goal', 'reached'), rows)}"


def _origin(sections: Sequence[Section]) -> str:
    """On which code the parts were run."""
    missing = [section.title for section in sections if not is_whole(section)]
    if missing:
        return f"**Not of one state of the code**: to be run whole, or again, are {', '.join(missing)}."
    commits = list(dict.fromkeys(section.facts["commit"] for section in sections))
    return (
        "All parts were run whole on one state of the code: the package is the same throughout, and each part's own scripts "
        f"are those of today. Commits at the time: {', '.join(commits)}."
    )
