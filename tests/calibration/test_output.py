"""An output folder is of one calibration, or its readers say that it is not."""

import json
import signal
from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.calibration import Calibration
from passerby.calibration.writing import write_calibration, write_results
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.cameras import Pose, Rig
from passerby.core.figures import SolverFigures
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.interchange.output_folder import read_folder_rig, read_output
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.scene.scene import Scene
from support.faults.dying_process import TOLD, every_moment, hidden, visible
from support.scenes.handmade_files import write_scene

pytestmark = pytest.mark.unit


@pytest.fixture(scope="module")
def calibrations(tmp_path_factory):
    """Two of the same cameras; the second has other poses, and B saw nobody."""
    folder = tmp_path_factory.mktemp("scene")
    scene = Scene.load(write_scene(folder))
    lenses = read_rig(folder / "rig.toml")
    return calibration(scene, lenses, 1.0, ("A", "B")), calibration(scene, lenses, 2.0, ("A",))


def calibration(scene, lenses, height, seeing):
    """As the solver could have made it."""
    people = Boxes(np.array([1, 2]), np.array([1, 2]), np.full((2, 4), 100.0 * height), np.ones(2))
    seen = {
        camera.name: CameraObservations(people if camera.name in seeing else Boxes.empty(), Keypoints.empty())
        for camera in lenses
    }
    posed = tuple(replace(camera, pose=Pose(np.eye(3), np.array([0.0, 0, height]))) for camera in lenses)
    rig = Rig(posed, verdict="accepted")
    return Calibration(scene, rig, "accepted", (), Observations(seen), 0, {}, SolverFigures())


@pytest.fixture
def out(calibrations, tmp_path):
    write_calibration(calibrations[0], tmp_path / "out", report=False)
    return tmp_path / "out"


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["kill", "full"])
def test_the_old_calibration_or_the_new_one(calibrations, out, tmp_path, fault):
    first, second = calibrations
    old = visible(out)
    write_calibration(second, tmp_path / "other", report=False)
    new = visible(tmp_path / "other")
    assert {"tracks/B.txt"} == set(old) - set(new)
    for ended in every_moment(lambda: write_calibration(second, out, report=False), out, fault, 1 if fault == "kill" else 4):
        assert ended == (TOLD if fault == "full" else -signal.SIGKILL)
        read_output(out)
        assert visible(out) in (old, new)
        write_calibration(first, out, report=False)
        assert visible(out) == old
        assert not hidden(out)


def change_text(path):
    path.write_text(path.read_text().replace("0", "1", 1))


def test_a_rig_of_another_calibration_is_told(calibrations, out, tmp_path, capsys):
    write_calibration(calibrations[1], tmp_path / "other", report=False)
    (out / "rig.toml").write_bytes((tmp_path / "other" / "rig.toml").read_bytes())
    for command in (["track", "OUT"], ["report", "OUT"], ["export", "OUT", "-f", "colmap", "-o", str(tmp_path / "colmap")],
                    ["align", "OUT", "-o", "OUT", "--camera", "A"]):  # fmt: skip
        assert run([str(out) if part == "OUT" else part for part in command]) == 2
        assert capsys.readouterr().err == (
            f"error: {out / 'rig.toml'}: is not the file that calibration.json beside it describes: it was changed, is "
            f"damaged, "
            "or is of another calibration: put the right one back, or calibrate again\n"
        )
    assert read_rig(out / "rig.toml")["A"].pose is not None, "by itself it is a rig as any"


@pytest.mark.parametrize("name", ["tracks/A.txt", "tracks/B.txt"])
def test_damaged_tracks_are_told(out, name):
    change_text(out / name)
    with pytest.raises(InputError, match=f"{name}: is not the file that calibration.json beside it describes"):
        read_output(out)


def test_tracks_that_no_calibration_wrote_are_told(calibrations, out):
    write_calibration(calibrations[1], out, report=False)
    assert len(read_output(out).boxes["B"]) == 0
    (out / "tracks" / "B.txt").write_bytes((out / "tracks" / "A.txt").read_bytes())
    with pytest.raises(InputError, match=r"B\.txt: is not the file"):
        read_output(out)


def test_a_folder_of_an_older_passerby_is_read(out):
    told = json.loads((out / "calibration.json").read_text())
    del told["files"]
    (out / "calibration.json").write_text(json.dumps(told))
    change_text(out / "tracks" / "A.txt")
    assert len(read_output(out).rig) == 2


def test_a_folder_with_a_rig_alone_is_read(out, tmp_path):
    write_rig(tmp_path / "rigs" / "rig.toml", read_rig(out / "rig.toml"))
    assert read_folder_rig(tmp_path / "rigs").names == ("A", "B")


@pytest.mark.parametrize(("error", "told"), [(RuntimeError("a bug"), "a bug"), (InputError("no room"), "no room")])
def test_a_report_that_cannot_be_drawn_costs_nothing_else(calibrations, out, monkeypatch, error, told):
    def broken(*arguments):
        raise error

    monkeypatch.setattr("passerby.report.page.write_report", broken)
    with pytest.raises(type(error)) as raised:
        write_results(calibrations[0], out)
    notes = " ".join([str(raised.value), *getattr(raised.value, "__notes__", [])])
    assert told in notes
    assert f"all other results in {out} are complete and can be used; `passerby report {out}` writes the report again" in notes
    assert read_output(out).verdict == "accepted"


def test_tracks_of_cameras_that_are_no_more_go(calibrations, out):
    first = calibrations[0]
    one = replace(first, rig=replace(first.rig, cameras=first.rig.cameras[:1]))
    (out / "tracks" / "mine.txt").write_text("mine")
    write_calibration(one, out, report=False)
    assert sorted(path.name for path in (out / "tracks").iterdir()) == ["A.txt", "mine.txt"]


def test_the_same_bytes_wherever_it_lies(calibrations, out, tmp_path):
    write_calibration(calibrations[0], tmp_path / "elsewhere" / "deep", report=False)
    assert visible(tmp_path / "elsewhere" / "deep") == visible(out)
