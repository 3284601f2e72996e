"""`passerby track` from a folder that `passerby calibrate` wrote: files, errors against the truth; and `passerby compare`."""

import csv
import json
import shutil

import pytest

from passerby.cli.main import run
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.simulation import SimulationOptions, simulate, write_scene

pytestmark = pytest.mark.smoke


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """(scene folder, output folder) of a terrace with clocks that differ, identities given."""
    root = tmp_path_factory.mktemp("track")
    write_scene(simulate(SimulationOptions(seconds=20.0, box_noise=0.02, seed=4)), root / "scene")
    assert run(["calibrate", str(root / "scene" / "scene.toml"), "-o", str(root / "out")]) == 0
    return root / "scene", root / "out"


def copied(calibrated, tmp_path):
    return shutil.copytree(calibrated[1], tmp_path / "out")


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_track_writes_a_table_and_a_page_the_same_each_time(calibrated, capsys, tmp_path):
    out = copied(calibrated, tmp_path)
    capsys.readouterr()
    assert run(["track", str(out)]) == 0
    said = capsys.readouterr()
    assert "7 people" in said.out
    assert said.err == ""
    rows = rows_of(out / "trajectories" / "trajectories.csv")
    assert list(rows[0]) == ["time_s", "frame", "id", "x_m", "y_m", "z_m", "sigma_m", "cameras"]
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times)
    assert {int(row["id"]) for row in rows} == set(range(1, 8))
    assert all(0.5 < float(row["z_m"]) < 1.2 and 0 < float(row["sigma_m"]) < 1 for row in rows)
    page = out / "trajectories" / "trajectories.html"
    assert 3e6 < page.stat().st_size < 10e6
    assert "person 7" in page.read_text()
    assert run(["track", str(out), "-o", str(tmp_path / "again")]) == 0
    for file in ("trajectories.csv", "trajectories.html"):
        assert (tmp_path / "again" / file).read_bytes() == (out / "trajectories" / file).read_bytes()


def test_the_distance_to_the_truth_is_reported(calibrated, capsys, tmp_path):
    scene, out = calibrated
    truth = ["--truth", str(scene / "ground_positions.csv"), "--true-rig", str(scene / "truth.toml")]
    figures = {}
    for method in ("smoothed", "pairwise"):
        capsys.readouterr()
        assert run(["track", str(out), "-o", str(tmp_path / method), "--method", method, "--json", *truth]) == 0
        figures[method] = json.loads(capsys.readouterr().out)
    true, found = figures["smoothed"]["truth"], figures["smoothed"]["truth"]["similarity"]
    assert set(true) == {"metric", "similarity", "true_cameras", "from_true_cameras"}
    assert found["mean_m"] < min(0.1, figures["pairwise"]["truth"]["similarity"]["mean_m"])
    # People's height tells the scale to some per cent, of 10 to 15 m.
    assert found["mean_m"] < true["metric"]["mean_m"] < 0.5
    assert true["true_cameras"]["mean_m"] < 0.1
    assert true["from_true_cameras"]["similarity"]["mean_m"] < 0.05
    assert (found["matched"], found["unmatched"]) == (7, [])
    assert found["covered"] > 0.98
    assert figures["smoothed"]["people"] == len(figures["smoothed"]["ways"]) == 7


