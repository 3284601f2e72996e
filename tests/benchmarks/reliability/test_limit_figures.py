"""Figures that limits of the verdict are held against: what each of them tells apart."""

from __future__ import annotations

import types
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from passerby.core.observations import Keypoints

Bench = Callable[[str], ModuleType]


def test_what_is_overheard_is_what_was_returned_and_ends_with_the_block(bench: Bench) -> None:
    module = types.ModuleType("speaking")
    module.twice = lambda value: 2 * value  # type: ignore[attr-defined]
    speak = module.twice
    with bench("reliability.overheard").overheard(module, "twice") as returned:
        assert module.twice(3) == 6
        assert module.twice(value=4) == 8
    assert returned == [6, 8]
    assert module.twice is speak


def test_a_drift_is_told_by_its_sigmas_and_by_what_it_comes_to(bench: Bench) -> None:
    clocks = bench("reliability.clock_figures")
    case = clocks.ClockCase("terrace", 1, 60.0, 0.01)
    assert case.drift_s == pytest.approx(0.6)
    drifts = {"C1": clocks.Drift(0.0, 1e-4, 60.0), "C2": clocks.Drift(0.01, 1e-4, 60.0), "C3": clocks.Drift(0.01, 0.01, 60.0)}
    one = clocks.Clocked(case, 12.0, wrong=False, drifts=drifts)
    assert [name for name in (*drifts, "C4") if one.told(name)] == ["C2"], "C1 keeps step, C3 is not known, C4 nobody saw"
    assert not one.told("C2", least_s=0.7)
    assert one.told("C3", sigmas=0.5)
    found = clocks.tabulate({"a": {"worst_mm": 12.0, "wrong": True, "drifts": {}}, "b": {}}, {"a": case, "b": case})
    assert f"SPOILING_S = {clocks.SPOILING_S:g}" in found.run
    doubted = {limit: doubts for limit, doubts, *_ in found.tables["SPOILING_S"].rows}
    assert doubted[f"**{clocks.SPOILING_S:g}**"] == "0 of 1", "nothing is doubted where nothing is known of a clock"


def test_scales_of_joints_are_those_of_their_errors(bench: Bench) -> None:
    joints = bench("reliability.joint_figures")
    rng = np.random.default_rng(3)
    widening = rng.uniform(0.5, 3.0, 4000)
    error = 0.01 * widening * np.linalg.norm(rng.standard_normal((4000, 2)), axis=1)
    losses = {power: joints.cauchy_loss(error, widening**power) for power in (0.0, 1.0, 2.0)}
    assert min(losses, key=losses.__getitem__) == 1.0


def test_joints_are_held_against_the_person_they_are_of(bench: Bench) -> None:
    joints = bench("reliability.joint_figures")
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
    ratio, error = joints.joint_errors(truth, found)
    assert len(ratio) == len(error) == 6 * 17 - 1
    assert sorted(set(np.round(ratio, 3))) == [1.0, 2.0]
    assert error[ratio < 1.5].max() == pytest.approx(0.0, abs=1e-9)
    assert np.count_nonzero(error > 0.1) == 1
    nobody = truth.take(np.zeros(6, dtype=bool))
    assert [len(column) for column in joints.joint_errors(truth, nobody)] == [0, 0]


def test_sections_say_what_no_case_was_run_of(bench: Bench) -> None:
    assert "not measured" in bench("reliability.joint_figures").tabulate({}, {}).notes[0]
    for name in ("unusual_figures", "refined_figures"):
        figures = bench(f"reliability.{name}")
        wanted = figures.cases(1)
        assert len(wanted) > 10
        assert figures.tabulate({}, wanted).run.startswith(f"{name.partition('_')[0].upper()}" if name[0] == "u" else "BOXES_")
