"""From pixels to a rig: the demonstration, rendered and real videos, with networks and without, and what it takes.

Every part tells its table as far as it is, so that a benchmark that is stopped keeps what is finished.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from accuracy import NOT_HERE
from command import Calibrated
from datasets import data_set, folder_of, models_folder
from pages.kept import code_digest
from pages.parts import run_two, time_part
from pages.records import Found, publish
from pages.tables import load, table
from perception_runs import (
    BOXES,
    METHODS,
    NETWORKS,
    PETS_CAMERA,
    Watched,
    run_demo,
    run_pets,
    run_rendered,
    run_room,
    run_single,
    run_with_and_without_joints,
    score_pets_tracklets,
    watch_alone,
)
from perception_scenes import large_video, rendered, rendered_room, repeated
from perception_tables import (
    BOX_HEAD,
    GOAL_HEAD,
    JOINT_HEAD,
    LONG_HEAD,
    RATIO_HEAD,
    SEED_HEAD,
    SINGLE_GOAL,
    SIZE_HEAD,
    TRACKLET_HEAD,
    box_rows,
    demo_tables,
    goal_row,
    joint_row,
    long_row,
    pets_rows,
    ratio_row,
    room_rows,
    seed_row,
    size_rows,
    told,
    tracklet_rows,
)
from simulations import PRESETS

Result = TypeVar("Result")
Runs = Mapping[str, Watched]
"""Method -> one scene's run."""

NOT_RUN = "not run"
NO_MODELS = f"{NOT_RUN}: no model files"
MINUTE_S = 60.0
ROOM_SEEDS = 5
LONG_S = 10 * MINUTE_S


@dataclass(frozen=True)
class Place:
    """Where a part works."""

    scratch: Path
    scenes: Path
    seeds: range


def run(
    scratch: Path, scenes: Path | None, seeds: int, parts: Sequence[str], out: Path | None, command: str, *,
    quick: bool = False, written: bool = True,
) -> None:  # fmt: skip
    """Run the parts that are named, or all; one seed of each rendered scene in a quick run."""
    place = Place(scratch, scenes or scratch / "scenes", range(1 if quick else seeds))
    for name in parts or PARTS:
        found = time_part(PARTS[name](place))
        publish("perception", name, found, out, command, code=code_digest(), quick=quick, written=written)


def _demo(place: Place) -> Iterator[Found]:
    before = load()
    demo = run_demo(place.scratch / "demo")
    _tell("demo", told(demo.calibrated))
    note = f"Load of the machine (mean of a minute): {before:.1f} before, {load():.1f} after."
    yield Found(demo_tables(demo), [note])


def _rendered(place: Place) -> Iterator[Found]:
    """Scene after scene; of each, the methods side by side."""
    done: dict[str, dict[int, Runs]] = {preset: {} for preset in PRESETS}
    for seed in place.seeds:
        for preset in PRESETS:
            folder = rendered(place.scenes, preset, seed)
            into = place.scratch / f"{preset}-{seed}"
            methods = [*_methods(), BOXES]
            jobs = [_rendered_job(folder, method, into / method) for method in methods]
            done[preset][seed] = dict(zip(methods, run_two(jobs), strict=True))
            for method, run in done[preset][seed].items():
                _tell(f"{preset} {seed} {method}", told(run.calibrated))
            yield _rendered_tables(done)


def _rendered_job(folder: Path, method: str, into: Path) -> Callable[[], Watched]:
    return lambda: run_rendered(folder, method, into)


def _rendered_tables(done: Mapping[str, Mapping[int, Runs]]) -> Found:
    """Of the scenes so far: against true boxes, seed by seed, and the boxes."""
    ratios, seeds, boxes = [], [], []
    sizes: dict[str, list[Calibrated]] = {}
    for method in METHODS:
        if method not in _methods():
            ratios.append([f"all, {method}", NO_MODELS, *["-"] * (len(RATIO_HEAD) - 2)])
            continue
        for preset, runs in done.items():
            label = f"{preset}, {method}"
            if not runs:
                ratios.append([label, NOT_RUN, *["-"] * (len(RATIO_HEAD) - 2)])
                continue
            found, true = ([run[which].calibrated for run in runs.values()] for which in (method, BOXES))
            ratios.append(ratio_row(label, true, found))
            for whose in (f"all, {method}", "all"):
                sizes.setdefault(whose, []).extend(found)
            for seed, before, after in zip(runs, true, found, strict=True):
                seeds.append(seed_row(f"{preset} {seed}, {method}", before, after))
            boxes += box_rows(label, [run[method] for run in runs.values()])
    rows = {"Ratios": ratios, "Scale": size_rows(sizes), "Seeds": seeds, "Boxes": boxes}
    heads = {"Ratios": RATIO_HEAD, "Scale": SIZE_HEAD, "Seeds": SEED_HEAD, "Boxes": BOX_HEAD}
    return Found({caption: table(heads[caption], rows[caption]) for caption in rows})


