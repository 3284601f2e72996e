"""Speed and memory: the point bundle adjustment against pycolmap's, and a whole calibration of PETS 2009."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from accuracy import NOT_HERE
from command import ONE_THREAD, Calibrated, calibrate, run_program
from datasets import data_set, every_second_frame, folder_of, write_scene
from pages.page import Page, load, number, table, yes

LARGEST_SECONDS, LARGEST_MB, LARGEST_DOUBLING = 5.0, 500.0, 2.0


def run(scratch: Path, quick: bool) -> Page:
    """The race, then PETS 2009 with all and with half of its frames, in turn."""
    before = load()
    repeats = 3 if quick else 15
    race = _race(repeats)
    pets = _pets(scratch, 1 if quick else 3)
    note = f"Load of the machine (mean of a minute): {before:.1f} before, {load():.1f} after, this run included."
    return Page("speed", f"{_HEAD.format(repeats=repeats)}\n\n{note}\n\n{race}\n\n{_PETS}\n\n{pets}\n")


_HEAD = """# Speed and memory

The point bundle adjustment of 8 cameras x 2000 points, all seen by all, 1 px noise, start off by 0.03 rad and 0.2 m, intrinsics
and one pose held; one process, the same start, in turn, after a warm-up: medians of {repeats}. Passerby's time runs from pixels
to poses with their covariance, on one thread; pycolmap's is that of setting up and solving on two threads, its reconstruction
already filled. *pycolmap*: with its own stopping rule (no cost tolerance); *same stop*: it may end as soon as Passerby does, at
a gain below 1e-8 of the cost. The cost is computed alike for both."""

_PETS = "A whole `passerby calibrate` of `pets2009/identities`, start of Python included, and the same with every second frame."


def _race(repeats: int) -> str:
    program = Path(__file__).with_name("bundle_race.py")
    result = json.loads(run_program([str(program), "--repeats", str(repeats)], ONE_THREAD).output)
    rows = []
    for row in result["rows"]:
        rival = row["solver"] != "passerby"
        rows.append(
            [row["loss"], row["solver"], f"{1000 * row['seconds']:.0f} ms", str(row["iterations"]), f"{row['cost']:.3f}",
             f"{row['ratio']:.2f}" if rival else "", yes(row["ratio"] <= 1) if rival else ""]
        )  # fmt: skip
    head = ("loss", f"solver (pycolmap {result['pycolmap']})", "time", "iterations", "cost", "Passerby / it", "no slower")
    return table(head, rows)


def _pets(scratch: Path, repeats: int) -> str:
    data = data_set("pets2009")
    folder = folder_of(data)
    if folder is None:
        return NOT_HERE
    scenes = {
        "all frames": write_scene(data, folder, scratch / "all"),
        "every second": write_scene(data, folder, scratch / "half", every_second_frame),
    }
    runs: dict[str, list[Calibrated]] = {name: [] for name in scenes}
    for _ in range(repeats):
        for name, scene in scenes.items():
            runs[name].append(calibrate(scene, folder / "rig.toml", scratch / name))
    seconds = {name: float(np.median([run.seconds for run in results])) for name, results in runs.items()}
    doubling = seconds["all frames"] / seconds["every second"]
    peak = max(run.peak_mb for run in runs["all frames"])
    rows = [
        ["wall time, all frames", f"{seconds['all frames']:.2f} s", f"under {LARGEST_SECONDS:g} s",
         yes(seconds["all frames"] < LARGEST_SECONDS)],
        ["wall time, every second", f"{seconds['every second']:.2f} s", "", ""],
        ["doubling the frames", f"{number(doubling, 2)} x", f"at most {LARGEST_DOUBLING:g} x",
         yes(doubling <= LARGEST_DOUBLING)],
        ["peak memory, all frames", f"{peak:.0f} MB", f"under {LARGEST_MB:g} MB", yes(peak < LARGEST_MB)],
    ]  # fmt: skip
    return table(("pets2009", "measured", "goal", "reached"), rows)
