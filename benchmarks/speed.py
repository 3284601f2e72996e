"""Speed and memory: the point bundle adjustment against pycolmap's, PETS 2009, and videos of any length."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import films_in_part
from command import ONE_THREAD, Calibrated, calibrate, run_program
from datasets import data_set, every_second_frame, folder_of, write_scene
from pages.records import Found
from pages.tables import Table, load, number, table, yes

LARGEST_SECONDS, LARGEST_MB, LARGEST_DOUBLING = 5.0, 500.0, 2.0


def run(scratch: Path, quick: bool) -> Found:
    """The race, then PETS 2009 with all and with half of its frames, in turn."""
    before = load()
    repeats = 3 if quick else 15
    tables = {"Adjustment": _race(repeats)}
    if (pets := _pets(scratch, 1 if quick else 3)) is not None:
        tables["PETS2009"] = pets
    tables |= films_in_part.run(scratch, quick)
    note = f"Load of the machine (mean of a minute): {before:.1f} before, {load():.1f} after, this run included."
    return Found(tables, [note], f"Medians of {repeats} runs")


def _race(repeats: int) -> Table:
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


def _pets(scratch: Path, repeats: int) -> Table | None:
    data = data_set("pets2009")
    folder = folder_of(data)
    if folder is None:
        return None
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
