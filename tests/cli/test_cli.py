"""The command line: what it prints, that it says what the library says, and lengths and times as options."""

import inspect
import json
import subprocess
import sys
import tomllib
from dataclasses import fields

import pytest

from passerby import __version__
from passerby.calibration.effort import Effort
from passerby.cli import main as cli
from passerby.cli.main import _effort_of, run
from passerby.cli.quantities import parse_length, parse_seconds
from passerby.common.errors import InputError
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.simulation import SimulationOptions


def test_version_and_help(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"passerby {__version__}\n"
    assert run([]) == 0
    out = capsys.readouterr().out
    assert all(command in out for command in ("calibrate", "evaluate", "simulate", "check", "demo"))


def test_help_and_import_need_no_heavy_library():
    code = "import sys, passerby, passerby.cli.main; passerby.cli.main.run(['--help']); print(*sorted(sys.modules), sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "passerby.cli.main" in loaded
    assert not {"numpy", "cv2", "scipy", "poselib", "jinja2"} & set(loaded)


def test_simulate_offers_every_option_with_its_default():
    offered = inspect.signature(cli.simulate).parameters
    as_text = {"clock_offsets": {"0": 0.0}, "camera_fps": {"": ()}, "groups": {"": ()}}
    for option in fields(SimulationOptions):
        default = offered[option.name].default
        assert (as_text[option.name][default] if option.name in as_text else default) == option.default, option.name


def test_simulate_check_evaluate(tmp_path, capsys):
    folder, larger = tmp_path / "scene", str(tmp_path / "larger.toml")
    chosen = ["--seconds=4", "--people=3", "--cameras=3", "--seed=2", "--clock-offsets=0,0.1,-0.1", "--keypoints"]
    assert run(["simulate", "-o", str(folder), *chosen]) == 0
    assert f"passerby calibrate {folder / 'scene.toml'}" in capsys.readouterr().out
    assert run(["check", str(folder / "scene.toml")]) == 0
    assert "no problems found" in capsys.readouterr().out

    truth = read_rig(folder / "truth.toml")
    write_rig(tmp_path / "larger.toml", truth.moved([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [3, 4, 0], 1.05))
    assert run(["evaluate", larger, str(folder / "truth.toml"), "--json", "--reference", "C2"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["scale_ratio"], report["reference"]) == (pytest.approx(1.05), "C2")
    assert report["similarity"]["mean_position_mm"] == pytest.approx(0, abs=1e-6)
    assert [camera["name"] for camera in report["cameras"]] == ["C1", "C2", "C3"]
    assert report["cameras"][1]["position_error_mm"] == pytest.approx(0, abs=1e-6)

    assert run(["evaluate", larger, str(folder / "truth.toml")]) == 0
    out = capsys.readouterr().out
    assert "scale ratio 1.0500" in out
    assert "3 of 3 cameras registered" in out
    (tmp_path / "other.toml").write_text((folder / "truth.toml").read_text().replace("C", "D"))
    assert run(["evaluate", str(tmp_path / "other.toml"), str(folder / "truth.toml")]) == 2
    assert "no camera has a pose in both rigs" in capsys.readouterr().err


def test_simulate_a_site(tmp_path, capsys):
    folder = tmp_path / "site"
    assert run(["simulate", "-o", str(folder), "--preset", "airport", "--cameras", "8", "--people", "6", "--seconds", "2"]) == 0
    assert f"passerby calibrate {folder / 'scene.toml'}" in capsys.readouterr().out
    assert len(read_rig(folder / "truth.toml")) == 8
    options = tomllib.loads((folder / "simulation.toml").read_text())["options"]
    assert (options["seconds"], options["clock_offsets"]) == (2.0, 5.0)  # given, and a site's own default
    assert (folder / "overlaps.csv").read_text().startswith("camera_a,camera_b,shared_m2\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--video"], "--video"), (["--keypoints", "--groups", "4,4"], "--groups, --keypoints"),
     (["--clock-offsets", "1,2"], "give --clock-offsets one number")],
)  # fmt: skip
def test_options_that_no_site_has_are_one_clear_error(tmp_path, capsys, arguments, said):
    assert run(["simulate", "-o", str(tmp_path / "site"), "--preset", "airport", *arguments]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith("error: preset 'airport' is a site of many cameras")
    assert said in error
    assert not (tmp_path / "site").exists()


def test_lengths_and_times_are_read_with_their_units():
    for read, text, value in (
        (parse_length, "12 mm", 0.012), (parse_length, ".5m", 0.5), (parse_length, "5cm", 0.05), (parse_seconds, "90s", 90.0),
        (parse_seconds, "2min", 120.0), (parse_seconds, "1.5h", 5400.0),
    ):  # fmt: skip
        assert read(text, "--target") == pytest.approx(value)
    for text in ("5", "0cm", "-1cm", "5 km", "nan m", ""):
        with pytest.raises(InputError, match=r"--target .*give a length above 0, such as 5cm"):
            parse_length(text, "--target")


def test_options_say_how_much_is_wanted(tmp_path, capsys):
    for target, budget, everything, effort in (
        (None, None, False, Effort()), ("2cm", "3min", False, Effort(0.02, 180.0)),
        (None, "3min", False, Effort(budget_s=180.0)), (None, None, True, Effort(None)),
    ):  # fmt: skip
        assert _effort_of(target, budget, everything=everything) == effort
    for options in (["--target", "2cm"], ["--budget", "2min"]):
        assert run(["calibrate", str(tmp_path / "scene.toml"), "--all", *options]) == 2
        said = "--all watches all of the videos: leave out --target and --budget, or --all"
        assert said in capsys.readouterr().err
