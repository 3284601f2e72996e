"""Pages rendered from templates and records: `templates/NAME.md` has the text, and lines that are replaced by figures.

    {{ all: CAPTION }}                              the tables of this caption of all parts that the template names, as one
    {{ PART }}                                      the run, all tables and the notes of a part
    {{ PART.run }}, {{ PART.notes }}                the commit and size of its run; its notes
    {{ PART: CAPTION }}                             one table
    {{ PART: CAPTION | COLUMN; ... | COLUMN = REGEX }}    some columns, and the rows whose cells begin so

A part of another page is named PAGE/PART.
"""

from __future__ import annotations

import re
from pathlib import Path

from pages.records import RECORDS, Output, Record, page_path, read_record, record_path
from pages.tables import Table, table
from passerby.interchange.storage.atomic import write_text

TEMPLATES = Path(__file__).with_name("templates")
FOOT = "Written by `"
"""Begins the last paragraph of a page."""
NOT_RUN = "*Not run.*"
ALL = "all"
_HOLE = re.compile(r"\{\{ (?P<part>[\w/-]+)(?:\.(?P<what>run|notes)|: (?P<table>[^|}]+?)(?: \| (?P<chosen>.+?))?)? \}\}")


def page_names() -> list[str]:
    """All pages that have a template."""
    return sorted(path.stem for path in TEMPLATES.glob("*.md"))


def write_pages() -> None:
    """Write all pages of the documentation anew."""
    for page in page_names():
        write_page(page, Output(RECORDS, page_path(page).parent))


def write_page(page: str, output: Output) -> Path:
    """Write a page, and return its path. Raises `ValueError` where a record lacks a table that the template names."""
    path = output.pages / f"{page}.md"
    write_text(path, render(page, output.records))
    return path


def render(page: str, records: Path = RECORDS) -> str:
    """The Markdown of a page."""
    template = _template(page, records)
    names = list(dict.fromkeys(hole["part"] for hole in _HOLE.finditer(template) if hole["part"] != ALL))
    known = {name: read_record(record_path(records, *_place(page, name))) for name in names}
    found = {name: record for name, record in known.items() if record is not None}

    def fill(hole: re.Match[str]) -> str:
        name = hole["part"]
        if name == ALL:
            tables = [one for record in found.values() if (one := record.found.tables.get(hole["table"])) is not None]
            chosen = [_chosen(one, hole["chosen"] or "") for one in tables]
            return str(table(chosen[0].head, [row for one in chosen for row in one.rows])) if chosen else NOT_RUN
        record = found.get(name)
        if record is None:
            return NOT_RUN
        if hole["table"] is None:
            shown = {"run": run_text, "notes": lambda one: "\n\n".join(one.found.notes), None: part_text}
            return shown[hole["what"]](record)
        try:
            return str(_chosen(record.found.tables[hole["table"]], hole["chosen"] or ""))
        except (KeyError, ValueError) as error:
            raise ValueError(f"{page}, {hole[0]}: {error}") from None

    return f"{_HOLE.sub(fill, template).rstrip()}\n\n{_foot(list(found.values()))}\n"


def _template(page: str, records: Path) -> str:
    """The template of a page; one without has all that its records have."""
    path = TEMPLATES / f"{page}.md"
    if path.is_file():
        return path.read_text(encoding="utf-8")
    return "\n\n".join([f"# {page}", *(f"{{{{ {one.stem} }}}}" for one in sorted((records / page).glob("*.json")))])


def _place(page: str, name: str) -> tuple[str, str]:
    other, _, part = name.rpartition("/")
    return other or page, part


def _chosen(whole: Table, chosen: str) -> Table:
    """Of a table, the columns and rows that a template asks for."""
    asked = {" = " in one: one.split("; ") for one in chosen.split(" | ") if one}
    pairs = [rule.partition(" = ") for rule in asked.get(True, ())]
    return whole.choose(asked.get(False, ()), {column: rule for column, _, rule in pairs})


def run_text(record: Record) -> str:
    """The commit, the date and the size of a run."""
    quick = " A quick run: too few cases for conclusions." if record.quick else ""
    more = f" {record.found.run}." if record.found.run else ""
    return f"*Code of commit {record.commit}, {record.date}.{more}{quick}*"


def part_text(record: Record) -> str:
    """The run, the tables with their captions, and the notes of a part."""
    return f"{run_text(record)}\n\n{record.found.text}".rstrip()


def _foot(records: list[Record]) -> str:
    """The command, the commits and the machine of a page."""
    if not records:
        return "Not run."
    newest = max(records, key=lambda record: record.date)
    commits = list(dict.fromkeys(record.commit for record in records))
    named = f"commit{'s' * (len(commits) > 1)} {', '.join(commits)}"
    return f"{FOOT}{newest.command}`, code of {named}, on: {newest.machine}"
