"""Sigmas of small scenes against their errors, and the page that tells of them."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import run_reliability
from pages import kept, records, render, tables
from passerby.simulation import SimulationOptions
from reliability import coverage, page, runs

SMALL = {"cameras": 4, "people": 5, "seconds": 12.0, "box_noise": 0.03, "identity_swaps": 0.1}


def test_errors_of_small_scenes_are_as_large_as_the_sigmas_say(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coverage, "drawn", lambda seed: SimulationOptions(preset="terrace", seed=seed, **SMALL))
    results = [coverage.work(seed) for seed in range(40, 44)]
    # Sixteen cameras, and those of one scene err together, all the more where the scale is in it: too few for shares.
    bounds = {"position": 0.1, "distance": 0.1, "orientation": 0.3, "shape position": 0.4, "shape orientation": 0.4}
    for kind, least in bounds.items():
        errors = np.array([value for result in results for value in result["sigmas"][kind]])
        assert least < np.sqrt(np.mean(errors**2)) < 1.6, kind
    assert all(result["verdict"] == "accepted" for result in results)


def test_scenes_are_drawn_over_the_whole_range() -> None:
    drawn = [coverage.drawn(seed) for seed in coverage.SCENES]
    assert len(drawn) == 150
    assert {options.preset for options in drawn} == {"terrace", "basketball", "construction"}
    for values, low, high in (
        ([options.cameras for options in drawn], 3, 10), ([options.people for options in drawn], 1, 20),
        ([options.seconds for options in drawn], 10, 120), ([options.box_noise for options in drawn], 0, 0.06),
        ([options.identity_swaps for options in drawn], 0, 0.2),
    ):  # fmt: skip
        assert low <= min(values) <= low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) <= max(values) <= high


def test_finished_cases_are_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = runs.Wanted(tmp_path, workers=1)
    first = runs.kept(wanted, "squares", {"2": 2, "3": 3}, squared)
    assert first == {"2": {"is": 4}, "3": {"is": 9}}
    assert runs.kept(wanted, "squares", {"3": 3, "2": 2}, failing) == {"3": {"is": 9}, "2": {"is": 4}}
    # One that was cut off is run again, and so are all by other code, and those of a quick run.
    cut = min(tmp_path.iterdir())
    cut.write_bytes(cut.read_bytes()[:-10])
    with pytest.raises(AssertionError, match="again"):
        runs.kept(wanted, "squares", {"2": 2, "3": 3}, failing)
    assert runs.kept(wanted, "squares", {"2": 2, "3": 3}, squared) == first
    with pytest.raises(AssertionError, match="again"):
        runs.kept(replace(wanted, quick=True), "squares", {"2": 2}, failing)
    monkeypatch.setattr(kept, "code_digest", lambda *_: "other")
    with pytest.raises(AssertionError, match="again"):
        runs.kept(wanted, "squares", {"2": 2}, failing)


def test_the_page_keeps_the_parts_that_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [page.Line("two squared", "4", "4", True), page.Line("more --> <b>", "1", "2", False)]
    found = {
        "coverage": page.part_found(lines, {}, run="sigmas"),
        "verdict": page.part_found([page.Line("wrong rigs", "0", "0", True)], {"Hostile cases": tables.table([], [])}),
    }
    for part in found:
        module, _, name = page.PARTS[part].partition(".")
        monkeypatch.setattr(importlib.import_module(f"reliability.{module}"), name, lambda _, part=part: found[part])
    monkeypatch.setattr(render, "TEMPLATES", tmp_path / "none")
    monkeypatch.setattr(run_reliability, "part_codes", lambda: dict.fromkeys(page.PARTS, "now"))
    wanted = runs.Wanted(tmp_path / "kept")
    run_reliability.run_parts(["coverage"], runs.Wanted(tmp_path / "kept", quick=True), tmp_path)
    first = (tmp_path / "reliability.md").read_text()
    assert "sigmas" in first
    assert "quick run" in first
    run_reliability.run_parts(["verdict"], wanted, tmp_path)
    known = records.read_records(tmp_path / "records", "reliability")
    assert {part: [row[0] for row in one.found.goals] for part, one in known.items()} == {
        "coverage": ["two squared", "more --> <b>"], "verdict": ["wrong rigs"],
    }  # fmt: skip
    assert [row[-1] for row in known["coverage"].found.goals] == ["yes", "**no**"]
    # What was run in part, or on other code, is to be run again.
    assert [part for part, one in known.items() if page.is_whole(one, "now")] == ["verdict"]
    assert not any(page.is_whole(one, "newer") for one in known.values())
    before = (tmp_path / "reliability.md").read_text()
    run_reliability.run_parts([], wanted, tmp_path)
    assert (tmp_path / "reliability.md").read_text() == before


def test_a_part_depends_on_its_own_code() -> None:
    # The files behind a part: what it imports however far away, nothing of other parts, nothing that only writes pages.
    behind = set(kept.code_behind("reliability.battery"))
    assert {"reliability/battery.py", "reliability/hostile_people.py", "reliability/staging.py"} <= behind
    assert not behind & {"reliability/coverage.py", "reliability/limits.py"}
    assert not any(path.startswith("pages/") for path in behind)
    codes = page.part_codes()
    assert set(codes) == set(page.PARTS)
    assert len(set(codes.values())) == len({run.partition(".")[0] for run in page.PARTS.values()}), "one for each module"


def squared(value: int) -> dict[str, int]:
    return {"is": value**2}


def failing(value: int) -> dict[str, int]:
    raise AssertionError(f"{value} was run again")
