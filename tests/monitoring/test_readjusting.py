"""Footage with joints: the cameras of a window are adjusted anew, and those that were turned are named, most of them or one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import monitor_room
from passerby.cli.main import run
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.geometry.rotations import angle_between, chordal_mean_rotation
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.monitoring.monitor import watch_footage
from passerby.monitoring.result import MonitoringResult
from passerby.monitoring.watched import WatchOptions
from passerby.monitoring.watching import joints_are_shared
from passerby.people.sightings import poses_of
from passerby.solver import readjustment
from passerby.solver.initialisation import PeopleOptions
from passerby.solver.readjustment import readjust
from reliability.footage import Move, calibrated
from reliability.room import FPS, RoomOptions, filmed_room, room_rig

SEED = 7
RIG = room_rig(SEED)
GIVEN = calibrated(RIG, np.random.default_rng(SEED))
TURNS = {"C1": (0.0, 2.0, 0.0), "C2": (-1.0, 0.0, 1.5), "C4": (0.5, -2.5, 0.0)}
FEW = PeopleOptions(max_sightings=2000, max_joints=4000)


def moves(turns, seconds=-1.0):
    return {name: (seconds, Move(name, seconds, turn_deg=turn).after(RIG[name].pose)) for name, turn in turns.items()}


def film(turns, seconds=12.0, at=-1.0, **options):
    seen = filmed_room(RIG, RoomOptions(SEED, seconds, moves=moves(turns, at), **options))
    return replace(seen, clocks={name: Clock(FPS) for name in RIG.names})


def watched(seen, rig=GIVEN):
    options = WatchOptions()
    found, ground = watch_footage(rig, seen, options, known=True)
    return MonitoringResult(rig, found, options, ground)


@pytest.fixture(scope="module")
def turned():
    return film(TURNS)


@pytest.fixture(scope="module")
def found(turned):
    return watched(turned)


@pytest.mark.slow
def test_a_rig_is_found_again_from_cameras_that_turned(turned):
    """But for a common turn of all cameras."""
    after = moves(TURNS)
    now = replace(RIG, cameras=tuple(replace(c, pose=after[c.name][1]) if c.name in after else c for c in RIG))
    estimate = readjust(GIVEN, turned, np.random.default_rng(0), stretch_s=6.0, options=FEW)
    for rig, low, high in ((GIVEN, 1, np.inf), (now, 0, 0.2)):
        R = poses_of(rig, rig.names)[0]
        common = chordal_mean_rotation(np.einsum("cji,cjk->cik", estimate.R, R))
        assert low < np.degrees(angle_between(estimate.R @ common, R).max()) < high
    assert estimate.loose == ()
    assert estimate.covariance.shape == (24, 24)
    # Three people for 12 s: two stretches each, or three where they begin within one.
    assert (estimate.stretches >= 4).all()
    assert (estimate.stretches <= 9).all()


def test_stretches_are_of_people_that_two_cameras_saw():
    """Camera 0 saw person 0 at frames 0, 5, 12 and, alone, at 30, camera 1 at the first three; both saw person 1 at 7."""
    sightings = SimpleNamespace(camera=np.array([0, 1, 0, 1, 0, 1, 0, 0, 1]), block=np.array([0, 0, 1, 1, 2, 2, 3, 4, 4]))
    fit = SimpleNamespace(model=SimpleNamespace(blocks=np.array([1, 2, 3, 4, 0]), problem=SimpleNamespace(sightings=sightings)))
    evidence = SimpleNamespace(frame=np.array([7, 0, 5, 12, 30]), person=np.array([1, 0, 0, 0, 0]), n_cameras=3)
    assert readjustment._stretches(fit, evidence, 10.0).tolist() == [3, 3, 0]
    assert readjustment._stretches(fit, evidence, 100.0).tolist() == [2, 2, 0]


@pytest.mark.slow
def test_most_cameras_turned_are_named(found):
    assert found.watched.by_joints
    assert [found.state(name) for name in RIG.names] == ["moved", "moved", "steady", "moved"]
    assert found.most_moved == ("C1", "C2", "C4")
    assert "most cameras moved relative to each other (C1, C2, C4): calibrate anew" in found.sentences()
    for move in found.moves:
        assert move.moment is None
        assert np.degrees(move.shift[3:]) == pytest.approx(TURNS[move.camera], abs=0.5)
        assert np.linalg.norm(move.pose.centre - GIVEN[move.camera].centre) < 0.1
    assert found.exit_status == 3
    assert found.to_dict()["most_moved"] == ["C1", "C2", "C4"]
    assert found.to_dict()["by_joints"]
    metres, degrees = found.smallest("C3")
    assert 0.2 < degrees < 2, "what twelve seconds calibrate to"
    assert 0.02 < metres < 0.5


@pytest.mark.slow
def test_a_camera_that_sees_no_people_is_left_out(turned):
    found = watched(replace(turned, cameras={**turned.cameras, "C4": CameraObservations()}))
    assert [found.state(name) for name in RIG.names] == ["moved", "moved", "steady", "cannot tell"]
    assert found.smallest("C4") == (None, None)


def test_joints_now_and_then_are_none_and_nothing_seen_is_no_rig():
    def seen(n_joints, names="AB"):
        frames = np.arange(1, 101)
        boxes = Boxes(frames, np.ones(100), np.tile([10.0, 10, 20, 50], (100, 1)), np.ones(100))
        joints = Keypoints(frames[:n_joints], np.ones(n_joints), np.zeros((n_joints, 17, 2)), np.ones((n_joints, 17)))
        found = {name: CameraObservations(boxes, joints) for name in names}
        return Observations(dict.fromkeys("AB", CameraObservations(boxes)) | found, FPS)

    assert [joints_are_shared(seen(count)) for count in (100, 20, 2, 0)] == [True, True, False, False]
    assert not joints_are_shared(Observations({}, FPS))
    assert not joints_are_shared(seen(100, "A")), "found by one camera alone they say nothing"
    nothing = Observations({name: CameraObservations() for name in RIG.names}, FPS)
    assert readjust(GIVEN, nothing, np.random.default_rng(0), stretch_s=6.0) is None


@pytest.mark.slow
def test_a_camera_that_is_turned_in_mid_footage():
    seen = film({"C2": (0.0, 1.5, 1.0)}, 150.0, 80.0)
    found = watched(seen)
    (move,) = found.moves
    assert (move.camera, move.others) == ("C2", ())
    assert abs(move.moment.seconds - 80) <= 5
    assert 80 < move.noticed_s <= 140
    assert np.degrees(move.shift[3:]) == pytest.approx((0.0, 1.5, 1.0), abs=0.3)
    assert found.most_moved == ()
    again = watched(seen).moves[0]
    assert np.array_equal(move.shift, again.shift)
    assert np.array_equal(move.covariance, again.covariance)


@pytest.mark.slow
def test_minutes_in_which_nothing_moves():
    found = watched(film({}, 180.0, lasting_s=1.0))
    assert found.moves == ()
    assert [found.state(name) for name in RIG.names] == ["steady"] * 4
    assert max(test.score for window in found.watched.windows for test in window.tests) < 3.5
    assert len(found.watched.windows) == 3


@pytest.mark.slow
def test_a_rig_without_sigmas_is_measured_by_its_places():
    exact = replace(RIG, cameras=tuple(replace(camera, sigma=None) for camera in RIG))
    found = watched(film(TURNS, 30.0), exact)
    assert found.most_moved == ("C1", "C2", "C4")
    assert found.state("C3") == "steady"


@pytest.mark.slow
def test_from_files_without_identities(tmp_path, capsys):
    seen = film(TURNS, 30.0)
    write_rig(tmp_path / "rig.toml", GIVEN)
    text = "[scene]\nfps = 10\n[association]\nmode = 'trajectory'\n"
    for name in RIG.names:
        boxes, joints = seen[name].boxes, seen[name].keypoints
        write_boxes(tmp_path / f"{name}.txt", replace(boxes, identity=np.full(len(boxes), -1)))
        write_keypoints(tmp_path / f"{name}.json", replace(joints, identity=np.full(len(joints), -1)))
        text += f"[cameras.{name}]\nintrinsics = 'rig.toml'\ndetections = '{name}.txt'\nkeypoints = '{name}.json'\n"
    (tmp_path / "scene.toml").write_text(text)
    assert run(["monitor", str(tmp_path / "rig.toml"), str(tmp_path / "scene.toml")]) == 3
    printed = capsys.readouterr().out
    assert "by joints and boxes" in printed
    assert "most cameras moved relative to each other (C1, C2, C4): calibrate anew" in printed


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(monitor_room.KINDS))
def test_the_benchmarks_room(kind):
    cases = [monitor_room.work(kind, seed, known=False) for seed in (900_000, 900_001)]
    assert all(case["seen"] == (kind != "quiet") for case in cases)
    assert not any(accused for case in cases for accused in case["accused"])
    assert all(all(case["named"]) for case in cases)
