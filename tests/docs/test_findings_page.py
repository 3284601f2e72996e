"""Every code of a finding has an entry on the page of troubleshooting, in the words that Passerby prints."""

from __future__ import annotations

import json
import re

import pytest

from passerby.findings.finding import Finding
from passerby.findings.texts import KINDS, problem_of
from support.documentation import DOCS, ROOT

PAGE = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
EXAMPLES = [
    Finding.of_value(one)
    for one in json.loads((ROOT / "tests" / "findings" / "finding_texts.json").read_text(encoding="utf-8"))
]
"""Findings with pinned sentences."""
CAMERAS_AND_FIGURES = r"(?:\bC\d\b(?:, )?)+|[-+]?\d[\d.]*"


def documented() -> set[str]:
    """The codes that stand below the entries."""
    below = re.findall(r"^Codes?: (`\w+`(?:,\s`\w+`)*)\.$", PAGE, flags=re.MULTILINE)
    return {code for line in below for code in re.findall(r"\w+", line)}


def evened(text: str) -> str:
    """Text without the marks that a page adds: quotes of several lines, code, italics."""
    return " ".join(re.sub(r"^> ?", "", text, flags=re.MULTILINE).replace("`", "").replace("*", "").split())


def longest_words(template: str) -> str:
    """The longest part of a template that no value stands in."""
    return evened(max(re.split(r"\{[^}]*\}", template), key=len)).strip(" :;,.()[]'\"")


def longest_fixed_words(finding: Finding) -> str:
    """The longest part of a sentence between the values in it, remedy aside."""
    texts = [evened(value) for value in finding.values.values() if isinstance(value, str)]
    values = "|".join([*map(re.escape, texts), CAMERAS_AND_FIGURES])
    return max(re.split(values, evened(problem_of(finding))), key=len).strip(" :;,.()[]'\"")


def test_every_code_is_documented_and_no_other() -> None:
    assert documented() == set(KINDS)


@pytest.mark.parametrize("code", [code for code, kind in KINDS.items() if isinstance(kind.problem, str)])
def test_the_page_has_the_words_that_are_printed(code: str) -> None:
    kind, page = KINDS[code], evened(PAGE)
    assert isinstance(kind.problem, str)
    assert longest_words(kind.problem) in page
    assert not isinstance(kind.remedy, str) or longest_words(kind.remedy) in page


@pytest.mark.parametrize("code", [code for code, kind in KINDS.items() if not isinstance(kind.problem, str)])
def test_the_page_has_the_words_of_a_sentence_that_a_function_makes(code: str) -> None:
    page = evened(PAGE)
    longest = [longest_fixed_words(finding) for finding in EXAMPLES if finding.code == code]
    assert any(words in page for words in longest), longest
