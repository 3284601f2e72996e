"""Pages of results name the commit that they were made on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pages.page import FOOT, WIDEST, Page, signed, table, write_page
from pages.sections import Found, Heading, SectionedPage, sections_on


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Sets the commit that the run is of."""

    def name(commit: str) -> None:
        for module in ("page", "sections"):
            monkeypatch.setattr(f"pages.{module}.commit", lambda: f"`{commit}`")

    return name


def test_the_foot_names_the_commit_unless_the_text_does(named: Callable[[str], None]) -> None:
    named("c0ffee")
    foot = signed(Page("one", "# One\n"), "python run.py").split(FOOT)[1]
    assert foot.startswith("python run.py`, code of commit `c0ffee`, on: ")
    assert "c0ffee" not in signed(Page("one", "# One\n", commit_in_text=True), "python run.py")


def test_each_part_keeps_the_commit_that_it_was_run_on(named: Callable[[str], None], tmp_path: Path) -> None:
    sections = SectionedPage("two", "# Two", {"a": Heading("A"), "b": Heading("B")}, "digest")
    named("first")
    (before,) = sections.grow({"a": lambda: [Found("1")]}, {})
    named("second")
    (after,) = sections.grow({"b": lambda: [Found("2")]}, sections_on(write_page(before, tmp_path, "python run.py")))
    a, b = after.text.split("## B")
    assert "code of commit `first`." in a
    assert "code of commit `second`." in b
    assert after.commit_in_text


def test_pages_of_a_part_are_written_with_it_and_stay_without_it(tmp_path: Path) -> None:
    sections = SectionedPage("two", "# Two", {"a": Heading("A"), "b": Heading("B")}, "digest", timed=False)
    (first,) = sections.grow({"a": lambda: [Found("1", further=(Page("more/cases", "# Cases"),))]}, {})
    path = write_page(first, tmp_path, "python run.py")
    cases = tmp_path / "more" / "cases.md"
    assert cases.read_text().startswith(f"# Cases\n\n{FOOT}python run.py`, code of commit")
    cases.write_text("as it was")
    (second,) = sections.grow({"b": lambda: [Found("2")]}, sections_on(path))
    write_page(second, tmp_path, "python run.py")
    assert "1" in second.text
    assert cases.read_text() == "as it was"


def test_wide_columns_are_not_padded() -> None:
    lines = table(("a", "b"), [("x", "y"), ("w" * 200, "z")]).splitlines()
    assert lines[2] == f"| x{' ' * (WIDEST - 1)} | y   |"
    assert lines[3] == f"| {'w' * 200} | z   |"
