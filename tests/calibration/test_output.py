"""An output folder is of one calibration, or its readers say that it is not; what else is made of a folder."""

import json
import signal
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from passerby.calibration.alignment.folder import write_aligned
from passerby.calibration.alignment.world import align_to_camera
from passerby.calibration.calibration import Calibration
from passerby.calibration.following import folder_clocks, track_options
from passerby.calibration.writing import write_calibration, write_results
from passerby.cli.main import run
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Pose, Rig
from passerby.core.figures import SolverFigures
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.findings.finding import doubt
from passerby.interchange.output_folder import OutputFolder, read_folder_rig, read_output, remove_report_parts, report_files
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.perception.video_probe import WallTime
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import WallClock
from support.faults.dying_process import TOLD, every_moment, hidden, visible
from support.scenes.handmade_files import write_scene
from support.scenes.output_folders import written_output

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
    seen = {name: CameraObservations(people if name in seeing else Boxes.empty(), Keypoints.empty()) for name in lenses.names}
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


def test_a_rig_of_another_calibration_is_reported(calibrations, out, tmp_path, capsys):
    write_calibration(calibrations[1], tmp_path / "other", report=False)
    (out / "rig.toml").write_bytes((tmp_path / "other" / "rig.toml").read_bytes())
    for command in (["track", "OUT"], ["report", "OUT"], ["export", "OUT", "-f", "colmap", "-o", str(tmp_path / "colmap")],
                    ["align", "OUT", "-o", "OUT", "--camera", "A"]):  # fmt: skip
        assert run([str(out) if part == "OUT" else part for part in command]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"error: {out / 'rig.toml'}: is not the file that calibration.json beside it describes: ")
        assert line.endswith("put the right one back, or calibrate again")
    assert read_rig(out / "rig.toml")["A"].pose is not None, "by itself it is a rig as any"


@pytest.mark.parametrize("name", ["A", "B"])
def test_damaged_tracks_and_those_that_no_calibration_wrote_are_reported(calibrations, out, name):
    if name == "A":
        change_text(out / "tracks" / "A.txt")
    else:
        write_calibration(calibrations[1], out, report=False)
        assert len(read_output(out).boxes["B"]) == 0
        (out / "tracks" / "B.txt").write_bytes((out / "tracks" / "A.txt").read_bytes())
    with pytest.raises(InputError, match=rf"tracks/{name}\.txt: is not the file that calibration.json beside it describes"):
        read_output(out)


def test_a_folder_of_an_older_passerby_and_one_with_a_rig_alone_are_read(out, tmp_path):
    told = json.loads((out / "calibration.json").read_text())
    del told["files"]
    (out / "calibration.json").write_text(json.dumps(told))
    change_text(out / "tracks" / "A.txt")
    assert len(read_output(out).rig) == 2
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


def test_tracks_of_cameras_that_are_no_more_go_and_the_same_bytes_are_written_anywhere(calibrations, out, tmp_path):
    first = calibrations[0]
    write_calibration(first, tmp_path / "elsewhere" / "deep", report=False)
    assert visible(tmp_path / "elsewhere" / "deep") == visible(out)
    one = replace(first, rig=replace(first.rig, cameras=first.rig.cameras[:1]))
    (out / "tracks" / "mine.txt").write_text("mine")
    write_calibration(one, out, report=False)
    assert sorted(path.name for path in (out / "tracks").iterdir()) == ["A.txt", "mine.txt"]


def test_a_folder_that_tells_of_no_rig_that_could_be_used(calibrations, out):
    first = calibrations[0]
    unposed = Rig(tuple(replace(camera, pose=None) for camera in first.rig), verdict="doubtful")
    write_calibration(replace(first, rig=unposed, verdict="doubtful"), out, report=False)
    with pytest.raises(EvidenceError, match=r"rig\.toml: none of its 2 cameras has a pose"):
        read_output(out)
    refused = replace(first, verdict="refused", diagnostics=(doubt("people_stand_still"),))
    write_calibration(refused, out, report=False)
    with pytest.raises(EvidenceError, match="the calibration was refused: ") as error:
        read_output(out)
    assert error.value.reasons == refused.reasons


