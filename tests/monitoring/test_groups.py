"""A calibration in groups: `passerby monitor out today.toml` takes the cameras of all groups, each with its own rig."""

import json
import shutil
from dataclasses import replace

import pytest

import passerby
from passerby.cli.main import run
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.interchange.rig_toml import read_rig
from support.scenes.rooms_for_monitor import rooms, walkers_in_rooms
from support.scenes.walkers_for_monitor import calibrated, knocked, write_watched

RIG = rooms(2)
GIVEN = calibrated(RIG)


@pytest.fixture
def site(tmp_path):
    """A folder with two groups, the main rig file with the other's cameras, too; a scene of both, where C6 has moved."""
    seen = walkers_in_rooms(RIG, 90, knocks={"C6": (0.0, knocked(RIG["C6"].pose, (0, 3, 0)))})
    _, scene = write_watched(tmp_path, GIVEN, seen)
    for folder, own in (("out", GIVEN.names[:4]), ("out/groups/2", GIVEN.names[4:])):
        (tmp_path / folder).mkdir(parents=True)
        cameras = [c if c.name in own else replace(c, pose=None, sigma=None) for c in GIVEN if folder == "out" or c.name in own]
        passerby.write_rig(tmp_path / folder / "rig.toml", Rig(tuple(cameras)))
    return tmp_path / "out", scene


def test_all_groups_are_monitored(site, tmp_path, capsys):
    assert run(["monitor", *map(str, site), "-o", str(tmp_path / "checked")]) == 3
    printed = capsys.readouterr()
    assert printed.out.count("group ") == 2
    assert printed.out.count("steady") == 7
    assert "C6 moved before the footage began" in printed.out
    assert "no pose" not in printed.err
    told = json.loads((tmp_path / "checked" / "groups" / "2" / "monitor.json").read_text())
    assert [one["name"] for one in told["cameras"]] == ["C5", "C6", "C7", "C8"]
    new = read_rig(tmp_path / "checked" / "groups" / "2" / "rig.toml")
    assert not (new["C6"].centre == GIVEN["C6"].centre).all()
    # What was written is monitored as what was calibrated.
    assert run(["monitor", str(tmp_path / "checked"), str(site[1])]) == 0


@pytest.mark.slow
def test_the_json_has_all_groups(site, capsys):
    assert run(["monitor", *map(str, site), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert [one["state"] for one in told["cameras"]] == ["steady"] * 4
    (group,) = told["groups"]
    assert (group["group"], group["folder"]) == (2, "groups/2")
    assert [one["state"] for one in group["cameras"]] == ["steady", "moved", "steady", "steady"]


def test_groups_without_footage_are_left_out(site, tmp_path, capsys):
    seen = walkers_in_rooms(RIG, 90)
    (tmp_path / "half").mkdir()
    _, scene = write_watched(tmp_path / "half", GIVEN, Observations({name: seen[name] for name in RIG.names[4:]}, seen.fps))
    assert run(["monitor", str(site[0]), str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["folder"], "groups" in told) == ("groups/2", False)
    # A folder of one group is a rig as before.
    shutil.rmtree(site[0] / "groups")
    run(["monitor", *map(str, site)])
    assert "group" not in capsys.readouterr().out


@pytest.mark.slow
def test_cameras_without_news_are_those_of_each_group(site, tmp_path, capsys):
    run(["monitor", *map(str, site), "-o", str(tmp_path / "checked")])
    capsys.readouterr()
    assert run(["monitor", *map(str, site), "-o", str(tmp_path / "checked"), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert all(one["carried"] for part in (told, *told["groups"]) for one in part["cameras"])


def test_one_camera_of_each_group_or_of_none_is_one_line(site, tmp_path, capsys):
    (tmp_path / "two").mkdir()
    seen = Observations({name: CameraObservations() for name in ("C1", "C5")}, 2.0)
    _, scene = write_watched(tmp_path / "two", GIVEN, seen)
    site[1].write_text(site[1].read_text().replace("[cameras.C8]", "[cameras.C80]"))
    for path, told in ((scene, ""), (site[1], "camera C80 is not in the rig, which has C1, C2")):
        assert run(["monitor", str(site[0]), str(path)]) == 2
        printed = capsys.readouterr().err
        assert told in printed
        assert printed.count("\n") == 1
