"""The pages of reference are what the code says, and nothing in them lacks a reason."""

from __future__ import annotations

from types import ModuleType

import pytest

from support.documentation import DOCS


def test_the_committed_page_is_what_the_code_says(reference: ModuleType) -> None:
    assert [path.name for path in (DOCS / "reference").iterdir()] == [reference.COMMITTED]
    written = (DOCS / "reference" / reference.COMMITTED).read_text(encoding="utf-8")
    assert written == reference.pages()[reference.COMMITTED], "the code has changed: run `python docs/make_reference.py`"


@pytest.mark.parametrize("name", ["scene-file.md", "commands.md", "findings.md"])
def test_everything_has_a_meaning(reference: ModuleType, name: str) -> None:
    rows = [line for line in reference.pages()[name].splitlines() if line.startswith("| `")]
    assert len(rows) > 30
    assert [row for row in rows if row.rsplit("|", 2)[1].strip() == ""] == []


def test_every_key_and_a_known_option_are_there(reference: ModuleType) -> None:
    page = reference.pages()["commands.md"]
    assert "| `--out`, `-o` | path | `out` |" in page
    assert "## passerby models fetch { #passerby-models-fetch }" in page
    keys = reference.pages()["scene-file.md"]
    assert "| `fps` | number, above 0 |  | Frames processed per second of video. Not given: 5, and more" in keys
