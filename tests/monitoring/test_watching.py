"""A rig in use: silent while nothing moves, and loud and right when something does."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.progress import silent
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.geometry.rotations import exp_rotation, log_rotation
from passerby.monitoring.watching import WatchOptions, _ScoreRun, watch
from passerby.people.ground import fit_ground
from passerby.people.held_cameras import GroundPlane, equations_of, fit_people
from passerby.people.resection import resect, resect_observations
from passerby.people.sightings import gather_sightings, poses_of
from support.scenes.walkers_for_monitor import calibrated, knocked, only, true_rig, walkers
from support.tiers import thinned

RIG = true_rig()
GIVEN = calibrated(RIG)


@pytest.fixture(scope="module")
def still():
    return watch(GIVEN, gather_sightings(GIVEN, walkers(RIG)))


def true_shift(before, after):
    return np.concatenate([after.centre - before.centre, log_rotation(after.R_cw @ before.R_cw.T)])


def watched(seen, given=GIVEN):
    return watch(given, gather_sightings(given, seen))


def test_nothing_moves(still):
    assert still.moves == watched(Observations({}, 2.0)).moves == ()
    assert [window.clear(c) for window in still.windows for c in range(4)] == [True] * 12
    scores = [test.score for window in still.windows for test in window.tests]
    assert max(scores) < 3
    (whole,) = still.whole
    assert (whole.from_s, whole.until_s) == (still.from_s, still.until_s)
    assert max(test.score for test in whole.tests) < 3


@thinned("camera", RIG.names, quick=2)
def test_a_turn_before_the_footage_that_no_window_shows_is_found_by_all_of_it(camera):
    """About the vertical, by a degree; two people, five minutes."""
    before = RIG[camera].pose
    turn = before.R_cw[:, 2]
    seen = walkers(RIG, 300, people=2, knocks={camera: (-1.0, knocked(before, turn))})
    found = watched(seen)
    assert max(test.score for window in found.windows for test in window.tests) < WatchOptions().threshold
    (move,) = found.moves
    assert (move.camera, move.others, move.moment) == (camera, (), None)
    error = move.shift - np.concatenate([np.zeros(3), np.radians(turn)])
    assert error @ np.linalg.solve(move.covariance, error) < 22.5  # 99.9 % of a chi squared of six
    (whole,) = found.whole
    assert max(whole.tests, key=lambda test: test.score).camera == RIG.names.index(camera)
    assert all(test.smallest_deg[0] <= test.smallest_deg[1] < 1 for test in whole.tests)


def test_all_footage_after_a_move_is_compared_with_the_new_pose():
    after = knocked(RIG["C2"].pose, (0, 2, 0))
    found = watched(walkers(RIG, 300, knocks={"C2": (60.0, after)}))
    (move,) = found.moves
    (whole,) = found.whole
    assert move.camera == "C2"
    assert move.noticed_s <= whole.from_s < whole.until_s == found.until_s
    assert max(test.score for test in whole.tests) < 3


@thinned(
    ("camera", "turn", "shift"),
    [("C2", (0, 1, 0), (0, 0, 0)), ("C4", (0.8, 0, 0.6), (0, 0, 0)), ("C1", (0, 0, 0), (0.06, 0, 0.08)),
     ("C3", (0, 9, 3), (0.3, 0, 0))],
    every=2,
)  # fmt: skip
def test_a_knock_is_named_dated_and_measured(camera, turn, shift):
    before = RIG[camera].pose
    after = knocked(before, turn, shift)
    found = watched(walkers(RIG, knocks={camera: (100.0, after)}))
    assert [move.camera for move in found.moves] == [camera]
    (move,) = found.moves
    assert move.others == ()
    assert 100 < move.noticed_s <= 160
    assert abs(move.moment.seconds - 100) <= 5
    assert move.moment.from_s <= 100 <= move.moment.until_s
    error = move.shift - true_shift(before, after)
    assert error @ np.linalg.solve(move.covariance, error) < 22.5  # 99.9 % of a chi squared of six
    off = move.pose.centre - after.centre
    assert np.linalg.norm(off) < 3 * move.sigma.position_m


@pytest.mark.slow
def test_two_cameras_knocked_at_once():
    rig = true_rig(6)
    given = calibrated(rig)
    knocks = {
        "C2": (100.0, knocked(rig["C2"].pose, (0, 2, 0))),
        "C5": (100.0, knocked(rig["C5"].pose, (0, -2, 0), (0.1, 0, 0))),
    }
    found = watch(given, gather_sightings(given, walkers(rig, knocks=knocks)))
    assert sorted(move.camera for move in found.moves) == ["C2", "C5"]


@pytest.mark.slow
def test_a_camera_that_moves_twice():
    once = knocked(RIG["C1"].pose, (0, 2, 0))
    first = walkers(RIG, 300, knocks={"C1": (80.0, once)})
    second = walkers(RIG, 300, knocks={"C1": (200.0, knocked(once, (0, 2, 0)))})
    boxes, late = first["C1"].boxes, second["C1"].boxes
    early = boxes.take(boxes.frame <= 400)
    late = late.take(late.frame > 400)
    both = Boxes(*(np.concatenate([getattr(p, n) for p in (early, late)]) for n in ("frame", "identity", "ltwh", "score")))
    seen = Observations({**first.cameras, "C1": CameraObservations(both)}, first.fps)
    found = watch(GIVEN, gather_sightings(GIVEN, seen))
    assert [move.camera for move in found.moves] == ["C1", "C1"]
    assert np.degrees(np.linalg.norm(found.moves[1].shift[3:])) == pytest.approx(2, abs=0.6)


def test_of_two_cameras_either_may_have_moved():
    """Where no other camera saw their people they have moved within the window."""
    pair, true = only(GIVEN, "C1", "C2"), only(RIG, "C1", "C2")
    (move,) = watched(walkers(true, knocks={"C1": (100.0, knocked(RIG["C1"].pose, (3, 3, 0)))}), pair).moves
    assert {move.camera, *move.others} == {"C1", "C2"}
    seen = gather_sightings(pair, walkers(true, 120, knocks={"C1": (0.0, knocked(RIG["C1"].pose, (0, 3, 0)))}))
    run = _ScoreRun(pair, seen, WatchOptions(), GroundPlane(), silent, None)
    assert [(one.from_s, one.until_s) for one in run._moments([0, 1], 30.0, 90.0)] == [(30.0, 90.0)] * 2
    assert resect_observations(pair, seen.without(np.array([True, True])), "C1") is None


def test_one_cameras_pose_is_found_again_from_far_off():
    seen, off = walkers(RIG, 120), calibrated(RIG)
    far = replace(off["C2"], pose=knocked(off["C2"].pose, (0, 15, 5), (0.5, 0, 0)))
    found = resect(replace(off, cameras=tuple(far if one.name == "C2" else one for one in off)), seen, "C2")
    assert np.linalg.norm(found.pose.centre - RIG["C2"].centre) < 3 * found.sigma.position_m + 3 * 0.01
    assert found.degrees == pytest.approx(np.hypot(15, 5), abs=1)
    assert resect(off, seen, "C2", until_s=4.0) is None
    assert resect(off, seen, "C2", without=("C1", "C3", "C4")) is None


def test_ground_that_is_a_slope_somewhere_else():
    moved = GIVEN.moved(np.eye(3), np.array([0.0, 0.0, 30.0]))
    seen = walkers(RIG, 60, ground=lambda xy: 0.05 * xy[:, 0])
    ground = fit_ground(moved, gather_sightings(moved, seen), 30.0)
    assert ground.height == pytest.approx(30, abs=0.05)
    assert ground.slope == pytest.approx((0.05, 0.0), abs=0.015)


def test_derivatives_of_the_equations():
    seen = gather_sightings(GIVEN, walkers(RIG, 20))
    rotation, centre = poses_of(GIVEN, seen.names)
    body = fit_people(seen, rotation, centre).body
    here, step = equations_of(seen.in_world(rotation, centre), body), 1e-6
    by_camera = here.by_camera(rotation[seen.camera])
    for k in range(6):
        turned, placed = rotation.copy(), centre.copy()
        if k < 3:
            placed[:, k] += step
        else:
            turned = exp_rotation(step * np.eye(3)[k - 3]) @ rotation
        there = equations_of(seen.in_world(turned, placed), body)
        numeric = -(there.residual - here.residual) / step
        # Linear about the rays: what the residual itself changes by is left out.
        assert np.abs(numeric - by_camera[:, :, k]).max() < 0.15 * np.abs(by_camera[:, :, k]).max() + 1e-6
