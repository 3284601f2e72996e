"""`docs/check_words.py` finds the turns that are not used in pages, sentences of the code, and names; `make lint` runs it."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from support.documentation import DOCS

MODULE = '''"""Whoever reads this

stumbles beyond
doubt."""


def hardly(x: float) -> str:
    # Nobody calls it.
    told = f"{x} rests on `nobody` and {x}"
    return told
'''


@pytest.fixture(scope="module")
def words() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_words", DOCS / "check_words.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_turns_of_a_module_are_found_at_their_lines(words: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(MODULE)
    found = sorted((line, turn.lower()) for line, turn, _ in words.check_module(path))
    assert found == [(1, "whoever"), (3, "beyond doubt"), (7, "hardly"), (8, "nobody"), (9, "rests on")]


def test_code_and_written_tables_of_a_page_are_not_checked(words: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    table = "<!-- scale: written by benchmarks/headline.py -->\n| nobody |\n<!-- end of the headline -->\n"
    path.write_text(f"`nobody`\n\n```sh\nnobody\n```\n\n{table}\nIt was told.\n")
    assert [(line, turn) for line, turn, _ in words.check_page(path)] == [(11, "told")]
