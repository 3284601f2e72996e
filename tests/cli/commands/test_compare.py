"""`passerby compare`, from files."""

import json

import pytest

from passerby.cli.main import run
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.simulation import SimulationOptions, simulate, write_scene

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    write_scene(simulate(SimulationOptions(preset="terrace", seed=961, seconds=30.0, box_noise=0.01)), folder / "scene")
    assert run(["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(folder / "out"), "--no-report"]) == 0
    return folder


def test_a_rig_against_the_true_one_on_the_people_of_a_folder(folder, capsys):
    capsys.readouterr()
    asked = ["compare", str(folder / "scene" / "truth.toml"), str(folder / "out"), str(folder / "out"), "--shape"]
    assert run(asked) == 0
    told = capsys.readouterr().out
    assert "median distance of people from where the other cameras put them" in told
    assert "stretches of 10 s" in told
    assert run([*asked, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["cameras"]) == {"C1", "C2", "C3", "C4"}
    assert found["first"]["median_px"] == pytest.approx(found["second"]["median_px"], rel=0.1)


def test_the_people_of_a_scene_file(folder, capsys):
    rig = read_rig(folder / "out" / "rig.toml")
    write_rig(folder / "shrunk.toml", rig.moved([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 0.3], 0.9))
    capsys.readouterr()
    scene = folder / "scene" / "scene.toml"
    assert run(["compare", str(folder / "out" / "rig.toml"), str(folder / "shrunk.toml"), str(scene), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["difference_px"] > 0


def test_a_missing_rig(folder, capsys):
    out = str(folder / "out")
    assert run(["compare", str(folder / "none.toml"), out, out]) == 2
    assert "none.toml: no such file" in capsys.readouterr().err
