"""Cameras without new footage are not read again: what the last run found of them is taken over, and said to be."""

import json
import os

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.interchange.rig_toml import read_rig
from support.scenes.walkers_for_monitor import calibrated, knocked, true_rig, walkers, write_watched

RIG = true_rig()
GIVEN = calibrated(RIG)
AFTER = knocked(RIG["C2"].pose, (0, 3, 0))


def monitored(rig, scene, out, capsys, *options):
    status = run(["monitor", str(rig), str(scene), "-o", str(out), "--json", *options])
    printed = capsys.readouterr()
    return status, json.loads(printed.out), printed.err


def touched(path, seconds):
    os.utime(path, (path.stat().st_mtime + seconds,) * 2)


def unreadable(folder, *names):
    """Nothing could be read from the footage of these cameras, which is as old as before."""
    for name in names:
        path = folder / f"{name}.txt"
        stat = path.stat()
        path.write_bytes(b"?" * stat.st_size)
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


@pytest.fixture
def quiet(tmp_path):
    return write_watched(tmp_path, GIVEN, walkers(RIG, 90))


@pytest.fixture
def moved(tmp_path):
    return write_watched(tmp_path, GIVEN, walkers(RIG, 90, knocks={"C2": (0.0, AFTER)}))


def carried(told):
    return [one["carried"] for one in told["cameras"]]


def test_only_cameras_with_news_are_read_and_a_camera_that_is_not_in_the_rig_is_an_error_later_too(quiet, tmp_path, capsys):
    out = tmp_path / "out"
    status, first, _ = monitored(*quiet, out, capsys)
    assert (status, any(carried(first))) == (0, False)
    touched(tmp_path / "C1.txt", 60)
    status, told, said = monitored(*quiet, out, capsys)
    assert status == 0
    assert [one["state"] for one in told["cameras"]] == ["steady"] * 4
    assert "camera C1: no neighbour has new footage" in said
    touched(tmp_path / "C2.txt", 60)
    _, told, said = monitored(*quiet, out, capsys)
    assert carried(told) == [False, False, True, True]
    assert "no neighbour" not in said
    for name in ("C1", "C3", "C4"):
        touched(tmp_path / f"{name}.txt", 120)
    unreadable(tmp_path, "C2")
    status, third, _ = monitored(*quiet, out, capsys)
    assert (status, carried(third)) == (0, [False, True, False, False])
    assert [set(window["cameras"]) for window in third["windows"]] == [{"C1", "C3", "C4"}] * len(third["windows"])
    assert third["cameras"][0]["as_of"] > third["cameras"][1]["as_of"]
    unreadable(tmp_path, *RIG.names)
    status, last, said = monitored(*quiet, out, capsys)
    assert status == 0
    assert "4 cameras have no new footage since the last run" in said
    assert last["cameras"] == [one | {"carried": True} for one in third["cameras"]]
    assert last["windows"] == []
    quiet[1].write_text(quiet[1].read_text().replace("[cameras.C3]", "[cameras.C9]"))
    assert run(["monitor", *map(str, quiet), "-o", str(out)]) == 2
    assert "camera C9 is not in the rig" in capsys.readouterr().err


@pytest.mark.slow
def test_a_move_and_its_pose_are_taken_over(moved, tmp_path, capsys):
    status, first, _ = monitored(*moved, tmp_path / "out", capsys)
    assert status == 3
    pose = read_rig(tmp_path / "out" / "rig.toml")["C2"].pose
    for name in ("C1", "C3", "C4"):
        touched(tmp_path / f"{name}.txt", 60)
    assert run(["monitor", str(moved[0]), str(moved[1]), "-o", str(tmp_path / "out")]) == 3
    printed = capsys.readouterr().out
    assert "C2 moved before the footage began, by" in printed
    assert "noticed in an earlier run at" in printed
    told = json.loads((tmp_path / "out" / "monitor.json").read_text())
    assert [one["state"] for one in told["cameras"]] == ["steady", "moved", "steady", "steady"]
    assert told["moves"] == [first["moves"][0] | {"carried": True}]
    again = read_rig(tmp_path / "out" / "rig.toml")["C2"].pose
    assert np.allclose(again.R_cw, pose.R_cw, atol=1e-12)
    assert np.allclose(again.centre, pose.centre, atol=1e-12)


@pytest.mark.slow
def test_a_move_is_not_forgotten_where_new_footage_shows_no_people(moved, tmp_path, capsys):
    monitored(*moved, tmp_path / "out", capsys)
    write_watched(tmp_path, GIVEN, walkers(RIG, 10, people=1))
    status, told, said = monitored(*moved, tmp_path / "out", capsys)
    assert status == 3
    assert [one["state"] for one in told["cameras"]] == ["cannot tell", "moved", "cannot tell", "cannot tell"]
    assert "camera C2: too few people in the new footage: what the last run found is taken over" in said
    assert [one["camera"] for one in told["moves"]] == ["C2"]
    # Its news were read: the next run does not read them again.
    assert all(one["carried"] for one in monitored(*moved, tmp_path / "out", capsys)[1]["cameras"])


@pytest.mark.slow
def test_a_scene_of_the_cameras_with_news_alone_will_do(quiet, tmp_path, capsys):
    monitored(*quiet, tmp_path / "out", capsys)
    parts = quiet[1].read_text().split("[cameras.")
    quiet[1].write_text("[cameras.".join([parts[0], *parts[1:4]]))
    for name in ("C1", "C2", "C3"):
        touched(tmp_path / f"{name}.txt", 60)
    status, told, said = monitored(*quiet, tmp_path / "out", capsys)
    assert status == 0
    assert carried(told) == [False, False, False, True]
    assert "no footage here" not in said


@pytest.mark.slow
@pytest.mark.parametrize("change", ["rig", "every", "in_step"])
def test_another_rig_or_other_options_are_monitored_anew(quiet, tmp_path, capsys, change):
    monitored(*quiet, tmp_path / "out", capsys)
    if change == "rig":
        passerby.write_rig(quiet[0], calibrated(RIG, seed=3))
    options = {"rig": [], "every": ["--every", "45"], "in_step": ["--in-step"]}[change]
    _, told, said = monitored(*quiet, tmp_path / "out", capsys, *options)
    assert not any(carried(told))
    assert "last run" not in said


@pytest.mark.parametrize("broken", ["monitor.json", "rig.toml"])
def test_a_broken_earlier_run_is_said_and_everything_is_monitored(quiet, tmp_path, capsys, broken):
    monitored(*quiet, tmp_path / "out", capsys)
    (tmp_path / "out" / broken).write_text("{")
    status, told, said = monitored(*quiet, tmp_path / "out", capsys)
    assert status == 0
    assert "what the last run wrote there cannot be read" in said
    assert not any(carried(told))
