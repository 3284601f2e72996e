"""`passerby monitor` and `passerby.monitor`: names, files, exit status; the output leaves other cameras and groups alone."""

import json
import re
import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.interchange.rig_toml import read_rig
from support.scenes.rooms_for_monitor import rooms, walkers_in_rooms
from support.scenes.walkers_for_monitor import calibrated, knocked, true_rig, walkers, write_watched

RIG = true_rig()
GIVEN = calibrated(RIG)
AFTER = knocked(RIG["C2"].pose, (0, 2, 0))


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    return write_watched(tmp_path_factory.mktemp("moved"), GIVEN, walkers(RIG, 160, knocks={"C2": (90.0, AFTER)}), known=False)


@pytest.mark.slow
def test_a_knock_without_identities(moved, tmp_path, capsys):
    rig, scene = moved
    assert run(["monitor", str(rig), str(scene), "-o", str(tmp_path / "out")]) == 3
    printed = capsys.readouterr().out
    assert "C2 moved at 00:01:" in printed
    assert printed.count("steady") == 3
    old, new = (tomllib.loads(path.read_text()) for path in (rig, tmp_path / "out" / "rig.toml"))
    assert {name for name in old if old[name] != new[name]} == {"C2"}
    assert {key for key in old["C2"] if old["C2"][key] != new["C2"][key]} == {
        "rotation", "translation", "position_sigma_mm", "orientation_sigma_deg", "covariance"
    }  # fmt: skip
    camera = read_rig(tmp_path / "out" / "rig.toml")["C2"]
    assert np.linalg.norm(camera.centre - AFTER.centre) < 3 * camera.sigma.position_m
    told = json.loads((tmp_path / "out" / "monitor.json").read_text())
    assert [move["camera"] for move in told["moves"]] == ["C2"]
    assert told["exit_status"] == 3


