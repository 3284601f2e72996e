"""`passerby monitor` and `passerby.monitor`: names, files, exit status; the output leaves other cameras alone."""

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.interchange.rig_toml import read_rig
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


def test_what_cannot_be_monitored(tmp_path):
    rig, scene = write_watched(tmp_path, GIVEN, walkers(RIG, 10))
    rig_text, text = rig.read_text(), scene.read_text()
    (tmp_path / "small.toml").write_text(rig_text.replace("720", "1440", 1).replace("576", "1152", 1))
    unnamed = text.replace("[cameras.C3]", "[cameras.C7]").replace('rig.toml"\ntracks = "C3', 'other.toml"\ntracks = "C3')
    for changed, told in (
        (unnamed, "camera C7 is not in the rig, which has C1, C2, C3, C4"),
        (text.replace("rig.toml", "small.toml", 1), "camera C1 has images of 1440 x 1152, the rig's of 720 x 576"),
        (re.sub("(?m)^fps = .*$", "", text), r"under \[scene\] set fps to it"),
    ):
        scene.write_text(changed)
        with pytest.raises(InputError, match=told):
            passerby.monitor(rig, scene)
    scene.write_text(text)
    unposed = [replace(camera, pose=None, sigma=None) if camera.name != "C1" else camera for camera in GIVEN]
    passerby.write_rig(rig, passerby.Rig(tuple(unposed)))
    with pytest.raises(InputError, match="only C1 has a pose in the rig: two or more"):
        passerby.monitor(rig, scene)


def test_a_calibration_is_not_overwritten(moved, tmp_path, capsys):
    (tmp_path / "calibration.json").write_text("{}")
    assert run(["monitor", *map(str, moved), "-o", str(tmp_path)]) == 2
    assert "holds a calibration" in capsys.readouterr().err
    assert run(["monitor", *map(str, moved), "--every", "1"]) == 2
