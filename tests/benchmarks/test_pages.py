"""Records of runs, and the pages that are rendered from them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import local_page_page
import scale_page
import sites_page
import sources_page
from pages import records, render
from pages.parts import PartedPage
from pages.records import GOALS, Found, Output, page_path, publish, read_records
from pages.tables import WIDEST, table


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Sets the commit that the run is of."""
    return lambda commit: monkeypatch.setattr(records, "commit", lambda: f"`{commit}`")


@pytest.fixture
def templates(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The folder of the templates."""
    folder = tmp_path / "templates"
    folder.mkdir()
    monkeypatch.setattr(render, "TEMPLATES", folder)
    return folder


@pytest.mark.parametrize("page", render.page_names())
def test_pages_are_those_of_the_records(page: str) -> None:
    assert page_path(page).read_text(encoding="utf-8") == render.render(page), "run `make pages`"


def test_each_page_has_a_template_and_each_record_a_page() -> None:
    pages = {path.stem for path in (records.DOCS / "results").glob("*.md")} | {records.RELIABILITY}
    assert pages == set(render.page_names())
    assert {path.parent.name for path in records.RECORDS.rglob("*.json")} < pages


@pytest.mark.parametrize(
    "page", [local_page_page.PAGE, scale_page.PAGE, sites_page.PAGE, sources_page.page()], ids=lambda page: page.name
)
def test_pages_of_parts_have_all_their_parts(page: PartedPage) -> None:
    template = (render.TEMPLATES / f"{page.name}.md").read_text()
    assert all(f"{{{{ {part}" in template for part in page.parts)
    assert "Not run" not in render.render(page.name)


def test_each_part_keeps_the_commit_that_it_was_run_on(named: Callable[[str], None], templates: Path, tmp_path: Path) -> None:
    (templates / "two.md").write_text("# Two\n\n## A\n\n{{ a }}\n\n## B\n\n{{ b }}\n")
    one = Found({"": table(["x"], [["1"]])}, ["A note."], "3 of 3 cases")
    named("first")
    publish("two", "a", one, tmp_path, "python run.py")
    assert "Not run" in (tmp_path / "two.md").read_text()
    named("second")
    publish("two", "b", [Found(), one], tmp_path, "python run.py")
    text = (tmp_path / "two.md").read_text()
    a, b = text.split("## B")
    assert "Code of commit `first`, 20" in a
    assert "3 of 3 cases." in a
    assert "A note." in a
    assert "Code of commit `second`, 20" in b
    assert "code of commits `first`, `second`, on: " in text.splitlines()[-1]
    assert text.splitlines()[-1].startswith("Written by `python run.py`, ")


def test_a_run_that_is_only_printed_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    publish("two", "a", Found({"Caption": table(["x"], [["1"]])}), tmp_path, "python run.py", written=False)
    assert "Caption:\n\n| x   |" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_a_record_is_read_as_it_was_written(templates: Path, tmp_path: Path) -> None:
    tables = {"C": table(["a", "b"], [["1", "a \\| b"], ["2", ""]]), GOALS: table(["g"], [["yes"]]), "E": table(["e"], [])}
    found = Found(tables, ("n",))
    publish("page", "part", found, tmp_path, "python run.py", code="abc", quick=True)
    record = read_records(tmp_path / "records", "page")["part"]
    assert record.found == found
    assert (record.command, record.code, record.quick) == ("python run.py", "abc", True)
    text = (tmp_path / "page.md").read_text()
    assert "A quick run" in text
    assert "yes" not in text, "goals are shown where a template asks for them"


def test_tables_are_chosen_and_joined(templates: Path, tmp_path: Path) -> None:
    (templates / "page.md").write_text("{{ all: T | x | y = b }}\n{{ a.run }} {{ b.run }}\n\n{{ a: T | y }}\n")
    for part, rows in (("a", [["1", "a"], ["2", "b"]]), ("b", [["3", "b"]])):
        publish("page", part, Found({"T": table(["x", "y"], rows)}), tmp_path, "python run.py")
    text = (tmp_path / "page.md").read_text()
    assert text.startswith("| x   |\n|-----|\n| 2   |\n| 3   |\n")
    assert "| y   |\n|-----|\n| a   |\n| b   |" in text
    (templates / "page.md").write_text("{{ a: U }}\n")
    with pytest.raises(ValueError, match="a: U"):
        render.render("page", tmp_path / "records")


def test_a_table_without_what_is_chosen_is_an_error() -> None:
    whole = table(["x", "y"], [["1", "one"], ["2", "two"]])
    with pytest.raises(ValueError, match="no row"):
        whole.choose(rows={"y": "three"})
    with pytest.raises(ValueError, match="2 columns are named 'x'"):
        table(["x", "x"], []).choose(["x"])
    twice = table(["x", "x"], [["1", "2"]])
    assert twice.choose() == twice
    assert str(whole.choose(["y"], {"x": "2"})) == "| y   |\n|-----|\n| two |"


def test_runs_for_the_documentation_write_the_records_of_the_repository(tmp_path: Path) -> None:
    for out in (None, records.DOCS / "results"):
        assert Output.of("scale", out) == Output(records.RECORDS, records.DOCS / "results")
    assert Output.of("reliability", None) == Output(records.RECORDS, records.DOCS)
    assert Output.of("scale", tmp_path) == Output(tmp_path / "records", tmp_path)


def test_wide_columns_are_not_padded() -> None:
    lines = str(table(("a", "b"), [("x", "y"), ("w" * 200, "z")])).splitlines()
    assert lines[2] == f"| x{' ' * (WIDEST - 1)} | y   |"
    assert lines[3] == f"| {'w' * 200} | z   |"