def test_a_quiet_rig(tmp_path, capsys):
    rig, scene = write_watched(tmp_path, GIVEN, walkers(RIG, 120))
    assert run(["monitor", str(rig), str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["thinning"] is None, "small rigs are not thinned unless asked"
    assert [camera["state"] for camera in told["cameras"]] == ["steady"] * 4
    assert all(0 < camera["smallest_turn_deg"] < camera["worst_turn_deg"] < 3 for camera in told["cameras"])
    (whole,) = told["whole"]
    assert list(whole["cameras"]) == list(RIG.names)
    for camera in told["cameras"]:
        # All the footage shows smaller moves than one window.
        assert whole["cameras"][camera["name"]]["worst_turn_deg"] < camera["worst_turn_deg"]
    assert run(["monitor", str(rig), str(scene)]) == 0
    rows = {row[0]: row[-2:] for row in map(str.split, capsys.readouterr().out.splitlines()) if row and row[0] in RIG.names}
    assert rows == {
        camera["name"]: [f"{camera['worst_shift_m']:.2f}", f"{camera['worst_turn_deg']:.1f}"] for camera in told["cameras"]
    }  # fmt: skip
    found = passerby.monitor(rig, scene)
    assert (found.exit_status, found.sentences(), found.changed) == (0, [], ())
    assert all(new is old for new, old in zip(found.rig, found.given, strict=True))


def test_too_few_people(tmp_path, capsys):
    rig, scene = write_watched(tmp_path, GIVEN, walkers(RIG, 10, people=1))
    assert run(["monitor", str(rig), str(scene)]) == 3
    printed = capsys.readouterr().out
    assert printed.count("cannot tell: not enough people") == 4
    assert "steady" not in printed


def test_footage_and_rigs_that_do_not_fit_are_named(tmp_path):
    rig, scene = write_watched(tmp_path, GIVEN, walkers(RIG, 10))
    rig_text, text = rig.read_text(), scene.read_text()
    (tmp_path / "small.toml").write_text(rig_text.replace("720", "1440", 1).replace("576", "1152", 1))
    unnamed = text.replace("[cameras.C3]", "[cameras.C7]").replace('rig.toml"\ntracks = "C3', 'other.toml"\ntracks = "C3')
    unposed = [replace(camera, pose=None, sigma=None) if camera.name != "C1" else camera for camera in GIVEN]
    for changed, cameras, message in (
        (unnamed, GIVEN, "camera C7 is not in the rig, which has C1, C2, C3, C4"),
        (text.replace("rig.toml", "small.toml", 1), GIVEN, "camera C1 has images of 1440 x 1152, the rig's of 720 x 576"),
        (re.sub("(?m)^fps = .*$", "", text), GIVEN, r"under \[scene\] set fps to it"),
        (text, unposed, "only C1 has a pose in the rig: two or more"),
    ):
        scene.write_text(changed)
        passerby.write_rig(rig, passerby.Rig(tuple(cameras)))
        with pytest.raises(InputError, match=message):
            passerby.monitor(rig, scene)


def test_a_calibration_is_not_overwritten(moved, tmp_path, capsys):
    (tmp_path / "calibration.json").write_text("{}")
    assert run(["monitor", *map(str, moved), "-o", str(tmp_path)]) == 2
    assert "holds a calibration" in capsys.readouterr().err
    assert run(["monitor", *map(str, moved), "--every", "1"]) == 2


TWO_ROOMS = rooms(2)
KNOWN = calibrated(TWO_ROOMS)


@pytest.fixture
def site(tmp_path):
    """A folder with two groups, the main rig file with the other's cameras, too; a scene of both, where C6 has moved."""
    seen = walkers_in_rooms(TWO_ROOMS, 90, knocks={"C6": (0.0, knocked(TWO_ROOMS["C6"].pose, (0, 3, 0)))})
    _, scene = write_watched(tmp_path, KNOWN, seen)
    for folder, own in (("out", KNOWN.names[:4]), ("out/groups/2", KNOWN.names[4:])):
        (tmp_path / folder).mkdir(parents=True)
        cameras = [c if c.name in own else replace(c, pose=None, sigma=None) for c in KNOWN if folder == "out" or c.name in own]
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
    assert not (new["C6"].centre == KNOWN["C6"].centre).all()
    # What was written is monitored as what was calibrated.
    assert run(["monitor", str(tmp_path / "checked"), str(site[1])]) == 0


@pytest.mark.slow
def test_the_json_has_all_groups_and_cameras_without_news_are_those_of_each(site, tmp_path, capsys):
    assert run(["monitor", *map(str, site), "-o", str(tmp_path / "checked"), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert [one["state"] for one in told["cameras"]] == ["steady"] * 4
    (group,) = told["groups"]
    assert (group["group"], group["folder"]) == (2, "groups/2")
    assert [one["state"] for one in group["cameras"]] == ["steady", "moved", "steady", "steady"]
    assert run(["monitor", *map(str, site), "-o", str(tmp_path / "checked"), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert all(one["carried"] for part in (told, *told["groups"]) for one in part["cameras"])


def test_groups_without_footage_are_left_out(site, tmp_path, capsys):
    seen = walkers_in_rooms(TWO_ROOMS, 90)
    (tmp_path / "half").mkdir()
    _, scene = write_watched(
        tmp_path / "half", KNOWN, Observations({name: seen[name] for name in TWO_ROOMS.names[4:]}, seen.fps)
    )
    assert run(["monitor", str(site[0]), str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["folder"], "groups" in told) == ("groups/2", False)
    # A folder of one group is a rig as before.
    shutil.rmtree(site[0] / "groups")
    run(["monitor", *map(str, site)])
    assert "group" not in capsys.readouterr().out


def test_one_camera_of_each_group_or_of_none_is_one_line(site, tmp_path, capsys):
    (tmp_path / "two").mkdir()
    seen = Observations({name: CameraObservations() for name in ("C1", "C5")}, 2.0)
    _, scene = write_watched(tmp_path / "two", KNOWN, seen)
    site[1].write_text(site[1].read_text().replace("[cameras.C8]", "[cameras.C80]"))
    for path, message in ((scene, ""), (site[1], "camera C80 is not in the rig, which has C1, C2")):
        assert run(["monitor", str(site[0]), str(path)]) == 2
        printed = capsys.readouterr().err
        assert message in printed
        assert printed.count("\n") == 1
