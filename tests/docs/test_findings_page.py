"""Every code of a finding has an entry on the page of troubleshooting, in the words that Passerby prints."""

from __future__ import annotations

import re

import pytest

from passerby.findings.texts import KINDS
from support.documentation import DOCS

PAGE = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")


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


def test_every_code_is_documented_and_no_other() -> None:
    assert documented() == set(KINDS)


@pytest.mark.parametrize("code", [code for code, kind in KINDS.items() if isinstance(kind.problem, str)])
def test_the_page_has_the_words_that_are_printed(code: str) -> None:
    kind, page = KINDS[code], evened(PAGE)
    assert isinstance(kind.problem, str)
    assert longest_words(kind.problem) in page
    assert not isinstance(kind.remedy, str) or longest_words(kind.remedy) in page
