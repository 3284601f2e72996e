"""The page of formats has what the registry holds, and the registry what the commands take."""

from types import ModuleType

import pytest

from passerby.cli.main import run
from passerby.interchange.formats import all_formats

FORMATS = list(all_formats())


def test_the_command_prints_what_the_page_has(reference: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    page = reference.pages()["formats.md"]
    assert run(["formats", "--markdown"]) == 0
    assert capsys.readouterr().out in page
    assert all(f"## {form.name}\n" in page for form in FORMATS)


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_a_format_says_what_it_is(form):
    assert form.write or form.read or form.read_people
    assert form.title
    assert form.tools
    assert len(form.conventions) > 60
    assert all(suffix.startswith(".") for suffix in form.suffixes)
    assert "\n" not in form.title + form.conventions
