"""What is said of a monitored rig: which camera moved, when and by how much, and which cannot be tested."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passerby.interchange.monitor_json import MoveEntry
from passerby.monitoring.evidence import ChangePoint, MotionTest
from passerby.monitoring.result import MonitoringResult, measure_shift, move_in_words
from passerby.monitoring.watched import Move, Watched, WatchOptions, Window
from support.scenes.people_and_rigs import ring

RIG = ring(3)
SURE = (0.02, 0.05), (0.1, 0.3)
BLIND = (np.inf, np.inf), (np.inf, np.inf)
VAGUE = (3.0, 5.0), (4.0, 6.0)
NOWHERE = Move("C2", 40.0, None, 9.0, np.full(6, np.nan), np.full((6, 6), np.nan), None, None)
"""Too few people tell where it is."""


def result(*moves: Move, smallest: dict[str, tuple[tuple[float, float], ...]] | None = None) -> MonitoringResult:
    """One window, in which each camera is tested; these smallest moves of a camera would be seen."""
    seen = dict.fromkeys(RIG.names, SURE) | (smallest or {})
    tests = tuple(MotionTest(c, 0.5, 20, np.zeros(6), *seen[name]) for c, name in enumerate(RIG.names))
    return MonitoringResult(RIG, Watched(RIG.names, moves, (Window(0.0, 60.0, tests),), 0.0, 60.0), WatchOptions(), None)


def test_a_camera_whose_move_is_unknown_and_one_of_two_that_moved() -> None:
    found = result(NOWHERE)
    assert (found.state("C2"), found.exit_status) == ("moved", 3)
    assert found.sentences() == [
        "C2 moved before the footage began; not enough people to estimate by how much; noticed at 00:00:40"
    ]
    (move,) = found.to_dict()["moves"]
    assert (move["metres"], move["degrees"], move["seconds"], move["before_footage"]) == (None, None, None, True)
    moment = ChangePoint(3725.0, 3720.0, 3731.0)
    shift = np.array([0.3, 0.4, 0.0, 0.0, np.radians(2.0), 0.0])
    found = result(replace(NOWHERE, moment=moment, shift=shift, covariance=np.diag([0.01**2] * 3 + [1e-6] * 3), others=("C3",)))
    assert [found.state(name) for name in RIG.names] == ["steady", "one of several moved", "one of several moved"]
    assert found.sentences() == [
        "C2 or C3 moved at 01:02:05 (between 01:02:00 and 01:02:11), by 0.500 +- 0.010 m and 2.00 +- 0.06 degrees (if it was "
        "C2: the people do not show which); noticed at 00:00:40"
    ]


def test_cameras_without_a_verdict_are_named_with_the_reason() -> None:
    found = result(smallest={"C1": VAGUE, "C3": BLIND})
    assert [found.state(name) for name in RIG.names] == ["cannot tell", "steady", "cannot tell"]
    vague, blind = found.sentences()
    assert vague.startswith("C1: cannot tell: a move below 3.00 m or 4.0 degrees would not be detected")
    assert "sigmas of the rig are large" in vague
    assert blind == "C3: cannot tell: not enough people that another camera also sees"
    assert (found.smallest("C1", worst=True), found.smallest("C3")) == ((5.0, 6.0), (None, None))


def test_most_cameras_at_once() -> None:
    """The rest decides which of them stood still."""
    both = result(NOWHERE, replace(NOWHERE, camera="C3"))
    assert both.most_moved == ("C2", "C3")
    assert "most cameras moved relative to each other (C2, C3): calibrate anew" in both.sentences()
    assert result(NOWHERE, replace(NOWHERE, camera="C3", noticed_s=50.0)).most_moved == ()


def test_a_move_of_an_earlier_run_that_lacks_a_figure_states_none() -> None:
    figures = {"metres": 0.5, "metres_sigma": 0.1, "degrees": 1.0, "degrees_sigma": 0.2}
    whole = MoveEntry(camera="C1", noticed_s=7200.4, seconds=5.0, from_s=-1.0, until_s=9.6, carried=True, **figures)
    assert move_in_words(whole) == (
        "C1 moved at 00:00:05 (between 00:00:00 and 00:00:10), by 0.500 +- 0.100 m and 1.00 +- 0.20 degrees; noticed in an "
        "earlier run at 02:00:00"
    )
    for missing in figures:
        assert "not enough people to estimate by how much" in move_in_words(replace(whole, **{missing: None}))


def test_how_long_a_shift_is_and_how_sure_that_is() -> None:
    assert measure_shift(np.array([3.0, 4.0, 0.0]), np.diag([0.04, 0.04, 9.0])) == pytest.approx((5.0, 0.2))
    assert measure_shift(np.full(3, np.nan), np.eye(3)) == (None, None)
    assert measure_shift(np.zeros(3), np.eye(3)) == (0.0, 0.0)
