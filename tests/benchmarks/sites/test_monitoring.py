"""The benchmark of monitoring: what the page says of outcomes, and which cameras count as named."""

from __future__ import annotations

import numpy as np
import pytest

import sites_page
from passerby.geometry.rotations import log_rotation
from passerby.simulation.sites import SiteOptions, simulate_site
from sites import monitoring


def case(cameras: int, every_s: float, few_s: float) -> dict[str, object]:
    return {
        "cameras": cameras, "minutes": 2.0, "cpu_s": every_s + few_s, "fresh": cameras // 20, "read": cameras // 20,
        "all": {"cpu_s": every_s, "wall_s": 1.0, "memory_mb": 100.0 + cameras},
        "few": {"cpu_s": few_s, "wall_s": 1.0, "memory_mb": 100.0},
        "thinning": {"every_s": 0.4, "one_window_in": 1, "predicted_s": 0.4},
        "moved": 3, "named": 2, "among": 0, "silent": 1, "falsely": 0, "untested": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("every_s", "few_s", "reached"),
    [(199.0, 10.0, ["aim", "aim"]), (399.0, 40.0, ["acceptable", "acceptable"]), (401.0, 62.0, ["**missed**", "**missed**"])],
)
def test_goals_are_of_two_hundred_cameras(every_s: float, few_s: float, reached: list[str]):
    done = {"50 cameras": case(50, 50.0, 3.0), "200 cameras": case(200, every_s, few_s)}
    goals = sites_page.tabulate_monitoring(done, done).goals
    assert [goal[-1] for goal in goals] == reached


def test_a_thousand_cameras_are_extrapolated_and_marked_so_once_both_sizes_are_there():
    done = {"50 cameras": case(50, 50.0, 3.0), "200 cameras": case(200, 200.0, 9.0)}
    text = sites_page.tabulate_monitoring(done, done).text
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in text.splitlines() if "extrapolated" in row]
    assert rows[0][1:] == ["1000", "1000 s", "0.5 s", "0.5 s", "1100 MB"]
    assert rows[1][1:4] == ["50", "41 s", "0.021 s"]
    one = {"200 cameras": done["200 cameras"]}
    assert "extrapolated" not in sites_page.tabulate_monitoring(done, one).text


def test_without_two_hundred_cameras_the_goals_are_not_run():
    done = {"50 cameras": case(50, 50.0, 3.0)}
    goals = sites_page.tabulate_monitoring(done, done).goals
    assert [goal[1] for goal in goals] == ["not run", "not run"]


def test_the_rig_of_before_is_turned_where_it_says_so():
    truth = simulate_site(SiteOptions(cameras=40, seed=1, seconds=10)).rig
    rig, moved = monitoring.calibrated_before(truth, 1)
    turns = {
        new.name: np.degrees(np.linalg.norm(log_rotation(new.pose.R_cw @ old.pose.R_cw.T)))
        for old, new in zip(truth, rig, strict=True)
    }
    assert len(moved) == 2
    assert all((turns[name] > 1.5) == (name in moved) for name in turns)
    again, same = monitoring.calibrated_before(truth, 1)
    assert same == moved
    assert np.array_equal(again["C7"].pose.R_cw, rig["C7"].pose.R_cw)


def test_cameras_are_counted_by_what_was_said_of_them():
    states = ["moved", "steady", "cannot tell", "one of several moved", "moved", "steady"]
    told = {"cameras": [{"name": f"C{number}", "state": state} for number, state in enumerate(states, start=1)]}
    assert monitoring.outcome_of(told, ["C1", "C2", "C3", "C4"]) == {
        "moved": 4, "named": 1, "among": 1, "silent": 1, "falsely": 1, "untested": 1,
    }  # fmt: skip
