"""Which faults are drawn and which versions are tried, whether a fault is noticed, and how the pages count."""

from __future__ import annotations

from pathlib import Path

import pytest

import mutation
import versions
from passerby.interchange.storage.atomic import write_text


def test_the_draw_is_of_the_seed_and_spread_over_the_rooms() -> None:
    faults = mutation.drawn(1, 6, ("geometry", "people"))
    assert [fault.room for fault in faults] == ["geometry", "people"] * 3
    assert faults == mutation.drawn(1, 6, ("geometry", "people"))
    assert faults != mutation.drawn(2, 6, ("geometry", "people"))
    assert len({fault.name for fault in faults}) == len(faults)


@pytest.mark.slow
@pytest.mark.parametrize(("after", "noticed"), [("raise ValueError\n", True), ("", False)])
def test_a_fault_is_noticed_and_a_copy_without_one_is_not(after: str, noticed: bool) -> None:
    fault = mutation.Fault("geometry", "geometry/geodesy.py", 1, "wrong constant", "", after, 0, 0)
    assert bool(mutation.work((fault, "room"))["test"]) is noticed


@pytest.mark.slow
def test_a_test_that_fails_without_the_fault_as_well_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    fault = mutation.Fault("geometry", "geometry/geodesy.py", 1, "wrong constant", "", "", 0, 0)
    monkeypatch.setattr(mutation, "_first_failure", lambda tests, *_: f"FAILED {tests[0]}")
    with pytest.raises(RuntimeError, match="fails without the fault as well"):
        mutation.work((fault, "room"))


def test_the_page_counts_what_was_noticed_and_names_what_was_not() -> None:

    def fault(line: int) -> object:
        return mutation.Fault("solver", "solver/a.py", line, "off by one", "a | b", "(b | a)", 0, 1)

    found = {fault(1): "room", fault(2): "elsewhere", fault(3): ""}
    told = mutation.tabulate(found, 4, ("room", "elsewhere"))
    assert told.tables["Rooms"].rows[0] == ["solver", "3", "1", "1", "66.7 %", "**no**"]
    assert told.run == "3 of the 4 faults are finished"
    (missed,) = told.tables["Not noticed"].rows
    assert missed[0] == "`solver/a.py:3`"
    assert missed[2] == r"`a \| b`"


def test_an_answer_holds_as_long_as_the_tests_behind_it_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_the_lowest_versions_are_those_that_are_admitted() -> None:
    assert versions.lowest(["numpy>=2.1", "opencv-python-headless>=4.13", "tomli-w>=1.0"]) == [
        "numpy==2.1.*", "opencv-python-headless==4.13.*", "tomli-w==1.0.*",
    ]  # fmt: skip
    assert versions.lowest(["torch==2.13.0"]) == []


def test_a_failure_stands_on_the_page_with_its_name() -> None:
    case = {"version": "3.12.1", "end": "newest", "libraries": {"av": "19.0.2"}, "passed": 6000, "skipped": 4}
    case |= {"failed": ["test_a::b"]}
    found = versions.tabulate({"python3.12 newest": case}, ["python3.14"])
    assert found.notes == ["Not here, and not tried: python3.14."]
    (row,) = found.tables["Versions"].rows
    assert "19.0.2" in row
    assert row[-3:] == ["6000", "4", "test_a::b"]
