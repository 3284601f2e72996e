"""From pixels to a rig: the demonstration, rendered and real videos, with networks and without, and what it takes.

Every part tells its table as far as it is, so that a benchmark that is stopped keeps what is finished.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from accuracy import KEYS, NOT_HERE, complete, figures
from command import Calibrated, Run
from datasets import data_set, folder_of, models_folder
from metrics.detections import BoxScore
from metrics.tracklets import TrackletScore
from pages.kept import code_digest
from pages.parts import run_two, time_part
from pages.records import Found, publish
from pages.tables import Table, errors, load, number, reached, table, yes
from paper.goals import PRESETS
from perception_runs import (
    BOXES,
    CRASHED,
    METHODS,
    NETWORKS,
    PETS_CAMERA,
    Demo,
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

Bounds = tuple[float, float]

DEMO_GOAL, DEMO_SECONDS = ((60.0, 0.3), (20.0, 0.1)), 180.0
RATIO_GOAL = (2.5, 1.5)
PETS_ACCEPTABLE, AS_WITH_BOXES = (450.0, 1.0), 1.05
IDF1_GOAL = (0.65, 0.75)
SINGLE_GOAL = ((60.0, 1.0), (40.0, 0.7))
LEAST_SHARE, MOST_GROWTH = 0.7, 1.1
OFF = 0.1  # heights by which an edge that is off harms


def of(runs: Sequence[Calibrated]) -> np.ndarray:
    """(runs, 2) mm and degrees after the similarity; infinite where a camera is missing."""
    return np.column_stack([figures(runs, "similarity", key) for key in KEYS])


def in_rig(run: Calibrated) -> str:
    """How many cameras were registered."""
    return f"{run.errors['registered'] if run.errors else 0} of {run.cameras}"


def _found(run: Calibrated) -> str:
    """Errors over the cameras that are in the rig."""
    similarity = (run.errors or {}).get("similarity", {})
    return errors(*(similarity.get(key) for key in KEYS))


def judged(run: Calibrated, acceptable: Bounds, aim: Bounds) -> str:
    """Whether one run, all cameras in it, reaches a goal."""
    return reached(of([run])[0].tolist(), acceptable, aim)


def goal_row(label: str, run: Calibrated, acceptable: Bounds | None, aim: Bounds | None) -> list[str]:
    """One run against its goal; without one, for comparison."""
    goals = ["", "", ""]
    if acceptable is not None and aim is not None:
        goals = [errors(*acceptable), errors(*aim), judged(run, acceptable, aim)]
    return [label, run.verdict, in_rig(run), _found(run), *goals, size(run), f"{number(run.seconds, 0)} s"]


GOAL_HEAD = ("data", "verdict", "registered", "similarity", "acceptable", "aim", "reached", "scale", "wall time")


def scale_errors(runs: Sequence[Calibrated]) -> np.ndarray:
    """(runs, 2) how far the rig's lengths are too long, and the stated sigma, as fractions; NaN where there is no scale."""
    ratios = [(run.errors or {}).get("scale_ratio") for run in runs]
    rows = [(np.nan if ratio is None else ratio - 1, run.scale_sigma) for ratio, run in zip(ratios, runs, strict=True)]
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def size(run: Calibrated) -> str:
    """The error of the scale and its stated sigma."""
    off, sigma = scale_errors([run])[0]
    return "-" if np.isnan(off) else f"{100 * off:+.1f} ± {number(100 * sigma, 1)} %"


def size_rows(runs: Mapping[str, Sequence[Calibrated]]) -> list[list[str]]:
    """How wrong the scale is, method by method; a run without a scale misses every goal."""
    rows = []
    for label, own in runs.items():
        if not own:
            continue
        off, sigma = np.nan_to_num(scale_errors(own), nan=np.inf).T
        in_sigmas = float(np.max(np.abs(off) / sigma)) if np.isfinite(off).all() else np.inf
        measured = [100 * float(np.median(np.abs(off))), 100 * abs(float(np.mean(off))), in_sigmas]
        rows.append([
            label, str(len(own)), f"{number(measured[0], 2)} %", f"{number(100 * float(np.mean(off)), 2)} %",
            number(measured[2], 2), reached(measured, *SIZE_GOAL),
        ])  # fmt: skip
    return rows


SIZE_GOAL = ((4.0, 2.5, 2.5), (3.0, 1.5, 2.0))
"""Median of the error's amount, per cent; amount of its mean, per cent; the largest in stated sigmas: acceptable and aim."""
SIZE_HEAD = ("scenes", "runs", "error of the scale, median", "mean, signed", "largest, in stated sigmas", "reached")


def joint_row(label: str, without: tuple[Calibrated, float], joined: tuple[Calibrated, float]) -> list[str]:
    """What joints change; each run with the processor time of its watching, seconds."""
    ratio = joined[1] / without[1]
    cells = [cell for run, _ in (without, joined) for cell in (_found(run), size(run))]
    times = [f"{seconds:.0f} s" for _, seconds in (without, joined)]
    return [label, *cells, *times, f"{ratio:.2f}", reached([ratio], *JOINT_TIME_GOAL)]


