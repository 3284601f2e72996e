"""Records of the runs: one JSON file for each part of a page, from which the pages are rendered."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pages.commit import ROOT, commit
from pages.tables import Table, machine_note, table
from passerby.interchange.storage.atomic import write_bytes, write_text

RECORDS, DOCS = ROOT / "benchmarks" / "records", ROOT / "docs"
GOALS = "Goals"
RELIABILITY = "reliability"
"""The one page that lies in `docs` itself; all others are in `docs/results`."""


@dataclass(frozen=True)
class Found:
    """What a part of a page has found so far."""

    tables: Mapping[str, Table] = field(default_factory=dict)
    """By caption; `GOALS` is shown with the goals of the page's other parts."""
    notes: Sequence[str] = ()
    """Markdown: figures that are in no table."""
    run: str = ""
    """How much was run, and how long it took."""
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    """Pictures of the page by file name, which begins with the page's own."""

    @property
    def goals(self) -> list[list[str]]:
        """The rows of its goals."""
        return self.tables[GOALS].rows if GOALS in self.tables else []

    @property
    def text(self) -> str:
        """Markdown of its tables with their captions, without the goals, and of its notes."""
        tables = [f"{caption}:\n\n{one}" for caption, one in self.tables.items() if caption != GOALS]
        return "\n\n".join([*tables, *self.notes])


@dataclass(frozen=True)
class Record:
    """What a part found, and where it was run."""

    found: Found
    commit: str
    """With a remark where something was not committed."""
    date: str
    """Of the run, UTC."""
    command: str
    """That runs the part."""
    machine: str
    """With the versions of Python and the libraries."""
    code: str = ""
    """Digest of the code that the figures depend on."""
    quick: bool = False
    """Whether only a few cases were run."""


@dataclass(frozen=True)
class Output:
    """The folders of a run: its records, and the page with its pictures."""

    records: Path
    pages: Path

    @classmethod
    def of(cls, page: str, out: Path | None) -> Output:
        """Those of the repository; or all below `out`, unless that is a folder of the documentation."""
        if out is None or out.resolve() in (DOCS, DOCS / "results"):
            return cls(RECORDS, page_path(page).parent)
        return cls(out / "records", out)


def page_path(page: str) -> Path:
    """Where a page of the documentation lies."""
    return DOCS / f"{page}.md" if page == RELIABILITY else DOCS / "results" / f"{page}.md"


def record_path(records: Path, page: str, part: str) -> Path:
    """Where the record of a part lies."""
    return records / page / f"{part}.json"


def write_record(path: Path, record: Record) -> None:
    """Write a record. Raises `InputError` where the folder is not writable."""
    found = record.found
    content: dict[str, Any] = {
        "commit": record.commit, "date": record.date, "command": record.command, "machine": record.machine,
        "code": record.code, "quick": record.quick, "run": found.run, "notes": list(found.notes),
        "tables": {caption: _plain(one) for caption, one in found.tables.items()},
    }  # fmt: skip
    write_text(path, _json(content) + "\n")


def _plain(one: Table) -> dict[str, Any]:
    return {"head": one.head, "rows": one.rows}


def _json(value: Any, indent: str = "") -> str:
    """JSON with a line for each row of a table."""
    if isinstance(value, dict):
        lines = [f"{indent} {json.dumps(key)}: {_json(item, indent + ' ')}" for key, item in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}" if lines else "{}"
    if isinstance(value, list) and any(isinstance(item, list) for item in value):
        return "[\n" + ",\n".join(f"{indent} {json.dumps(item, ensure_ascii=False)}" for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False)


def read_record(path: Path) -> Record | None:
    """A record; None where the part was never run."""
    if not path.is_file():
        return None
    content = json.loads(path.read_text(encoding="utf-8"))
    tables = {caption: table(one["head"], one["rows"]) for caption, one in content["tables"].items()}
    found = Found(tables, tuple(content["notes"]), content["run"])
    return Record(found, *(content[key] for key in ("commit", "date", "command", "machine", "code", "quick")))


def read_records(records: Path, page: str) -> dict[str, Record]:
    """All records of a page by part."""
    found = {path.stem: read_record(path) for path in sorted((records / page).glob("*.json"))}
    return {part: record for part, record in found.items() if record is not None}


def publish(
    page: str, part: str, found: Found | Iterable[Found], out: Path | None, command: str, *, code: str = "",
    quick: bool = False, written: bool = True,
) -> None:  # fmt: skip
    """Write the record and the page each time that more is found, and print the tables at the end.

    Args:
        page: its name.
        part: of the page; other parts keep their records.
        found: the part, or the part again and again as it grows.
        out: see `Output.of`.
        command: that runs the part.
        code: digest of the code that the figures depend on.
        quick: whether only a few cases were run.
        written: False: the tables are printed only.

    Raises:
        InputError: a folder is not writable.
    """
    from pages.render import part_text, write_page

    name, record = commit(), None
    for one in [found] if isinstance(found, Found) else found:
        record = Record(one, name, f"{datetime.now(UTC):%Y-%m-%d}", command, machine_note(), code, quick)
        if written:
            output = Output.of(page, out)
            for file, content in one.files.items():
                write_bytes(output.pages / file, content if isinstance(content, bytes) else content.encode("utf-8"))
            write_record(record_path(output.records, page, part), record)
            write_page(page, output)
    if record is not None:
        print(part_text(record), flush=True)
