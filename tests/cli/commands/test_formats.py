"""`passerby export`, `import` and `formats`, as they are typed."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Clock, Observations
from passerby.core.trajectories import Trajectories
from passerby.interchange.coco import read_keypoints
from passerby.interchange.formats import MODULES
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.interchange.trajectories_csv import write_trajectories
from passerby.simulation import SimulationOptions, simulate, write_scene
from support.scenes.people_and_rigs import looking_at

pytestmark = pytest.mark.smoke

MATRIX = np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]])


@pytest.fixture
def rig(tmp_path):
    """Three cameras, the last without a pose; `bent` has a distortion."""
    straight, bent = Lens((640, 480), MATRIX, np.zeros(5)), Lens((640, 480), MATRIX, np.array([-0.2, 0.05, 0, 0, 0]))
    poses = [looking_at(np.array(centre), np.zeros(3)) for centre in ((6.0, 0, 2.5), (0, 5.0, 3))]
    path = tmp_path / "rig.toml"
    cameras = (Camera("gate", straight, poses[0]), Camera("bent", bent, poses[1]), Camera("lost", straight))
    write_rig(path, Rig(cameras, "doubtful"))
    return path


def test_there_and_back_again(rig, tmp_path, capsys):
    out, back = tmp_path / "opencv", tmp_path / "back.toml"
    assert run(["export", str(rig), "--format", "opencv", "-o", str(out)]) == 0
    told = capsys.readouterr()
    assert told.out == f"written to {out}\n"
    assert "is from a calibration, which is doubtful" in told.err
    assert run(["import", str(out), "--format", "opencv", "-o", str(back)]) == 0
    assert "3 cameras, 2 with poses" in capsys.readouterr().out
    for camera in read_rig(rig).posed():
        np.testing.assert_allclose(read_rig(back)[camera.name].centre, camera.centre, atol=1e-9)


def test_what_is_lost_is_an_error_unless_it_is_allowed(rig, tmp_path, capsys):
    out = tmp_path / "cams.json"
    assert run(["export", str(rig), "--format", "amc", "-o", str(out)]) == 2
    told = capsys.readouterr()
    assert not told.out
    assert "camera lost has no pose and is left out" in told.err
    assert "--lossy" in told.err
    assert not out.exists()
    assert run(["export", str(rig), "--format", "amc", "-o", str(out), "--lossy"]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note: lost: ")]
    assert len(notes) == 2
    assert "camera bent" in " ".join(notes)


def test_peoples_ways_go_along(rig, tmp_path, capsys):
    frame, clock, ones = np.arange(1, 6), Clock(5.0), np.ones(5, dtype=int)
    ways = Trajectories(7 * ones, frame, clock.seconds(frame), np.full((5, 3), 0.5), np.full(5, 0.1), 2 * ones, ones, clock)
    write_trajectories(tmp_path / "trajectories.csv", ways)
    export = ["export", str(rig), "--format", "ply", "--lossy", "-o"]
    assert run([*export, str(tmp_path / "with.ply"), "--tracks", str(tmp_path / "trajectories.csv")]) == 0
    assert run([*export, str(tmp_path / "without.ply")]) == 0
    assert (tmp_path / "with.ply").stat().st_size > (tmp_path / "without.ply").stat().st_size
    assert run([*export, str(tmp_path / "no.ply"), "--tracks", str(tmp_path / "none.csv")]) == 2
    assert "give trajectories.csv" in capsys.readouterr().err


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """An output folder, and the folder of its scene."""
    folder = tmp_path_factory.mktemp("export")
    scene = write_scene(simulate(SimulationOptions(seconds=12.0, box_noise=0.02, seed=4)), folder / "scene")
    passerby.calibrate(scene).write(folder / "out")
    return folder / "out"


@pytest.mark.slow
def test_the_people_of_a_calibration_are_drawn_unasked(calibrated, tmp_path, capsys):
    for form in ("ply", "gltf", "glb"):
        asked, unasked, rig_only, python = (tmp_path / f"{name}.{form}" for name in ("asked", "unasked", "rig", "python"))
        command = ["export", "--format", form, "--lossy", "--name", "x"]
        assert run([*command, str(calibrated), "-o", str(asked), "--tracks", str(calibrated)]) == 0
        assert run([*command, str(calibrated), "-o", str(unasked)]) == 0
        assert run([*command, str(calibrated / "rig.toml"), "-o", str(rig_only)]) == 0
        assert asked.read_bytes() == unasked.read_bytes()
        assert len(rig_only.read_bytes()) < len(unasked.read_bytes())
        assert "no people" not in capsys.readouterr().err
        for given, same in (
            (str(calibrated), asked), (passerby.read_calibration(calibrated), asked),
            (passerby.read_rig(calibrated / "rig.toml"), rig_only),
        ):  # fmt: skip
            passerby.export_rig(given, form, python, name="x", lossy=True)
            assert python.read_bytes() == same.read_bytes()
    fresh = passerby.calibrate(calibrated.parent / "scene" / "scene.toml")
    passerby.export_rig(fresh, "ply", tmp_path / "fresh.ply", lossy=True)
    passerby.export_rig(fresh.rig, "ply", tmp_path / "rig.ply", lossy=True)
    assert len((tmp_path / "fresh.ply").read_bytes()) > len((tmp_path / "rig.ply").read_bytes())
    lost = replace(fresh, observations=Observations({}))
    assert "no people are drawn: " in passerby.export_rig(lost, "ply", tmp_path / "lost.ply", lossy=True)[-1]


def test_an_export_notes_that_no_people_can_be_drawn(calibrated, tmp_path, capsys):
    """A folder without boxes, as of a calibration by keypoints, is still exported."""
    out = tmp_path / "out"
    shutil.copytree(calibrated, out)
    for path in (out / "tracks").iterdir():
        path.unlink()
    report = json.loads((out / "calibration.json").read_text())
    report["files"] = {name: value for name, value in report["files"].items() if not name.startswith("tracks")}
    (out / "calibration.json").write_text(json.dumps(report | {"cameras": [one | {"boxes": 0} for one in report["cameras"]]}))
    assert run(["export", str(out), "--format", "ply", "-o", str(tmp_path / "a.ply"), "--lossy"]) == 0
    assert f"note: no people are drawn: {out / 'tracks'}: holds no box" in capsys.readouterr().err
    assert "no people are drawn: " in passerby.export_rig(out, "ply", tmp_path / "b.ply", lossy=True)[-1]
    assert run(["export", str(out), "--format", "opencv", "-o", str(tmp_path / "cv"), "--lossy"]) == 0
    assert "no people" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["export", "RIG", "--format", "colmpa", "-o", "x"], "did you mean 'colmap'?"),
        (["export", "RIG", "--format", "tsai", "-o", "x"], "format tsai is only read"),
        (["import", "RIG", "--format", "ply", "-o", "x.toml"], "format ply holds no cameras that can be read"),
        (["import", "RIG", "--format", "anipose", "-o", "x.json"], "name it x.toml"),
        (["import", "RIG", "--format", "anipose", "-o", "x.toml", "--size", "wide"], "--size 'wide'"),
        (["import", "RIG", "--format", "anipose", "-o", "x.toml", "--units", "feet"], "--units 'feet'"),
        (["formats", "colmpa"], "did you mean 'colmap'?"),
    ],
)
def test_a_wrong_format_or_option_is_one_line_of_error(rig, tmp_path, monkeypatch, capsys, arguments, told):
    monkeypatch.chdir(tmp_path)
    assert run([str(rig) if word == "RIG" else word for word in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.toml"]


def test_people_are_no_cameras(tmp_path, capsys):
    (tmp_path / "joints").mkdir()
    text = json.dumps({"people": [{"pose_keypoints_2d": [10.0, 20.0, 0.9] * 25}]})
    (tmp_path / "joints" / "a_000000000000_keypoints.json").write_text(text)
    command = ["import", str(tmp_path / "joints"), "--format", "openpose", "-o"]
    assert run([*command, str(tmp_path / "C1.toml")]) == 2
    assert "there are 1 skeletons, which a .json file takes" in capsys.readouterr().err
    assert run([*command, str(tmp_path / "C1.json")]) == 0
    assert read_keypoints(tmp_path / "C1.json").frame.tolist() == [1]


@pytest.mark.slow
def test_every_format_is_listed(capsys):
    assert run(["formats"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()[: len(MODULES)]]
    assert listed == list(MODULES)
    assert run(["formats", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["formats"]
    assert [one["name"] for one in told] == list(MODULES)
    for name in MODULES:
        assert run(["formats", name]) == 0
        assert capsys.readouterr().out.startswith(f"{name}: ")
