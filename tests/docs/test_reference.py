"""The pages of reference are what the code says: settings, commands, formats, messages and keys of `calibration.json`."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from passerby.cli.main import run
from passerby.findings.texts import KINDS
from passerby.interchange.formats import all_formats
from support.documentation import DOCS


def test_the_committed_page_is_what_the_code_says(reference: ModuleType) -> None:
    assert [path.name for path in (DOCS / "reference").iterdir()] == [reference.COMMITTED]
    written = (DOCS / "reference" / reference.COMMITTED).read_text(encoding="utf-8")
    assert written == reference.pages()[reference.COMMITTED], "the code has changed: run `python docs/make_reference.py`"


def test_every_row_has_a_meaning_and_every_key_and_option_is_there(reference: ModuleType) -> None:
    pages = reference.pages()
    for name in ("scene-file.md", "commands.md", "findings.md"):
        rows = [line for line in pages[name].splitlines() if line.startswith("| `")]
        assert len(rows) > 30
        assert [row for row in rows if row.rsplit("|", 2)[1].strip() == ""] == []
    assert "| `--out`, `-o` | path | `out` |" in pages["commands.md"]
    assert "## passerby models fetch { #passerby-models-fetch }" in pages["commands.md"]
    assert (
        "| `fps` | number, above 0 |  | Frames processed per second of video. Not given: 5, and more" in pages["scene-file.md"]
    )


PAGE = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
WITHOUT_CODES = {"verdict", "bad-input", "more"}
"""Sections that are about no finding."""


def test_every_code_has_one_section_and_stands_in_its_list_only(reference: ModuleType) -> None:
    listed = Counter(code for cause in reference.causes() for code in cause.codes)
    assert {code for code, times in listed.items() if times > 1} == set()
    assert set(KINDS) - set(listed) == set(), "list these codes at the end of a section of docs/troubleshooting.md"
    assert set(listed) - set(KINDS) == set(), "docs/troubleshooting.md lists codes that do not exist"
    assert sum(len(re.findall(rf"`{code}`", PAGE)) for code in KINDS) == sum(len(one.codes) for one in reference.causes())


def test_every_section_has_an_anchor_advice_and_a_row_in_the_table_at_the_top(reference: ModuleType) -> None:
    anchors = re.findall(r"^## .* \{ #([\w-]+) \}$", PAGE, flags=re.MULTILINE)
    assert len(anchors) == len(re.findall(r"^## ", PAGE, flags=re.MULTILINE)) > 10
    assert {cause.anchor for cause in reference.causes()} == set(anchors) - WITHOUT_CODES
    for part in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]:
        title, _, advice = re.sub(r"^Codes?: [^.]*\.$", "", part, flags=re.MULTILINE).partition("\n")
        assert len(advice.split()) > 40, title
    table = re.findall(r"^\| .*\(#([\w-]+)\) \|$", PAGE, flags=re.MULTILINE)
    assert table == [cause.anchor for cause in reference.causes()]
    assert len(PAGE.split()) <= 4000, "a page that is longer is not read"


@pytest.mark.parametrize("code", KINDS)
def test_the_page_of_messages_has_the_sentences_of_a_code_below_its_cause(reference: ModuleType, code: str) -> None:
    (cause,) = [one for one in reference.causes() if code in one.codes]
    below = reference.findings_page().split(f"(../troubleshooting.md#{cause.anchor})")[1].split("\n## ")[0]
    (row,) = [line for line in below.splitlines() if line.startswith(f"| `{code}`<br>")]
    assert reference.examples()[code]
    for sentence in reference.examples()[code]:
        words = max(re.split(r"[*<\\|\n]", sentence), key=len)
        assert " ".join(words.split()) in row


def test_the_command_prints_what_the_page_has(reference: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    page = reference.pages()["formats.md"]
    assert run(["formats", "--markdown"]) == 0
    assert capsys.readouterr().out in page
    assert all(f"## {form.name}\n" in page for form in all_formats())


def test_a_format_says_what_it_is():
    for form in all_formats():
        assert form.write or form.read or form.read_people
        assert form.title
        assert form.tools
        assert len(form.conventions) > 60
        assert all(suffix.startswith(".") for suffix in form.suffixes)
        assert "\n" not in form.title + form.conventions


NAMES = ("C1", "C2", "C3")
ELSEWHERE = {"scene": "reference/scene-file.md", "options": "reference/scene-file.md", "association": "association.md"}
"""Which page tells of the keys below these."""


def keys_below(value: Any, page: str = "output.md") -> Iterator[tuple[str, str]]:
    """(page, key) of all tables below a value; names of cameras, libraries, files and people are no keys.

    The values of a diagnostic are its code's own.
    """
    if isinstance(value, list):
        for item in value:
            yield from keys_below(item, page)
    if isinstance(value, dict):
        for key, item in value.items():
            if key not in NAMES and not key.isdigit():
                yield page, key
            if key not in ("versions", "files", "values"):
                yield from keys_below(item, ELSEWHERE.get(key, page))


@pytest.mark.evidence
def test_every_key_is_explained(prepared: Callable[[str], Path]) -> None:
    told = json.loads((prepared("calibrated") / "out" / "calibration.json").read_text())
    explained = {
        page: set(re.findall(r"`\[?(\w+)\]?`", (DOCS / page).read_text())) for page in ("output.md", *ELSEWHERE.values())
    }
    explained["reference/scene-file.md"] |= {"scene", "cameras", "association", "solver", "scale", "perception", "world"}
    assert len(told) > 10
    assert [place for place in keys_below(told) if place[1] not in explained[place[0]]] == []
