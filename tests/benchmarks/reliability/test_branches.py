"""What the tests run of the code that judges, tells and writes, as the page on reliability tells of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from reliability import branches as part
from reliability import runs
from support.paths import ROOT, TESTS

FILE = "src/passerby/solver/findings.py"


def outcome(lines: list[int], missing: list[int], taken: list[list[int]], left: list[list[int]], failed: int = 0) -> Any:
    found = {"executed_lines": lines, "missing_lines": missing, "executed_branches": taken, "missing_branches": left}
    return {"tests": 4, "failed": failed, "files": {FILE: found}}


@pytest.mark.unit
def test_what_one_run_misses_another_one_may_cover() -> None:
    first = outcome([1, 2], [3, 4, 5, 9], [[2, 6]], [[2, 3], [6, 9], [6, -1]])
    second = outcome([1, 3], [2, 4, 5, 9], [[2, 3]], [[2, 6], [6, 9], [6, -1]])
    alone, both = (part.covered(outcomes, FILE) for outcomes in ([first], [first, second]))
    assert (alone.n_covered, alone.n) == (3, 10)
    assert (both.n_covered, both.n) == (5, 10)
    # The branch to line 9 is told by the line itself.
    assert both.missed == "4-5, 9, 6 to the end"


@pytest.mark.unit
def test_a_file_that_no_run_tells_of_is_not_covered() -> None:
    unseen = part.covered([outcome([1], [], [], [])], "src/passerby/report/page.py")
    assert not unseen.is_enough
    assert unseen.missed == "all"
    # One without any code is.
    assert part.covered([outcome([], [], [], [])], FILE).is_enough


@pytest.mark.unit
def test_the_page_names_the_files_below_the_goal_and_tests_that_failed() -> None:
    covered = {path: outcome([1, 2, 3, 4, 5], [], [], [])["files"][FILE] for path in part._files()}
    whole = {"tests": 1000, "failed": 0, "files": covered}
    found = part._part([whole], ["findings"])
    assert all(row[-1] == "yes" for row in found.goals)
    assert found.run == "1,000 tests of findings"
    assert "No file is below 95 %." in found.text
    assert "failed" not in found.run

    short = whole | {"failed": 2, "files": covered | outcome([1, 2, 3, 4], [5, 6], [], [])["files"]}
    found = part._part([short], ["findings"])
    assert "**2 of them failed**" in found.run
    assert found.tables["Below the goal"].rows == [["`solver/findings.py`", "66.7 %", "5-6"]]
    assert [row[0] for row in found.goals] == [f"branch coverage: {group}" for group in part.GROUPS]


@pytest.mark.unit
def test_every_pattern_is_of_files_and_every_folder_of_tests() -> None:
    for group, patterns in part.GROUPS.items():
        for pattern in patterns:
            assert list(Path(ROOT, part.PACKAGE).glob(pattern)), f"{group}: {pattern}"
    assert all((TESTS / folder).is_dir() for folder in part.FOLDERS)
    assert not set(part._files("verdict")) & set(part._files("writers"))


def test_the_tests_of_one_folder_cover_the_findings_and_no_verdict(tmp_path: Path) -> None:
    wanted = runs.Wanted(tmp_path, quick=True, workers=1)
    found = part.run(wanted, ["findings"])
    reached = {row[0]: row[-1] == "yes" for row in found.goals}
    assert reached == {
        "branch coverage: verdict": False,
        "branch coverage: findings": True,
        "branch coverage: writers": False,
    }
    assert "failed" not in found.run
    assert "| `calibration/diagnostics/verdict.py`" in found.text
    # What is kept is not run again.
    assert part.run(wanted, ["findings"]).text == found.text
