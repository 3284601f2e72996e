"""Tables of the README and of docs/filming.md, taken from the pages in docs/results: `python benchmarks/headline.py`.

Nothing between the two markers in these files is written by hand; a test compares both.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS, README, FILMING = ROOT / "docs" / "results", ROOT / "README.md", ROOT / "docs" / "filming.md"
BEGIN, END = "<!-- headline: written by benchmarks/headline.py -->", "<!-- end of the headline -->"


@dataclass(frozen=True)
class Headline:
    """One table of another page."""

    page: str
    heading: str
    """Of the section whose first table is shown."""
    says: str = ""


HEADLINES = (
    Headline(
        "paper", "## Against the paper",
        "From the pixels of three rendered scenes that stand for the paper's real ones. Only the intrinsics and people's mean "
        "height are known; errors are given with the estimated scale:",
    ),
    Headline(
        "paper", "## Do matchers collapse where people do not?",
        "Matchers of image points on the same videos, compared with the worst of all methods that use people:",
    ),
    Headline(
        "peers", "The peers in one line each.",
        "Compared with current engines on the same observations, with known identities (Passerby's figure divided by theirs):",
    ),
)  # fmt: skip
PATTERN = (Headline("lenses", "## What estimated intrinsics cost"),)
SHOWN = {README: HEADLINES, FILMING: PATTERN}
"""The tables of each file, between its two markers."""


def first_table(text: str, heading: str) -> str:
    """The first Markdown table after a heading. Raises `ValueError` where there is none."""
    _, found, after = text.partition(heading)
    lines = after.splitlines()
    start = next((number for number, line in enumerate(lines) if line.startswith("|")), None)
    if not found or start is None:
        raise ValueError(f"no table below {heading!r}")
    end = next((number for number in range(start, len(lines)) if not lines[number].startswith("|")), len(lines))
    return "\n".join(lines[start:end])


def command(text: str) -> str:
    """The command in a page's last line."""
    return text.strip().splitlines()[-1].split("`")[1]


def headlines(file: Path = README, results: Path = RESULTS) -> str:
    """The text between the markers of a file."""
    parts = []
    for headline in SHOWN[file]:
        path = results / f"{headline.page}.md"
        page = path.read_text()
        link = RESULTS.relative_to(file.parent).as_posix()
        source = f"By `{command(page)}`: [{headline.page}]({link}/{headline.page}.md)."
        parts += [headline.says, first_table(page, headline.heading), source]
    return "\n\n".join(part for part in parts if part)


def main() -> None:
    """Write the tables anew."""
    for file in SHOWN:
        text = file.read_text()
        before, rest = text.split(BEGIN)
        after = rest.split(END)[1]
        file.write_text(f"{before}{BEGIN}\n\n{headlines(file)}\n\n{END}{after}")


if __name__ == "__main__":
    main()