def _pets(place: Place) -> Iterator[Found]:
    """The calibrations, then the tracklets from what they kept."""
    folder = folder_of(data_set("pets2009"))
    if folder is None or models_folder() is None or not (folder / f"{PETS_CAMERA}.avi").is_file():
        yield Found(notes=[NOT_HERE if folder is None else NO_MODELS])
        return
    into = {method: place.scratch / f"pets-{method}" for method in ("networks", BOXES, "weight-free")}
    networks, boxes, weight_free = run_two([_pets_job(folder, method, path) for method, path in into.items()])
    for method, run in zip(into, (networks, boxes, weight_free), strict=True):
        _tell(f"pets2009 {method}", told(run))
    first = {"Result": table(GOAL_HEAD, pets_rows(networks, boxes, weight_free))}
    yield Found(first)
    rows = tracklet_rows(score_pets_tracklets(folder, into["networks"]))
    yield Found({**first, "Tracklets": table(TRACKLET_HEAD, rows)})


def _pets_job(folder: Path, method: str, into: Path) -> Callable[[], Calibrated]:
    return lambda: run_pets(folder, method, into)


def _single(place: Place) -> Iterator[Found]:
    folder = folder_of(data_set("pose2sim_single"))
    if folder is None or models_folder() is None or not (folder / "videos").is_dir():
        yield Found(notes=[NOT_HERE if folder is None else NO_MODELS])
        return
    run = run_single(folder, place.scratch / "single")
    _tell("pose2sim_single", told(run))
    yield Found({"Result": table(GOAL_HEAD, [goal_row("pose2sim_single", run, *SINGLE_GOAL)])})


def _joints(place: Place) -> Iterator[Found]:
    """One scene of each preset, with keypoints and without."""
    if models_folder() is None:
        yield Found(notes=[NO_MODELS])
        return
    rows = []
    for preset in PRESETS:
        folder = rendered(place.scenes, preset, place.seeds[0])
        runs = run_with_and_without_joints(folder, place.scratch / f"joints-{preset}")
        rows.append(joint_row(f"{preset} {place.seeds[0]}", runs["without"], runs["with"]))
        for name, (run, seconds) in runs.items():
            _tell(f"{preset} {name} joints", f"{told(run)}, {seconds:.0f} s of watching")
        yield Found({"Result": table(JOINT_HEAD, rows)})


def _room(place: Place) -> Iterator[Found]:
    """Seed after seed, two at a time."""
    seeds = range(len(place.seeds) if len(place.seeds) == 1 else ROOM_SEEDS)
    jobs = [_room_job(rendered_room(place.scenes, seed), place.scratch / f"room-{seed}") for seed in seeds]
    runs = {f"room {seed}": run for seed, run in zip(seeds, run_two(jobs), strict=True)}
    for name, run in runs.items():
        _tell(name, told(run))
    yield Found({"Result": table(GOAL_HEAD, room_rows(runs))})


def _room_job(folder: Path, into: Path) -> Callable[[], Calibrated]:
    return lambda: run_room(folder, into)


def _long(place: Place) -> Iterator[Found]:
    """Both detectors side by side, a core each: nothing else runs."""
    source = large_video(place.scenes)
    videos = [repeated(source, seconds, place.scratch / f"{seconds:g}.mp4") for seconds in (MINUTE_S, LONG_S)]
    jobs = [_long_job(videos, method, place.scratch / method) for method in _methods()]
    done = dict(zip(_methods(), run_two(jobs), strict=True))
    rows = []
    for method, table_of in METHODS.items():
        if method not in done:
            rows.append([table_of["detector"], NO_MODELS, *["-"] * (len(LONG_HEAD) - 2)])
            continue
        short, long = done[method]
        _tell(f"long video, {method}", f"{short} {long}")
        rows.append(long_row(table_of["detector"], short, long))
    yield Found({"Result": table(LONG_HEAD, rows)}, [f"Load of the machine at the end (mean of a minute): {load():.1f}."])


def _long_job(videos: Sequence[Path], method: str, into: Path) -> Callable[[], list[dict[str, float]]]:
    return lambda: [watch_alone(video, method, into / video.stem) for video in videos]


PARTS: dict[str, Callable[[Place], Iterator[Found]]] = {
    "demo": _demo, "pets2009": _pets, "single": _single, "room": _room, "joints": _joints, "rendered": _rendered,
    "long": _long,
}  # fmt: skip
"""In this order: what is timed by itself, then from the quick to the long."""


def _methods() -> list[str]:
    """What can be run here."""
    return [method for method, table in METHODS.items() if table != NETWORKS or models_folder() is not None]


def _tell(what: str, found: str) -> None:
    print(f"{what}: {found}", file=sys.stderr, flush=True)
