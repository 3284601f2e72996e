"""The rows of the tables about people who are found in videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from association_tables import KEYS
from command import Calibrated, Run
from metrics.detections import BoxScore
from metrics.tracklets import TrackletScore
from pages.tables import Table, errors, number, reached, table, yes
from perception_runs import CRASHED, PETS_CAMERA, Demo, Watched
from simulations import complete, figures

Bounds = tuple[float, float]

DEMO_GOAL, DEMO_SECONDS = ((60.0, 0.3), (20.0, 0.1)), 180.0
RATIO_GOAL = (2.5, 1.5)
PETS_ACCEPTABLE, AS_WITH_BOXES = (450.0, 1.0), 1.05
IDF1_GOAL = (0.65, 0.75)
SINGLE_GOAL = ((60.0, 1.0), (40.0, 0.7))
LEAST_SHARE, MOST_GROWTH = 0.7, 1.1
OFF = 0.1
"""Heights by which an edge that is off harms."""


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
    "scene",
    "boxes alone",
    "scale",
    "with joints",
    "scale",
    "watching, boxes alone",
    "with joints",
    "ratio",
    "reached",
)


def room_rows(runs: Mapping[str, Calibrated]) -> list[list[str]]:
    """Seed by seed, and how many reach the goal."""
    rows = [goal_row(label, run, *ROOM_GOAL) for label, run in runs.items()]
    least = [sum(judged(run, *ROOM_GOAL) in wanted for run in runs.values()) for wanted in (("acceptable", "aim"), ("aim",))]
    verdict = "aim" if least[1] == len(runs) else "acceptable" if least[0] >= ROOM_SHARE * len(runs) else "**missed**"
    return [*rows, ["all", "", f"{least[0]} of {len(runs)} acceptable", "", "", "", verdict, "", ""]]


ROOM_GOAL = ((150.0, 2.0), (80.0, 1.0))
ROOM_SHARE = 0.8
"""Of the seeds, to reach what is acceptable."""


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
        sum(score.true for score in scores),
        sum(score.found for score in scores),
        sum(score.agreeing for score in scores),
        np.concatenate([score.errors for score in scores]),
    )


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
