"""Limits of the verdict are those of the page that says where they come from, and what its figures tell apart."""

from __future__ import annotations

import importlib
import re
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.core.observations import Keypoints
from passerby.simulation import SimulationOptions, simulate
from reliability import (
    clock_figures,
    joint_figures,
    move_figures,
    overheard,
    refined_figures,
    stature_figures,
    unusual_figures,
)
from support.paths import ROOT

PAGE = ROOT / "docs" / "results" / "limits.md"
STATED = re.compile(r"`?(?P<name>[A-Z_]+)`? in\s`(?:passerby/)?(?P<module>[a-z_/]+)\.py`(?:: | is )(?P<values>[\d., ]*\d)")
MEASURED = {
    "HARMFUL_SHARE", "LEAST_ODDS", "POPULATION_BIAS", "AMBIGUOUS", "STEEP_DEG", "STEEP_SIGMAS",
    "SIGMAS", "LEAST_S", "SPOILING_S", "HARMFUL_S", "HARMFUL_RATE", "BOXES_MISLEAD", "UNUSUAL_SIGMAS",
    "DOUBT_POWER", "USABLE_M", "USUAL_EFFECT", "USUAL_COUNTS",
}  # fmt: skip


def test_the_page_states_the_limits_in_force_and_the_run_they_were_measured_by() -> None:
    text = PAGE.read_text(encoding="utf-8")
    stated = {one["name"]: one for one in STATED.finditer(text)}
    assert set(stated) == MEASURED
    for name, one in stated.items():
        module = importlib.import_module(f"passerby.{one['module'].replace('/', '.')}")
        in_force = np.atleast_1d(getattr(module, name)).tolist()
        assert [float(value) for value in one["values"].split(",")] == in_force, name
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    assert len(parts) > 5
    for part in parts:
        assert re.search(r"Code of commit `[0-9a-f]{10}`, 20|Not run", part), part.partition("\n")[0]


def test_a_move_is_found_and_nobody_moves_where_nobody_does() -> None:
    wanted = move_figures.cases(1)
    kinds = {case.kind for case in wanted.values()}
    assert len(kinds) == 2 + len(move_figures.TURNS_DEG) + len(move_figures.SHIFTS_M) + len(move_figures.ZOOMS)
    still = next(case for case in wanted.values() if case.kind == move_figures.STILL)
    turned = next(case for case in wanted.values() if case.pan_deg == 4.0)
    assert move_figures.measure(still)["changes"] == []
    (found,) = (one for one in move_figures.measure(turned)["changes"] if one["moved"])
    assert found["kind"] == "moved"
    assert found["log_odds"] > move_figures.LOG_ODDS


def test_what_is_overheard_is_what_was_returned_and_ends_with_the_block() -> None:
    module = types.ModuleType("speaking")
    module.twice = lambda value: 2 * value  # type: ignore[attr-defined]
    speak = module.twice
    with overheard.overheard(module, "twice") as returned:
        assert module.twice(3) == 6
        assert module.twice(value=4) == 8
    assert returned == [6, 8]
    assert module.twice is speak


def test_a_drift_counts_by_its_sigmas_and_by_what_it_comes_to() -> None:
    case = clock_figures.ClockCase("terrace", 1, 60.0, 0.01)
    assert case.drift_s == pytest.approx(0.6)
    drifts = {
        "C1": clock_figures.Drift(0.0, 1e-4, 60.0),
        "C2": clock_figures.Drift(0.01, 1e-4, 60.0),
        "C3": clock_figures.Drift(0.01, 0.01, 60.0),
    }
    one = clock_figures.Clocked(case, 12.0, wrong=False, drifts=drifts)
    assert [name for name in (*drifts, "C4") if one.told(name)] == ["C2"], "C1 keeps step, C3 is not known, C4 nobody saw"
    assert not one.told("C2", least_s=0.7)
    assert one.told("C3", sigmas=0.5)
    found = clock_figures.tabulate({"a": {"worst_mm": 12.0, "wrong": True, "drifts": {}}, "b": {}}, {"a": case, "b": case})
    assert f"SPOILING_S = {clock_figures.SPOILING_S:g}" in found.run
    doubted = {limit: doubts for limit, doubts, *_ in found.tables["SPOILING_S"].rows}
    assert doubted[f"**{clock_figures.SPOILING_S:g}**"] == "0 of 1", "nothing is doubted where nothing is known of a clock"


def test_scales_of_joints_are_those_of_their_errors() -> None:
    rng = np.random.default_rng(3)
    widening = rng.uniform(0.5, 3.0, 4000)
    error = 0.01 * widening * np.linalg.norm(rng.standard_normal((4000, 2)), axis=1)
    losses = {power: joint_figures.cauchy_loss(error, widening**power) for power in (0.0, 1.0, 2.0)}
    assert min(losses, key=losses.__getitem__) == 1.0


