"""A budget of processor time: the least that is needed of the footage is left out, the same everywhere, and it is said."""

import json

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.monitoring.budget import Thinning, plan_thinning, thin
from passerby.monitoring.watched import WatchOptions
from support.scenes.rooms_for_monitor import rooms, walkers_in_rooms
from support.scenes.walkers_for_monitor import calibrated, knocked, true_rig, walkers, write_watched

OPTIONS = WatchOptions()


def footage(fps=10.0, seconds=600, people=3, offset_s=0.0, step=1):
    frame = np.repeat(np.arange(1, int(seconds * fps) + 1, step), people)
    boxes = Boxes(frame, np.tile(np.arange(people), len(frame) // people), np.ones((len(frame), 4)), np.ones(len(frame)))
    return Observations({"C1": CameraObservations(boxes)}, fps, {"C1": Clock(fps, offset_s)})


def seconds_of(observations):
    return np.unique(observations.clocks["C1"].seconds(observations["C1"].boxes.frame))


def test_a_smaller_budget_leaves_out_more_and_is_kept():
    """Samples are thinned before windows are left out."""
    budgets = (1.0, 0.5, 0.3, 0.2, 0.1, 0.06)
    plans = [plan_thinning(footage(), OPTIONS, budget) for budget in budgets]
    used = [len(thin(footage(), plan, 60.0)["C1"].boxes) for plan in plans]
    assert used == sorted(used, reverse=True)
    assert len(set(used)) > 3
    assert all(plan.predicted_s <= budget for plan, budget in zip(plans, budgets, strict=True))
    assert not plan_thinning(footage(), OPTIONS, 10.0).is_thinned
    plans = [plan_thinning(footage(), OPTIONS, budget) for budget in np.geomspace(1.0, 0.02, 30)]
    assert any(plan.every_s > 0 and plan.one_window_in == 1 for plan in plans)
    assert all(plan.every_s == 1.0 for plan in plans if plan.one_window_in > 1)
    # A budget that reading alone exceeds is stated all the same.
    plan = plan_thinning(footage(people=100), OPTIONS, 0.001)
    assert (plan.predicted_s > 0.001, plan.one_window_in) == (True, 1000)


def test_samples_and_windows_are_left_out_by_the_time_of_the_rig():
    for step in (1, 5):
        assert np.allclose(np.diff(seconds_of(thin(footage(step=step), Thinning(every_s=1.0), 60.0))), 1.0)
    used = seconds_of(thin(footage(offset_s=-7.0), Thinning(one_window_in=3), 60.0))
    assert np.array_equal(np.unique((used + 7.0) // 60), [0, 3, 6, 9])
    assert len(used) == 4 * 600


def test_footage_without_anybody_is_not_thinned_and_the_order_of_cameras_does_not_matter():
    empty = Observations({"C1": CameraObservations()}, 10.0, {"C1": Clock(10.0)})
    assert plan_thinning(empty, OPTIONS, 0.001) == Thinning()
    assert len(thin(empty, Thinning(1.0, 5), 60.0)["C1"].boxes) == 0
    one = footage()["C1"]
    first, second = (
        plan_thinning(Observations(dict.fromkeys(names, one), 10.0, dict.fromkeys(names, Clock(10.0))), OPTIONS, 0.1)
        for names in (("C2", "C1"), ("C1", "C2"))
    )
    assert first == second


def test_a_move_is_found_in_thinned_footage_and_the_thinning_is_stated(tmp_path, capsys):
    rig = true_rig()
    knocks = {"C2": (0.0, knocked(rig["C2"].pose, (0, 3, 0)))}
    paths = write_watched(tmp_path, calibrated(rig), walkers(rig, 240, knocks=knocks))
    assert run(["monitor", *map(str, paths), "--json", "--budget", "0.12"]) == 3
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    assert [move["camera"] for move in told["moves"]] == ["C2"]
    assert told["thinning"]["one_window_in"] > 1 or told["thinning"]["every_s"] > 0
    assert "to stay within 0.12 s of processor time for each camera and minute" in printed.err


@pytest.mark.slow
def test_rigs_of_many_cameras_have_a_budget(tmp_path, capsys):
    rig = rooms()
    paths = write_watched(tmp_path, calibrated(rig), walkers_in_rooms(rig, 60))
    assert run(["monitor", *map(str, paths), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["thinning"]["one_window_in"] == 1
    assert 0 < told["thinning"]["predicted_s"] <= 1.0


@pytest.mark.parametrize("budget", ["0", "-1", "nan", "1e9"])
def test_a_senseless_budget_is_one_line(tmp_path, capsys, budget):
    assert run(["monitor", str(tmp_path), str(tmp_path), "--budget", budget]) == 2
    assert capsys.readouterr().err.count("\n") == 1
