"""Lengths and times on the command line."""

import pytest

from passerby.calibration.effort import Effort
from passerby.cli.main import _effort_of, run
from passerby.cli.quantities import parse_length, parse_seconds
from passerby.common.errors import InputError


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [(parse_length, "12 mm", 0.012), (parse_length, ".5m", 0.5), (parse_length, "5cm", 0.05), (parse_seconds, "90s", 90.0),
     (parse_seconds, "2min", 120.0), (parse_seconds, "1.5h", 5400.0)],
)  # fmt: skip
def test_lengths_and_times(read, text, value):
    assert read(text, "--target") == pytest.approx(value)


@pytest.mark.parametrize("text", ["5", "0cm", "-1cm", "5 km", "nan m", ""])
def test_what_is_no_length_is_named(text):
    with pytest.raises(InputError, match=r"--target .*give a length above 0, such as 5cm"):
        parse_length(text, "--target")


@pytest.mark.parametrize(
    ("given", "effort"),
    [((None, None, False), Effort()), (("2cm", "3min", False), Effort(0.02, 180.0)),
     ((None, "3min", False), Effort(budget_s=180.0)), ((None, None, True), Effort(None))],
    ids=["usual", "both", "budget", "all"],
)  # fmt: skip
def test_options_say_how_much_is_wanted(given, effort):
    assert _effort_of(given[0], given[1], everything=given[2]) == effort


@pytest.mark.parametrize("options", [["--target", "2cm"], ["--budget", "2min"]])
def test_all_and_a_limit_contradict_each_other(options, tmp_path, capsys):
    assert run(["calibrate", str(tmp_path / "scene.toml"), "--all", *options]) == 2
    assert "--all watches all of the videos: leave out --target and --budget, or --all" in capsys.readouterr().err
