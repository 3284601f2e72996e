"""Tables of the README and of docs/filming.md, taken from the records: `python benchmarks/headline.py`.

Nothing between two markers in these files is written by hand; a test compares both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pages.commit import ROOT
from pages.records import DOCS, GOALS, RECORDS, read_records
from pages.tables import table

README, FILMING = ROOT / "README.md", DOCS / "filming.md"
END = "<!-- end of the headline -->"


@dataclass(frozen=True)
class Headline:
    """One table of another page."""

    page: str
    parts: tuple[str, ...]
    """Whose tables are shown as one."""
    caption: str
    says: str = ""
    columns: tuple[str, ...] = ()
    """Those that are shown; all where none is named."""
    rows: Mapping[str, str] = field(default_factory=dict)
    """Column -> regular expression that its cells begin with in the rows that are shown."""


PEERS = (
    Headline(
        "paper", ("paper",), "Against the paper",
        "From the pixels of three rendered scenes that stand for the paper's real ones. The intrinsics and people's mean "
        "height are known, and nothing else unless a column says so; errors are given with the estimated scale:",
    ),
    Headline(
        "peers", ("engines",), "Summary",
        "Compared with current engines on the same observations, with known identities (*mm ratio*, *whole ratio*: Passerby's "
        "error and its time divided by theirs):",
        columns=("peer", "cases", "fails", "Passerby fails", "Passerby lower, mm", "mm ratio", "whole ratio"),
    ),
)  # fmt: skip
UNKNOWN_LENSES = Headline(
    "lenses", ("varied", "shared", "keypoints", "mixed", "demo"), "Cost",
    "Without intrinsics, simulated scenes of a minute, identities unknown: errors of points that several cameras see, and of "
    "positions on the ground from one camera, with the true intrinsics → with estimated ones:",
    columns=("case", "points", "ground", "rig, estimated"),
    rows={"case": "(boxes, .*unknown|boxes and keypoints, .*unknown|the demonstration)"},
)  # fmt: skip
COST = ("case", "points", "ground", "focal, median", "rig, true intrinsics", "rig, estimated")
SPREAD = ("similarity, median", "worst seed", "verdicts")
"""Columns of a sweep."""
SHOWN: Mapping[Path, Mapping[str, tuple[Headline, ...]]] = {
    README: {
        "lenses": (replace(UNKNOWN_LENSES, rows={"case": "(boxes, (each|one).*unknown|boxes and keypoints, .*unknown)"}),),
        "headline": PEERS,
    },
    FILMING: {
        "seconds": (Headline("seconds", ("seconds",), "terrace", columns=("seconds", *SPREAD)),),
        "people": (Headline("people", ("people",), "terrace", columns=("people", *SPREAD), rows={"method": "people"}),),
        "pattern": (replace(UNKNOWN_LENSES, says="", columns=COST),),
        "scale": (
            Headline(
                "scale", ("nobody", "person", "plan", "length", "upper"), GOALS, columns=("case", "measured"),
                rows={"case": "(nobody known, boxes|one person, boxes|one person, keypoints|a plan|one marked).* median"},
            ),
        ),
    },
}  # fmt: skip
"""The tables of each file, between the markers of a name."""


def begin(name: str) -> str:
    """The marker above the tables of a name."""
    return f"<!-- {name}: written by benchmarks/headline.py -->"


def headlines(file: Path, name: str, records: Path = RECORDS) -> str:
    """The text between the markers of a name in a file. Raises `ValueError` where a record lacks what is shown."""
    parts = []
    for headline in SHOWN[file][name]:
        known = read_records(records, headline.page)
        shown = [known[part] for part in headline.parts if part in known and headline.caption in known[part].found.tables]
        if not shown:
            raise ValueError(f"no table {headline.caption!r} in the records of {headline.page}")
        whole = [one.found.tables[headline.caption] for one in shown]
        # Parts of different age may have other columns beside those that are shown.
        columns = list(dict.fromkeys((*headline.columns, *headline.rows))) if headline.columns else []
        whole = [one.choose(columns) for one in whole]
        joined = table(whole[0].head, [row for one in whole for row in one.rows])
        link = (DOCS / "results").relative_to(file.parent).as_posix()
        source = f"By `{shown[0].command}`: [{headline.page}]({link}/{headline.page}.md)."
        parts += [headline.says, str(joined.choose(headline.columns, headline.rows)), source]
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
