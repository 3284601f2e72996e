"""A rig of many cameras: each is tested with those that see its people, and says what a test of few cameras would say."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.cameras import Pose, Rig
from passerby.core.observations import Clock
from passerby.monitoring.given_rig import read_given
from passerby.monitoring.monitor import monitor, watch_footage
from passerby.monitoring.site import CamerasOfSite, connect_cameras, neighbours_by_rig, watch_site
from passerby.monitoring.watched import WatchOptions
from support.scenes.rooms_for_monitor import rooms, walkers_in_rooms
from support.scenes.walkers_for_monitor import FPS, calibrated, knocked, write_watched

RIG = rooms()
GIVEN = calibrated(RIG)
GROUND = dict.fromkeys(RIG.names, 0.0)


def with_clocks(observations):
    return replace(observations, clocks=dict.fromkeys(observations.cameras, Clock(FPS)))


def watched(knocks=None, given=GIVEN, **kwargs):
    seen = with_clocks(walkers_in_rooms(RIG, knocks=knocks, **kwargs))
    return watch_site(CamerasOfSite.of(given, seen), WatchOptions(), known=True)


def test_neighbours_are_the_cameras_of_one_room_and_floor():
    assert {(a // 4, b // 4) for a, b in neighbours_by_rig(RIG, GROUND)} == {(0, 0), (1, 1), (2, 2), (3, 3)}
    assert connect_cameras(neighbours_by_rig(RIG, GROUND), 16) == [list(range(k, k + 4)) for k in (0, 4, 8, 12)]
    saw_somebody = {name: 0.0 for name in RIG.names if name != "C2"}
    assert all(1 not in pair for pair in neighbours_by_rig(RIG, saw_somebody))
    crowd = Rig(tuple(replace(RIG["C1"], name=f"N{k}") for k in range(60)))
    assert len(neighbours_by_rig(crowd, dict.fromkeys(crowd.names, 0.0))) <= 12 * 60, "no more neighbours for more cameras"
    above = [replace(c, name=f"U{c.name}", pose=Pose.from_centre(c.pose.R_cw, c.pose.centre + [0, 0, 4.0])) for c in RIG]
    pairs = neighbours_by_rig(Rig((*RIG, *above)), GROUND | {camera.name: 4.0 for camera in above})
    assert pairs
    assert all((a < 16) == (b < 16) for a, b in pairs)


@pytest.mark.slow
def test_nothing_moves():
    found = watched()
    assert found.names == RIG.names
    assert found.moves == ()
    assert len(found.windows) == 3
    assert sorted(test.camera for test in found.windows[0].tests) == list(range(16))
    assert all(window.clear(camera) for window in found.windows for camera in range(16))
    (whole,) = found.whole
    assert sorted(test.camera for test in whole.tests) == list(range(16))
    assert max(test.score for test in whole.tests) < 3


@pytest.mark.slow
def test_a_turn_before_the_footage_that_no_window_shows_is_found_by_all_of_it():
    pose = RIG["C6"].pose
    found = watched({"C6": (-1.0, knocked(pose, pose.R_cw[:, 2]))}, seconds=300, people=2)
    assert max(test.score for window in found.windows for test in window.tests) < WatchOptions().threshold
    assert [(move.camera, move.others, move.moment) for move in found.moves] == [("C6", (), None)]
    assert {test.camera for one in found.whole for test in one.tests} == set(range(16))


@pytest.mark.slow
def test_moves_in_two_rooms_are_found_as_by_each_room_alone():
    turns = {"C2": (100.0, (0, 1, 0)), "C16": (70.0, (0.8, 0, 0.6))}
    knocks = {name: (seconds, knocked(RIG[name].pose, turn)) for name, (seconds, turn) in turns.items()}
    found = watched(knocks)
    assert {move.camera for move in found.moves} == set(knocks)
    assert all(move.others == () for move in found.moves)
    room = Rig(GIVEN.cameras[:4])
    seen = with_clocks(walkers_in_rooms(RIG, knocks=knocks))
    part = replace(seen, cameras={n: seen[n] for n in room.names}, clocks={n: seen.clocks[n] for n in room.names})
    alone, _ = watch_footage(room, part, WatchOptions(), known=True)
    (own,) = [move for move in found.moves if move.camera == "C2"]
    (other,) = alone.moves
    assert abs(own.moment.seconds - other.moment.seconds) <= 3
    assert np.linalg.norm(own.pose.centre - other.pose.centre) < 3 * other.sigma.position_m
    early = [move for move in found.moves if move.camera == "C16"]
    assert 70 < early[0].noticed_s <= 130


@pytest.mark.slow
def test_two_neighbours_that_moved_are_named_and_the_others_are_not():
    knocks = {name: (0.0, knocked(RIG[name].pose, turn)) for name, turn in (("C5", (0, 3, 0)), ("C6", (2, 0, -2)))}
    found = watched(knocks)
    named = {move.camera for move in found.moves} | {name for move in found.moves for name in move.others}
    assert {"C5", "C6"} <= named <= {"C5", "C6", "C7", "C8"}


@pytest.mark.parametrize("people", [0, 1])
def test_cameras_with_few_or_no_people_say_nothing(people):
    found = watched(seconds=10, people=people)
    assert found.moves == ()
    assert not any(window.clear(camera) for window in found.windows for camera in range(16))


@pytest.mark.slow
def test_the_result_is_the_same_in_one_thread_and_in_two(tmp_path):
    seen = walkers_in_rooms(RIG, 60, knocks={"C7": (0.0, knocked(RIG["C7"].pose, (0, 3, 0)))})
    rig, scene = write_watched(tmp_path, GIVEN, seen, known=False)
    alone = monitor(read_given(rig), scene).to_dict()
    with ThreadPoolExecutor(2) as executor:
        assert monitor(read_given(rig), scene, executor=executor).to_dict() == alone
    assert [move["camera"] for move in alone["moves"]] == ["C7"]
    assert "NaN" not in json.dumps(alone)


@pytest.mark.slow
def test_cameras_without_a_neighbour_cannot_be_tested(tmp_path, capsys):
    far = replace(RIG["C16"], pose=Pose.from_centre(RIG["C16"].pose.R_cw, RIG["C16"].pose.centre + [500.0, 0, 0]))
    apart = replace(GIVEN, cameras=(*GIVEN.cameras[:15], replace(far, sigma=GIVEN["C16"].sigma)))
    paths = write_watched(tmp_path, apart, walkers_in_rooms(RIG, 60))
    assert run(["monitor", *map(str, paths), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert {one["name"]: one["state"] for one in told["cameras"]} == dict.fromkeys(RIG.names, "steady") | {"C16": "cannot tell"}
    assert told["ground"] is None