def test_joints_are_held_against_the_person_they_are_of() -> None:
    rng = np.random.default_rng(4)
    body = rng.uniform(0, 100, (17, 2))
    body[0, 1], body[16, 1], body[3] = -1.0, 101.0, (50.0, 50.0)
    xy = body + np.array([0.0, 300.0]) * np.arange(6)[:, None, None]
    truth = Keypoints(np.repeat([1, 2], 3), np.arange(6), xy, np.ones((6, 17)))
    score = np.full((6, 17), 0.8)
    score[:, 5] = 0.4
    score[0, 3] = 0.0
    moved = xy + 4.0  # all alike: no score tells of it
    moved[2, 5] += 30.0
    found = Keypoints(truth.frame, np.arange(6), moved, score).take(np.array([5, 0, 3, 2, 4, 1]))
    ratio, error = joint_figures.joint_errors(truth, found)
    assert len(ratio) == len(error) == 6 * 17 - 1
    assert sorted(set(np.round(ratio, 3))) == [1.0, 2.0]
    assert error[ratio < 1.5].max() == pytest.approx(0.0, abs=1e-9)
    assert np.count_nonzero(error > 0.1) == 1
    nobody = truth.take(np.zeros(6, dtype=bool))
    assert [len(column) for column in joint_figures.joint_errors(truth, nobody)] == [0, 0]


def test_sections_say_what_no_case_was_run_of() -> None:
    assert "not measured" in joint_figures.tabulate({}, {}).notes[0]
    for figures, name in ((unusual_figures, "UNUSUAL"), (refined_figures, "BOXES_")):
        wanted = figures.cases(1)
        assert len(wanted) > 10
        assert figures.tabulate({}, wanted).run.startswith(name)


def test_groups_are_drawn_by_their_seed_and_are_of_a_plausible_stature() -> None:
    groups = stature_figures.drawn_groups(np.random.default_rng(1), 20_000)
    assert np.array_equal(groups, stature_figures.drawn_groups(np.random.default_rng(1), 20_000))
    assert -0.05 < groups.mean() < -0.01, "half of the people are women, and many countries are small"
    assert 0.03 < groups.std() < 0.05
    assert np.log(1.46 / 1.72) < groups.min() < groups.max() < np.log(1.86 / 1.72)
    for men, women in stature_figures.MEN_AND_WOMEN_CM.values():
        assert 159 < men < 184
        assert 149 <= women < 171
        assert 8 < men - women < 16


def test_heights_of_boxes_are_held_against_whole_bodies() -> None:
    scene = simulate(SimulationOptions(preset="terrace", seed=1, cameras=2, people=3, seconds=4.0, occlusion=False))
    taller = {name: replace(boxes, ltwh=boxes.ltwh * (1, 1, 1, 1.03)) for name, boxes in scene.truth.items()}
    for camera in scene.rig:
        ratios, away = stature_figures.height_ratios(camera, taller[camera.name], scene)
        assert len(ratios) == len(away) > 10
        assert np.abs(ratios - np.log(1.03)).max() < 1e-9
        assert 1.0 < np.exp(away).min() < np.exp(away).max() < 30.0
        nothing = taller[camera.name].take(np.zeros(len(taller[camera.name]), dtype=bool))
        assert [len(column) for column in stature_figures.height_ratios(camera, nothing, scene)] == [0, 0]


def test_the_page_has_the_constant_and_tells_scale_from_heights() -> None:
    seen = {"a": _outcome("background", 0.02, 0.01), "b": _outcome("background", float("nan"), 0.03)}
    found = stature_figures.tabulate(seen, {})
    assert found.run == f"POPULATION_BIAS = {stature_figures.POPULATION_BIAS:g}"
    rows = {row[0]: row[1] for row in found.tables["POPULATION_BIAS"].rows}
    assert rows["boxes by the background, rendered films"] == "1"
    assert rows["heights of boxes by the background"] == "2"
    assert not any("by the network" in name for name in rows), "none was run"
    assert "The models were not at hand" in found.notes[1]
    both = seen | {"c": _outcome("network", 0.0, 0.0)}
    assert len(stature_figures.tabulate(both, {}).notes) == 1
    assert "root mean square" in stature_figures.tabulate({}, {}).notes[0], "without a film"


def test_without_models_there_are_films_by_silhouettes_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for folder in (None, tmp_path):
        monkeypatch.setattr(stature_figures, "models_folder", lambda folder=folder: folder)
        assert {detector for detector, _, _ in stature_figures.cases(2).values()} == {"background"}


def _outcome(detector: str, log_scale: float, log_boxes: float) -> dict[str, object]:
    return {"detector": detector, "log_scale": log_scale, "log_boxes": log_boxes, "boxes": 1}
