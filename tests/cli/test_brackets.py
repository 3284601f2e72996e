"""Text in square brackets, as "[scale]", reaches the terminal whole: in every help page, finding, note and table."""

from __future__ import annotations

import inspect
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from rich.console import Console
from typer.models import ArgumentInfo, OptionInfo

from passerby.cli import terminal
from passerby.cli.main import app, run
from passerby.cli.terminal import show_table, stages
from passerby.common.progress import tell_note

EXAMPLES = json.loads((Path(__file__).parents[1] / "findings" / "finding_texts.json").read_text(encoding="utf-8"))
AWKWARD = "[cameras.C1] [/] [bold] :car: [[scale.lengths]]"


def commands(group: typer.Typer = app, path: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Callable[..., Any]]]:
    """The words and the function of every command."""
    registered = [one for one in group.registered_commands if one.callback is not None]
    found = [((*path, one.name or one.callback.__name__.rstrip("_")), one.callback) for one in registered]
    for below in group.registered_groups:
        found += commands(below.typer_instance, (*path, str(below.name)))
    return found


def bracketed(text: str) -> list[str]:
    return re.findall(r"\[+[^\[\]]*\]+", text)


@pytest.fixture
def wide_terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    shown = io.StringIO()
    monkeypatch.setattr(
        terminal, "Console", lambda **_: Console(file=shown, force_terminal=True, width=1000, no_color=True, highlight=False)
    )
    return shown


@pytest.mark.parametrize("words", [words for words, _ in commands()], ids=" ".join)
def test_help_shows_all_that_is_in_brackets(words, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    assert run([*words, "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    function = dict(commands())[words]
    texts = [inspect.getdoc(function) or ""]
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        about = next((one for one in getattr(parameter.annotation, "__metadata__", ()) if hasattr(one, "help")), None)
        assert about is None or isinstance(about, ArgumentInfo | OptionInfo)
        texts.append((about and about.help) or "")
    for text in bracketed(" ".join(" ".join(texts).split())):
        assert text.replace(" ", "") in shown.replace(" ", "")


def test_the_list_of_commands_cuts_no_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert bracketed(" ".join(inspect.getdoc(function) or "" for _, function in commands()))
    assert run(["--help"]) == 0
    shown = capsys.readouterr().out
    assert "a table [recording]." in " ".join(shown.split())
    assert "...\n" not in shown.partition("Commands:")[2]


def test_findings_and_tables_reach_a_terminal_whole(wide_terminal: io.StringIO) -> None:
    with stages() as tell:
        tell("checking", 1, 2, part=AWKWARD)
        for row in EXAMPLES:
            tell_note(tell, row["text"])
        tell_note(tell, AWKWARD)
    show_table(f"title {AWKWARD}", (f"column {AWKWARD}", "second"), [(f"cell {AWKWARD}", AWKWARD)])
    shown = wide_terminal.getvalue()
    for text in [*(row["text"] for row in EXAMPLES), AWKWARD]:
        assert [part for part in bracketed(text) if part not in shown] == []
    assert all(f"{name} {AWKWARD}" in shown for name in ("checking", "title", "column", "cell"))