@pytest.mark.slow
def test_clocks_of_the_calibration_are_used(tmp_path, capsys):
    scene = simulate(SimulationOptions(seconds=20.0, box_noise=0.02, seed=4, clock_offsets=(0.0, 0.8, -0.6, 0.5)))
    path = write_scene(scene, tmp_path / "scene")
    path.write_text(path.read_text().replace('mode = "given"', 'mode = "given"\nmax_offset_s = 2.0'))
    assert run(["calibrate", str(path), "-o", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    truth = ["--truth", str(tmp_path / "scene" / "ground_positions.csv"), "--true-rig", str(tmp_path / "scene" / "truth.toml")]
    assert run(["track", str(tmp_path / "out"), "--json", *truth]) == 0
    true = json.loads(capsys.readouterr().out)["truth"]
    assert true["similarity"]["mean_m"] < 0.12


def unchecked(path):
    """A file of an output folder, whose `calibration.json` no longer holds checksums, as older ones do not."""
    out = next(parent for parent in path.parents if (parent / "calibration.json").is_file())
    told = json.loads((out / "calibration.json").read_text())
    (out / "calibration.json").write_text(json.dumps({key: value for key, value in told.items() if key != "files"}))
    return path


def broken_report(out, **changes):
    path = out / "calibration.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.mark.parametrize(
    ("breaks", "status", "says"),
    [
        (lambda out: (out / "calibration.json").unlink(), 2, "calibration.json: no such file"),
        (lambda out: (out / "calibration.json").write_text("{"), 2, "is not JSON"),
        (lambda out: (out / "calibration.json").write_text("[]"), 2, "is not a table"),
        (lambda out: broken_report(out, verdict="fine"), 2, "verdict is 'fine'"),
        (lambda out: broken_report(out, cameras=[]), 2, "has no camera C1"),
        (lambda out: broken_report(out, verdict="refused", reasons=["no overlap"]), 3, "refused: no overlap"),
        (lambda out: (out / "rig.toml").unlink(), 2, "rig.toml: no such file"),
        (lambda out: (out / "rig.toml").write_text("?"), 2, "rig.toml: is not the file that"),
        (lambda out: unchecked(out / "rig.toml").write_text("?"), 2, "rig.toml: is not TOML"),
        (lambda out: (out / "tracks" / "C2.txt").unlink(), 2, "C2.txt: no such file"),
        (lambda out: unchecked(out / "tracks" / "C2.txt").write_text("1,2,3\n"), 2, "C2.txt: line 1"),
    ],
)
def test_a_broken_folder_is_one_line_of_error(calibrated, tmp_path, capsys, breaks, status, says):
    out = copied(calibrated, tmp_path)
    breaks(out)
    capsys.readouterr()
    assert run(["track", str(out)]) == status
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith("error: ")
    assert says in error
    assert not (out / "trajectories").exists()


@pytest.mark.slow
def test_a_doubtful_calibration_is_followed_with_a_note_and_one_without_a_frame_rate_needs_fps(calibrated, tmp_path, capsys):
    out = copied(calibrated, tmp_path)
    broken_report(out, verdict="doubtful", reasons=["few people"])
    capsys.readouterr()
    assert run(["track", str(out)]) == 0
    assert "note: the calibration is doubtful: few people" in capsys.readouterr().err
    report = json.loads((out / "calibration.json").read_text())
    report["scene"]["scene"]["fps"] = None
    (out / "calibration.json").write_text(json.dumps(report))
    assert run(["track", str(out)]) == 2
    assert "--fps" in capsys.readouterr().err
    assert run(["track", str(out), "--fps", "10"]) == 0
    assert "0.1000" in {row["time_s"] for row in rows_of(out / "trajectories" / "trajectories.csv")}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--method", "magic"], "choose one of smoothed, pairwise"),
        (["--max-gap", "-1"], "--max-gap -1"),
        (["--fps", "0"], "--fps 0"),
        (["--truth", "nowhere.csv"], "--true-rig"),
        (["--truth", "nowhere.csv", "--true-rig", "nowhere.toml"], "no such file"),
    ],
)
def test_wrong_options(calibrated, tmp_path, capsys, arguments, says):
    assert run(["track", str(calibrated[1]), "-o", str(tmp_path / "t"), *arguments]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "t").exists()


@pytest.mark.slow
def test_compare_measures_two_rigs_on_the_people_of_a_folder_or_of_a_scene_file(tmp_path, capsys):
    scene, out = tmp_path / "scene", str(tmp_path / "out")
    write_scene(simulate(SimulationOptions(preset="terrace", seed=961, seconds=30.0, box_noise=0.01)), scene)
    assert run(["calibrate", str(scene / "scene.toml"), "-o", out, "--no-report"]) == 0
    capsys.readouterr()
    asked = ["compare", str(scene / "truth.toml"), out, out, "--shape"]
    assert run(asked) == 0
    told = capsys.readouterr().out
    assert "median distance of people from where the other cameras put them" in told
    assert "stretches of 10 s" in told
    assert run([*asked, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["cameras"]) == {"C1", "C2", "C3", "C4"}
    assert found["first"]["median_px"] == pytest.approx(found["second"]["median_px"], rel=0.1)

    rig = tmp_path / "out" / "rig.toml"
    write_rig(tmp_path / "shrunk.toml", read_rig(rig).moved([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 0.3], 0.9))
    assert run(["compare", str(rig), str(tmp_path / "shrunk.toml"), str(scene / "scene.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["difference_px"] > 0
    assert run(["compare", str(tmp_path / "none.toml"), out, out]) == 2
    assert "none.toml: no such file" in capsys.readouterr().err
