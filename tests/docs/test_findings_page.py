"""The page of troubleshooting has a section for every finding, and the page of all messages leads to it."""

from __future__ import annotations

import re
from collections import Counter
from types import ModuleType

import pytest

from passerby.findings.texts import KINDS
from support.documentation import DOCS

PAGE = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
MOST_WORDS = 4000
"""A page that is longer is not read."""
WITHOUT_CODES = {"verdict", "bad-input", "more"}
"""Sections that are about no finding."""


def test_every_code_has_one_section(reference: ModuleType) -> None:
    listed = Counter(code for cause in reference.causes() for code in cause.codes)
    assert {code for code, times in listed.items() if times > 1} == set()
    assert set(KINDS) - set(listed) == set(), "list these codes at the end of a section of docs/troubleshooting.md"
    assert set(listed) - set(KINDS) == set(), "docs/troubleshooting.md lists codes that do not exist"


def test_every_section_has_an_anchor_advice_and_codes(reference: ModuleType) -> None:
    anchors = re.findall(r"^## .* \{ #([\w-]+) \}$", PAGE, flags=re.MULTILINE)
    assert len(anchors) == len(re.findall(r"^## ", PAGE, flags=re.MULTILINE)) > 10
    assert {cause.anchor for cause in reference.causes()} == set(anchors) - WITHOUT_CODES
    for part in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]:
        title, _, advice = re.sub(r"^Codes?: [^.]*\.$", "", part, flags=re.MULTILINE).partition("\n")
        assert len(advice.split()) > 40, title


def test_no_code_stands_outside_the_lists_at_the_ends(reference: ModuleType) -> None:
    assert sum(len(re.findall(rf"`{code}`", PAGE)) for code in KINDS) == sum(len(one.codes) for one in reference.causes())


def test_the_table_at_the_top_leads_to_every_section(reference: ModuleType) -> None:
    table = re.findall(r"^\| .*\(#([\w-]+)\) \|$", PAGE, flags=re.MULTILINE)
    assert table == [cause.anchor for cause in reference.causes()]


def test_the_page_is_short() -> None:
    assert len(PAGE.split()) <= MOST_WORDS


@pytest.mark.parametrize("code", KINDS)
def test_the_page_of_messages_has_the_sentences_of_a_code_below_its_cause(reference: ModuleType, code: str) -> None:
    (cause,) = [one for one in reference.causes() if code in one.codes]
    below = reference.findings_page().split(f"(../troubleshooting.md#{cause.anchor})")[1].split("\n## ")[0]
    (row,) = [line for line in below.splitlines() if line.startswith(f"| `{code}`<br>")]
    assert reference.examples()[code]
    for sentence in reference.examples()[code]:
        words = max(re.split(r"[*<\\|\n]", sentence), key=len)
        assert " ".join(words.split()) in row