JOINT_TIME_GOAL = ((2.0,), (1.5,))
JOINT_HEAD = (
    "scene", "boxes alone", "scale", "with joints", "scale", "watching, boxes alone", "with joints", "ratio", "reached",
)  # fmt: skip


def room_rows(runs: Mapping[str, Calibrated]) -> list[list[str]]:
    """Seed by seed, and how many reach the goal."""
    rows = [goal_row(label, run, *ROOM_GOAL) for label, run in runs.items()]
    least = [sum(judged(run, *ROOM_GOAL) in wanted for run in runs.values()) for wanted in (("acceptable", "aim"), ("aim",))]
    verdict = "aim" if least[1] == len(runs) else "acceptable" if least[0] >= ROOM_SHARE * len(runs) else "**missed**"
    return [*rows, ["all", "", f"{least[0]} of {len(runs)} acceptable", "", "", "", verdict, "", ""]]


ROOM_GOAL = ((150.0, 2.0), (80.0, 1.0))
ROOM_SHARE = 0.8  # of the seeds, to reach what is acceptable


def demo_tables(demo: Demo) -> dict[str, Table]:
    """What it reaches, and where its time goes."""
    again, whole = demo.again, demo.whole
    rendering = Run("", 0, whole.seconds - again.seconds, whole.cpu_seconds - again.cpu_seconds, 0.0)
    times = [
        ["all of it", *_times(whole), f"under {DEMO_SECONDS:.0f} s", yes(whole.seconds < DEMO_SECONDS)],
        ["calibrating", *_times(again), "", ""],
        ["simulating and rendering", *_times(rendering), "", ""],
    ]
    head = ("time", "wall", "processor", "goal", "reached")
    rows = [goal_row("`make demo`", demo.calibrated, *DEMO_GOAL)]
    return {"Result": table(GOAL_HEAD, rows), "Time": table(head, times)}


def _times(run: Run | Calibrated) -> list[str]:
    return [f"{run.seconds:.0f} s", f"{run.cpu_seconds:.0f} s"]


def ratio_row(label: str, true: Sequence[Calibrated], found: Sequence[Calibrated]) -> list[str]:
    """Errors from videos over those from the true boxes, seed by seed."""
    before, after = of(true), of(found)
    if not np.isfinite(before).all():
        return [label, str(len(found)), *["-"] * 5, "true boxes fail"]
    ratio, of_means = after / before, after.mean(axis=0) / before.mean(axis=0)
    registered = f"all in {sum(complete(run) for run in found)} of {len(found)}"
    verdict = "**missed**"
    if (ratio <= RATIO_GOAL[0]).all():
        verdict = "aim" if (of_means <= RATIO_GOAL[1]).all() else "acceptable"
    within = int((ratio <= RATIO_GOAL[0]).all(axis=1).sum())
    return [
        label, registered, errors(*before.mean(axis=0)), errors(*after.mean(axis=0)),
        _both(of_means), _both(ratio.max(axis=0)),
        f"{within} of {len(found)}", verdict,
    ]  # fmt: skip


RATIO_HEAD = (
    "scenes", "registered", "true boxes", "found", "ratio mm °", "worst mm °", f"seeds within {RATIO_GOAL[0]:g}", "reached",
)  # fmt: skip


def _both(ratio: Sequence[float] | np.ndarray) -> str:
    """Of position and of orientation."""
    return f"{number(ratio[0], 2)} {number(ratio[1], 2)}"


def seed_row(label: str, true: Calibrated, found: Calibrated) -> list[str]:
    """One seed: verdict, errors and the ratio."""
    ratio = (of([found]) / of([true]))[0] if complete(true) and complete(found) else (np.nan, np.nan)
    return [
        label, found.verdict, in_rig(found), _found(true), _found(found), _both(ratio), size(found),
        f"{number(found.seconds, 0)} s", f"{number(found.peak_mb, 0)} MB",
    ]  # fmt: skip


SEED_HEAD = ("scene", "verdict", "registered", "true boxes", "found", "ratio mm °", "scale", "wall time", "peak memory")


def box_rows(label: str, runs: Sequence[Watched]) -> list[list[str]]:
    """All boxes that were found, and those that the rig was computed from, all seeds together."""
    rows = []
    for what in ("found", "used"):
        scores = [score for run in runs if isinstance(score := getattr(run, what), BoxScore)]
        if scores:
            rows.append([f"{label}, {what}", *_box_cells(_together(scores))])
    return rows


def _together(scores: Sequence[BoxScore]) -> BoxScore:
    return BoxScore(
        sum(score.true for score in scores), sum(score.found for score in scores), sum(score.agreeing for score in scores),
        np.concatenate([score.errors for score in scores]),
    )  # fmt: skip


