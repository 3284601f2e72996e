"""The page of formats tells what the registry holds, and the registry what the commands take."""

import importlib.util

import pytest

from passerby.cli.main import run
from passerby.interchange.formats import all_formats
from support.paths import DOCS

FORMATS = list(all_formats())


def test_the_page_is_what_the_registry_holds():
    spec = importlib.util.spec_from_file_location("make_formats", DOCS / "make_formats.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    text = (DOCS / "formats.md").read_text(encoding="utf-8")
    assert made.page(text) == text, "run docs/make_formats.py"


def test_the_command_prints_what_the_page_has(capsys):
    assert run(["formats", "--markdown"]) == 0
    assert capsys.readouterr().out in (DOCS / "formats.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_a_format_says_what_it_is(form):
    assert form.write or form.read or form.read_people
    assert form.title
    assert form.tools
    assert len(form.conventions) > 60
    assert all(suffix.startswith(".") for suffix in form.suffixes)
    assert "\n" not in form.title + form.conventions
