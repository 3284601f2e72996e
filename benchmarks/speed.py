"""Speed and memory: the point bundle adjustment against pycolmap's, PETS 2009, and videos of any length."""

from __future__ import annotations

import json
from pathlib import Path
from statistics import median

import numpy as np

from command import ONE_THREAD, Calibrated, Run, calibrate, judge, passerby, run_program
from datasets import ROOT, data_set, every_second_frame, folder_of, write_scene
from pages.records import Found
from pages.tables import Table, load, number, table, yes
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.video import VideoReader, probe
from perception_runs import WEIGHT_FREE, absolute, write
from perception_scenes import rendered, repeated

FILMS = tuple((preset, seed) for preset in ("terrace", "basketball", "construction") for seed in (61, 62, 63))
FILM_S, MINUTE_S = 150.0, 60.0
LENGTHS = (1, 10, 60)  # minutes
KEY_EVERY_S = 2.0
MOST_TIMES, MOST_ERROR = 1.5, 1.3
"""The last length takes no longer than so many times the first; errors by a part are no larger than so many times those by
everything, in the median."""


def _films(scratch: Path, quick: bool) -> dict[str, Table]:
    """Both tables; rendered films are kept in build/scenes."""
    scenes = ROOT / "build" / "scenes"
    lengths = LENGTHS[:2] if quick else LENGTHS
    films = FILMS[:1] if quick else FILMS
    return {"Films by length": _by_length(scenes, scratch, lengths), "Films in part": _in_part(scenes, scratch, films)}


def _by_length(scenes: Path, scratch: Path, lengths: tuple[int, ...]) -> Table:
    """Four cameras that film the same minute again and again."""
    film = rendered(scenes, "terrace", 60, MINUTE_S)
    minute = {path.stem: _with_key_frames(path, scratch / path.name) for path in sorted((film / "videos").iterdir())}
    rows, first = [], 0.0
    for minutes in lengths:
        folder = scratch / f"{minutes}-min"
        content = absolute(film / "scene.toml") | {"perception": WEIGHT_FREE}
        for name, camera in content["cameras"].items():
            folder.mkdir(parents=True, exist_ok=True)
            camera["video"] = str(repeated(minute[name], MINUTE_S * minutes, folder / f"{name}.mp4", MINUTE_S))
        scene = write(folder / "scene.toml", content)
        told = passerby("calibrate", str(scene), "-o", str(folder / "out"), "--no-report")
        found = judge(folder / "out", film / "truth.toml", told)
        first = first or told.cpu_seconds
        times = told.cpu_seconds / first
        used, spent = _used(found.report, MINUTE_S * minutes), f"{told.cpu_seconds:.0f} s"
        reached, peak = yes(times <= MOST_TIMES), f"{told.peak_mb:.0f} MB"
        rows.append([f"{minutes} min", found.verdict, used, spent, f"{times:.2f}", reached, peak, _position(found.errors)])
    head = ("length", "verdict", "used", "processor time", "times the first", f"at most {MOST_TIMES:g}", "peak memory", "mm")
    return table(head, rows)


def _with_key_frames(video: Path, into: Path) -> Path:
    """The video with a key frame every `KEY_EVERY_S`, as usual cameras have."""
    info = probe(video)
    with VideoWriter(into, info.size, info.average_fps, key_every=round(KEY_EVERY_S * info.average_fps)) as target:
        for frame in VideoReader(info, None):
            target.write(frame.picture)
    return into


def _in_part(scenes: Path, scratch: Path, films: tuple[tuple[str, int], ...]) -> Table:
    """Films with the usual target, and all of them."""
    rows, ratios = [], list[tuple[float, float, float]]()
    for preset, seed in films:
        film = rendered(scenes, preset, seed, FILM_S)
        scene = write(scratch / f"{preset}-{seed}.toml", absolute(film / "scene.toml") | {"perception": WEIGHT_FREE})
        both: list[tuple[Run, dict[str, float], str]] = []
        for options in ((), ("--all",)):
            out = scratch / f"{preset}-{seed}{''.join(options)}"
            told = passerby("calibrate", str(scene), "-o", str(out), "--no-report", *options)
            found = judge(out, film / "truth.toml", told)
            errors = found.errors
            assert errors is not None
            figures = {
                "position": errors["similarity"]["mean_position_mm"], "points": errors["points"]["median_mm"],
                "ground": errors["ground"]["median_mm"],
            }  # fmt: skip
            both.append((told, figures, _used(found.report, FILM_S)))
        (part, some, used), (whole, everything, _) = both
        ratio = tuple(some[key] / everything[key] for key in ("position", "points", "ground"))
        ratios.append((ratio[0], ratio[1], ratio[2]))
        compared = [f"{some[key]:.1f} / {everything[key]:.1f}" for key in ("position", "points", "ground")]
        rows.append([f"{preset} {seed}", used, f"{part.cpu_seconds:.0f} / {whole.cpu_seconds:.0f} s", *compared])
    medians = [median(column) for column in zip(*ratios, strict=True)]
    rows.append(["median ratio", "", "", *(f"{number(one, 2)} ({yes(one <= MOST_ERROR)})" for one in medians)])
    head = ("film", "used", "processor time, part / all", "position mm", "points mm", "ground mm")
    return table(head, rows)


def _used(report: dict[str, object], seconds: float) -> str:
    """How much of the videos a calibration used."""
    diagnostics = report["diagnostics"]
    assert isinstance(diagnostics, list)
    part = [one["values"]["used_s"] for one in diagnostics if one["code"] == "videos_used_in_part"]
    return f"{part[0] if part else seconds:.0f} s"


def _position(errors: dict[str, dict[str, float]] | None) -> str:
    return "-" if errors is None else number(errors["similarity"]["mean_position_mm"])


LARGEST_SECONDS, LARGEST_MB, LARGEST_DOUBLING = 5.0, 500.0, 2.0


def run(scratch: Path, quick: bool) -> Found:
    """The race, then PETS 2009 with all and with half of its frames, in turn."""
    before = load()
    repeats = 3 if quick else 15
    tables = {"Adjustment": _race(repeats)}
    if (pets := _pets(scratch, 1 if quick else 3)) is not None:
        tables["PETS2009"] = pets
    tables |= _films(scratch, quick)
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