def _box_cells(score: BoxScore) -> list[str]:
    off = score.share_off(OFF)
    edges = [f"{100 * bias:+.1f} ± {100 * spread:.1f}" for bias, spread in zip(score.bias, score.spread, strict=True)]
    return [number(score.recall, 3), number(score.precision, 3), "-" if off is None else f"{100 * off:.1f} %", *edges]


BOX_HEAD = ("boxes", "recall", "precision", f"off by over {100 * OFF:.0f} %", "left, %", "top, %", "right, %", "bottom, %")


def pets_rows(networks: Calibrated, boxes: Calibrated, weight_free: Calibrated) -> list[list[str]]:
    """The video by networks, judged; by its given boxes, which is the aim; and without weights."""
    mm, degrees = (AS_WITH_BOXES * of([boxes])[0]).tolist()
    return [
        goal_row(f"{PETS_CAMERA} from its video, networks", networks, PETS_ACCEPTABLE, (mm, degrees)),
        goal_row(f"{PETS_CAMERA} from detections/", boxes, None, None),
        goal_row(f"{PETS_CAMERA} from its video, weight-free", weight_free, None, None),
    ]


def tracklet_rows(scores: Mapping[str, TrackletScore | str]) -> list[list[str]]:
    """IDF1 and what goes with it."""
    rows = []
    for label, score in scores.items():
        if isinstance(score, str):
            rows.append([label, score, *["-"] * (len(TRACKLET_HEAD) - 2)])
            continue
        wanted = "" if "comparison" in label else at_least(score.idf1, *IDF1_GOAL)
        shares = [number(share, 3) for share in (score.idf1, score.idp, score.idr, score.mota, score.purity)]
        counts = [str(count) for count in (score.switches, score.fragments, score.tracklets, score.people)]
        rows.append([label, *shares, *counts, wanted])
    return rows


TRACKLET_HEAD = (
    "tracklets", "IDF1", "IDP", "IDR", "MOTA", "purity", "switches", "fragments", "tracklets found", "people", "reached",
)  # fmt: skip


def at_least(value: float | None, acceptable: float, aim: float) -> str:
    """`aim`, `acceptable` or `missed` for a figure that is to be large."""
    return reached([None if value is None else -value], [-acceptable], [-aim])


def long_row(label: str, short: Mapping[str, float], long: Mapping[str, float]) -> list[str]:
    """A minute and ten of the same video; without a network the share is told only."""
    growth, learning = long["peak_mb"] / short["peak_mb"], long.get("background", 0.0)
    share = long["detection"] / (long["watching"] + learning)
    return [
        label, f"{short['peak_mb']:.0f} MB", f"{long['peak_mb']:.0f} MB", f"{growth:.2f}", yes(growth <= MOST_GROWTH),
        f"{long['watching']:.0f} s", f"{long['detection']:.0f} s", f"{learning:.0f} s", f"{100 * share:.0f} %",
        "" if learning else yes(share > LEAST_SHARE), f"{long['pictures']:.0f}", f"{long['boxes']:.0f}",
    ]  # fmt: skip


LONG_HEAD = (
    "detector", "peak, 1 min", "10 min", "ratio", f"at most {MOST_GROWTH:g}", "watching", "of which detecting",
    "and background learnt in", "detector's share", f"over {100 * LEAST_SHARE:.0f} %", "pictures", "boxes",
)  # fmt: skip


def told(run: Calibrated) -> str:
    """One line for whoever waits."""
    return CRASHED if run.verdict == CRASHED else f"{run.verdict}, {in_rig(run)}, {_found(run)}, {run.seconds:.0f} s"


Runs = Mapping[str, Watched]  # method -> one scene's run

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
            jobs = [partial(run_rendered, folder, method, into / method) for method in methods]
            done[preset][seed] = dict(zip(methods, run_two(jobs), strict=True))
            for method, run in done[preset][seed].items():
                _tell(f"{preset} {seed} {method}", told(run.calibrated))
            yield _rendered_tables(done)


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
    networks, boxes, weight_free = run_two([partial(run_pets, folder, method, path) for method, path in into.items()])
    for method, run in zip(into, (networks, boxes, weight_free), strict=True):
        _tell(f"pets2009 {method}", told(run))
    first = {"Result": table(GOAL_HEAD, pets_rows(networks, boxes, weight_free))}
    yield Found(first)
    rows = tracklet_rows(score_pets_tracklets(folder, into["networks"]))
    yield Found({**first, "Tracklets": table(TRACKLET_HEAD, rows)})


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
    jobs = [partial(run_room, rendered_room(place.scenes, seed), place.scratch / f"room-{seed}") for seed in seeds]
    runs = {f"room {seed}": run for seed, run in zip(seeds, run_two(jobs), strict=True)}
    for name, run in runs.items():
        _tell(name, told(run))
    yield Found({"Result": table(GOAL_HEAD, room_rows(runs))})


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