def test_a_file_that_contradicts_itself_or_cannot_be_read_is_named(out, monkeypatch):
    told = json.loads((out / "calibration.json").read_text())
    told["cameras"][0] |= {"fps": 25.0, "time_offset_s": 0.5}
    (out / "calibration.json").write_text(json.dumps(told))
    with pytest.raises(InputError, match=r"calibration\.json: .*: camera B has no fps, though others have"):
        read_output(out)

    def broken(path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("passerby.interchange.output_folder.checksum", broken)
    unreadable = r"rig\.toml: cannot be read \(Permission denied\): check the file and its permissions"
    with pytest.raises(InputError, match=unreadable):
        read_output(out)


def test_files_of_an_earlier_report_go_and_those_of_the_user_stay(tmp_path):
    page, folder = tmp_path / "report.html", tmp_path / "report_files"
    old, new = "0123456789abcdef", "fedcba9876543210"
    for name in (f"{old}/a.js", f"{old}/b.js", f"{new}/a.js", "mine/a.js", f"{new}/notes.txt"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    page.write_text("")
    remove_report_parts(page, but=new)
    assert [path.relative_to(tmp_path).as_posix() for path in report_files(page)] == ["report.html", f"report_files/{new}/a.js"]
    remove_report_parts(page)
    assert sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.*")) == [f"{new}/notes.txt", "mine/a.js"]


def test_a_calibration_is_drawn_and_reported(calibrations, tmp_path):
    first = calibrations[0]
    with pytest.raises(InputError, match="view 'below': choose one of space, above"):
        first.plot("below")
    space, above = first.plot(), first.plot("above")
    assert {trace.type for trace in space.data} >= {"scatter3d"}
    assert "scatter3d" not in {trace.type for trace in above.data}
    assert any("B" in str(trace.name) for trace in above.data)
    first.report(tmp_path / "new" / "report.html")
    assert first.scene.name in (tmp_path / "new" / "report.html").read_text()
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        first.report(tmp_path / "file" / "report.html")


def test_the_file_tells_the_wall_time_that_was_chosen_and_the_libraries_that_are_there(calibrations, monkeypatch):
    first = calibrations[0]

    def version(package):
        if package == "av":
            raise metadata.PackageNotFoundError(package)
        return "1.0"

    monkeypatch.setattr(metadata, "version", version)
    origin = WallTime(1000.0, utc=True)
    chosen_and_told = ((None, None), None), ((origin, None), (origin.text, None)), ((None, origin), (None, origin.text))
    for chosen, expected in chosen_and_told:
        document = replace(first, wall_clock=WallClock(origin, *chosen)).document()
        assert (document.wall_clock_origin, document.wall_clock_span) == (origin.text, expected)
    assert (document.versions["av"], document.versions["numpy"]) == (None, "1.0")
    assert first.document().wall_clock_origin is None


def test_parts_of_a_report_that_the_user_deleted_go_with_the_old_frame(tmp_path: Path) -> None:
    out = written_output(tmp_path)
    part = out / "report_files" / "0123456789abcdef" / "camera.js"
    part.parent.mkdir(parents=True)
    part.write_text("of the old frame")
    write_aligned(out, out, align_to_camera(read_output(out).rig, "B"))
    assert not (out / "report_files").exists()
    assert read_output(out).rig["B"].pose is not None


@pytest.mark.parametrize("name", ["out", "new"])
def test_the_report_is_made_again_in_the_new_frame(tmp_path: Path, name: str) -> None:
    """In place, or in a new folder; where there was none, none is made."""
    out = written_output(tmp_path, report=True)
    (out / "report.html").write_text("of the old frame")
    aligned = align_to_camera(read_output(out).rig, "B")
    write_aligned(out, tmp_path / name, aligned)
    page = (tmp_path / name / "report.html").read_text(encoding="utf-8")
    assert "camera B" in page
    assert "of the old frame" not in page
    (tmp_path / name / "report.html").unlink()
    write_aligned(tmp_path / name, tmp_path / "third", aligned)
    assert not (tmp_path / "third" / "report.html").exists()


@pytest.fixture(scope="module")
def unclocked(tmp_path_factory: pytest.TempPathFactory) -> OutputFolder:
    """Of a calibration that needed no frame rate."""
    return read_output(written_output(tmp_path_factory.mktemp("scene")))


def test_ways_need_a_frame_rate_that_is_stated_where_the_calibration_knows_none(unclocked: OutputFolder) -> None:
    for fps in (0.5, 1000.0):
        assert folder_clocks(unclocked, fps) == {"A": Clock(fps), "B": Clock(fps)}
    found = {"A": Clock(25.0), "B": Clock(12.5, 0.25)}
    assert folder_clocks(replace(unclocked, clocks=found), 30.0) == folder_clocks(replace(unclocked, clocks=found)) == found
    for fps in (0.0, -25.0, 1001.0, float("nan")):
        with pytest.raises(InputError, match="give frames per second, above 0 and at most 1000"):
            folder_clocks(unclocked, fps)
    with pytest.raises(InputError, match="the calibration has no frame rate"):
        folder_clocks(unclocked)


def test_how_people_are_followed_has_limits(unclocked: OutputFolder) -> None:
    for gap in (0.0, 2.5, 60.0):
        assert track_options(unclocked, max_gap=gap).max_gap_s == gap
    for gap in (-0.1, 60.5, float("nan")):
        with pytest.raises(InputError, match="give seconds from 0 to 60"):
            track_options(unclocked, max_gap=gap)
    with pytest.raises(InputError, match="choose one of"):
        track_options(unclocked, "by magic")
