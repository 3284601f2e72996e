"""Tables of the README and of docs/filming.md, taken from the pages in docs/results: `python benchmarks/headline.py`.

Nothing between two markers in these files is written by hand; a test compares both.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pages.page import table

ROOT = Path(__file__).resolve().parent.parent
RESULTS, README, FILMING = ROOT / "docs" / "results", ROOT / "README.md", ROOT / "docs" / "filming.md"
END = "<!-- end of the headline -->"


@dataclass(frozen=True)
class Headline:
    """One table of another page."""

    page: str
    heading: str
    """Of the section whose first table is shown."""
    says: str = ""
    columns: tuple[str, ...] = ()
    """Those that are shown; all where none is named."""
    rows: Mapping[str, str] = field(default_factory=dict)
    """Column -> regular expression that its cells begin with in the rows that are shown."""


PEERS = (
    Headline(
        "paper", "## Against the paper",
        "From the pixels of three rendered scenes that stand for the paper's real ones. The intrinsics and people's mean "
        "height are known, and nothing else unless a column says so; errors are given with the estimated scale:",
    ),
    Headline(
        "peers", "The peers in one line each.",
        "Compared with current engines on the same observations, with known identities (*mm ratio*: Passerby's error divided "
        "by theirs):",
        columns=("peer", "cases", "fails", "Passerby fails", "Passerby lower, mm", "mm ratio"),
    ),
)  # fmt: skip
SPREAD = ("similarity, median", "worst seed", "verdicts")
"""Columns of a sweep."""
SHOWN: Mapping[Path, Mapping[str, tuple[Headline, ...]]] = {
    README: {"headline": PEERS},
    FILMING: {
        "seconds": (Headline("seconds", "### terrace", columns=("seconds", *SPREAD)),),
        "people": (Headline("people", "### terrace", columns=("people", *SPREAD), rows={"method": "people"}),),
        "pattern": (
            Headline(
                "lenses", "## What estimated intrinsics cost",
                columns=("case", "focal, median", "rig, true intrinsics", "rig, estimated"),
                rows={"case": "(boxes, .*unknown|boxes and keypoints, .*unknown|the demonstration)"},
            ),
        ),
        "scale": (
            Headline(
                "scale", "## Goals", columns=("case", "measured"),
                rows={"case": "(nobody known, boxes|one person, boxes|one person, keypoints|a plan|one marked).* median"},
            ),
        ),
    },
}  # fmt: skip
"""The tables of each file, between the markers of a name."""


def begin(name: str) -> str:
    """The marker above the tables of a name."""
    return f"<!-- {name}: written by benchmarks/headline.py -->"


def first_table(text: str, headline: Headline) -> str:
    """The wanted part of the first Markdown table after a heading. Raises `ValueError` where there is none."""
    _, found, after = text.partition(headline.heading)
    lines = after.splitlines()
    start = next((number for number, line in enumerate(lines) if line.startswith("|")), None)
    if not found or start is None:
        raise ValueError(f"no table below {headline.heading!r}")
    end = next((number for number in range(start, len(lines)) if not lines[number].startswith("|")), len(lines))
    head, _, *cells = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines[start:end])
    shown = [_place(head, column) for column in headline.columns] or range(len(head))
    rules = [(_place(head, column), re.compile(rule)) for column, rule in headline.rows.items()]
    rows = [row for row in cells if all(rule.match(row[column]) for column, rule in rules)]
    if cells and not rows:
        raise ValueError(f"no row of the table below {headline.heading!r} is as wanted")
    return table([head[column] for column in shown], [[row[column] for column in shown] for row in rows])


def _place(head: list[str], column: str) -> int:
    """The place of a column. Raises `ValueError` where its name is not of exactly one."""
    if head.count(column) != 1:
        raise ValueError(f"{head.count(column)} columns are named {column!r}")
    return head.index(column)


def command(text: str) -> str:
    """The command in a page's last line."""
    return text.strip().splitlines()[-1].split("`")[1]


def headlines(file: Path, name: str, results: Path = RESULTS) -> str:
    """The text between the markers of a name in a file."""
    parts = []
    for headline in SHOWN[file][name]:
        path = results / f"{headline.page}.md"
        page = path.read_text()
        link = RESULTS.relative_to(file.parent).as_posix()
        source = f"By `{command(page)}`: [{headline.page}]({link}/{headline.page}.md)."
        parts += [headline.says, first_table(page, headline), source]
    return "\n\n".join(part for part in parts if part)


def main() -> None:
    """Write the tables anew."""
    for file, names in SHOWN.items():
        text = file.read_text()
        for name in names:
            before, rest = text.split(begin(name))
            _, _, after = rest.partition(END)
            text = f"{before}{begin(name)}\n\n{headlines(file, name)}\n\n{END}{after}"
        file.write_text(text)


if __name__ == "__main__":
    main()
