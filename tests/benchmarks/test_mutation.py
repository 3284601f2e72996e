"""Which faults are drawn, whether one is noticed, and how the page counts them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from passerby.interchange.storage.atomic import write_text

Bench = Callable[[str], ModuleType]


def test_the_draw_is_of_the_seed_and_spread_over_the_rooms(bench: Bench) -> None:
    mutation = bench("mutation")
    faults = mutation.drawn(1, 6, ("geometry", "people"))
    assert [fault.room for fault in faults] == ["geometry", "people"] * 3
    assert faults == mutation.drawn(1, 6, ("geometry", "people"))
    assert faults != mutation.drawn(2, 6, ("geometry", "people"))
    assert len({fault.name for fault in faults}) == len(faults)


@pytest.mark.slow
@pytest.mark.parametrize(("after", "noticed"), [("raise ValueError\n", True), ("", False)])
def test_a_fault_is_noticed_and_a_copy_without_one_is_not(bench: Bench, after: str, noticed: bool) -> None:
    mutation = bench("mutation")
    fault = mutation.Fault("geometry", "geometry/geodesy.py", 1, "wrong constant", "", after, 0, 0)
    assert bool(mutation.work((fault, "room"))["test"]) is noticed


@pytest.mark.slow
def test_a_test_that_fails_without_the_fault_as_well_ends_the_run(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    mutation = bench("mutation")
    fault = mutation.Fault("geometry", "geometry/geodesy.py", 1, "wrong constant", "", "", 0, 0)
    monkeypatch.setattr(mutation, "_first_failure", lambda tests, *_: f"FAILED {tests[0]}")
    with pytest.raises(RuntimeError, match="fails without the fault as well"):
        mutation.work((fault, "room"))


def test_the_page_counts_what_was_noticed_and_names_what_was_not(bench: Bench) -> None:
    mutation = bench("mutation")

    def fault(line: int) -> object:
        return mutation.Fault("solver", "solver/a.py", line, "off by one", "a | b", "(b | a)", 0, 1)

    found = {
        fault(1): "room",
        fault(2): "elsewhere",
        fault(3): "",
    }
    told = mutation.tabulate(found, 4, ("room", "elsewhere"))
    assert told.tables["Rooms"].rows[0] == ["solver", "3", "1", "1", "66.7 %", "**no**"]
    assert told.run == "3 of the 4 faults are finished"
    (missed,) = told.tables["Not noticed"].rows
    assert missed[0] == "`solver/a.py:3`"
    assert missed[2] == r"`a \| b`"


def test_an_answer_holds_as_long_as_the_tests_behind_it_are_the_same(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mutation = bench("mutation")
    monkeypatch.setattr(mutation, "ROOT", tmp_path)
    monkeypatch.setattr(mutation, "TESTS", tmp_path / "tests")
    own, beside, elsewhere = (tmp_path / "tests" / name for name in ("a/test_own.py", "a/test_beside.py", "b/test_b.py"))
    answers = mutation.Answers(tmp_path / "kept", ())
    found = {"noticed": ("FAILED tests/a/test_own.py::test_x", ("a",)), "missed": (None, ("a",)), "by none": (None, ())}
    mutation.tests_behind.cache_clear()

    def hold() -> list[str]:
        mutation.tests_behind.cache_clear()  # as in the next run
        return [what for what in found if answers.get(what) is not None]

    for path in (own, beside, elsewhere):
        write_text(path, "")
    for what, (test, folders) in found.items():
        answers.put(what, {"test": test, "folders": folders, "tests": mutation.tests_behind(test, folders)})
    assert hold() == ["noticed", "missed", "by none"]
    write_text(elsewhere, "# changed")
    assert hold() == ["noticed", "missed"]
    write_text(beside, "# changed")
    assert hold() == ["noticed"]
    write_text(own, "# changed")
    assert hold() == []
    mutation.tests_behind.cache_clear()
