"""Real data sets with given identities: errors, scale, vertical, ground, verdict, time and memory."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from command import ONE_THREAD, Calibrated, calibrate
from datasets import DATA_SETS, DataSet, data_set, folder_of, swap_identities, write_scene
from pages.records import Found
from pages.tables import errors, number, reached, table, yes

WORKERS = 2
KEYS = ("mean_position_mm", "mean_orientation_deg")


def figures(results: Sequence[Calibrated], *path: str) -> list[float]:
    """One figure of `evaluate --json` over the seeds; infinite where it is undefined, so that no failure is averaged away."""

    def of(result: Calibrated) -> float:
        value: Any = result.errors
        for key in path:
            value = None if value is None else value.get(key)
        return float("inf") if value is None or not complete(result) else float(value)

    return [of(result) for result in results]


def complete(result: Calibrated) -> bool:
    """Whether all cameras were registered."""
    return result.errors is not None and result.errors["registered"] == result.cameras


SHARE = 0.3
LARGEST_RATIO = 1.3
SEEDS = 3
REAL = ("wildtrack", "pets2009")


def run_swaps(scratch: Path, quick: bool) -> Found:
    """Three seeds of each set; one in a quick run_swaps."""
    rows = []
    for name in REAL:
        data = data_set(name)
        folder = folder_of(data)
        if folder is None:
            rows.append([name, NOT_HERE, *["-"] * 6])
        else:
            rows.append(_real_row(data, folder, range(1 if quick else SEEDS), scratch))
    head = ("data", "seeds", "clean", "swapped", "ratio, mm", "ratio, degrees", "worst seed, mm", f"at most {LARGEST_RATIO}")
    return Found({"Ratios": table(head, rows)})


def _real_row(data: DataSet, folder: Path, seeds: range, scratch: Path) -> list[str]:
    def solve(seed: int | None) -> Calibrated:
        into = scratch / f"{data.name}-{seed}"
        change = None if seed is None else swap_identities(SHARE, np.random.default_rng(seed))
        scene = write_scene(data, folder, into, change)
        return calibrate(scene, folder / "rig.toml", into / "out", environment=ONE_THREAD)

    with ThreadPoolExecutor(WORKERS) as pool:
        clean, *swapped = pool.map(solve, (None, *seeds))
    return _row(data.name, [clean] * len(swapped), swapped)


def _row(name: str, clean: Sequence[Calibrated], swapped: Sequence[Calibrated]) -> list[str]:
    before = [np.array(figures(clean, "similarity", key)) for key in KEYS]
    after = [np.array(figures(swapped, "similarity", key)) for key in KEYS]
    mm, degrees = (float(a.mean() / b.mean()) for a, b in zip(after, before, strict=True))
    return [
        name, str(len(swapped)), errors(*(float(b.mean()) for b in before)), errors(*(float(a.mean()) for a in after)),
        f"{mm:.2f}", f"{degrees:.2f}", f"{after[0].max():.1f} mm", yes(mm <= LARGEST_RATIO and degrees <= LARGEST_RATIO),
    ]  # fmt: skip


NOT_HERE = "not run: data not here"


def run(scratch: Path, quick: bool) -> Found:
    """Calibrate every data set once, one after the other, in the user's environment."""
    del quick  # it takes seconds
    rows, more = [], []
    for data in DATA_SETS:
        folder = folder_of(data)
        if folder is None:
            rows.append([data.name, NOT_HERE, *["-"] * 5])
            continue
        scene = write_scene(data, folder, scratch / data.name)
        result = calibrate(scene, folder / "rig.toml", scratch / data.name / "out")
        rows.append(_accuracy_row(data, result))
        more.append(_world_row(data, result))
    first = table(("data", "registered", "similarity", "acceptable", "aim", "reached", "metric"), rows)
    second = table(("data", "scale ratio", "stated sigma", "vertical", "ground", "verdict", "wall time", "peak memory"), more)
    return Found({"Errors": first, "World": second})


def _accuracy_row(data: DataSet, result: Calibrated) -> list[str]:
    found = result.errors or {"registered": 0, "similarity": {}, "metric": {}}
    similarity, metric = found["similarity"], found["metric"]
    values = (similarity.get("mean_position_mm"), similarity.get("mean_orientation_deg"))
    complete = found["registered"] == result.cameras
    return [
        data.name, f"{found['registered']} of {result.cameras}", errors(*values), errors(*data.goal.acceptable),
        errors(*data.goal.aim), reached(values, data.goal.acceptable, data.goal.aim) if complete else "**missed**",
        errors(metric.get("mean_position_mm"), metric.get("mean_orientation_deg")),
    ]  # fmt: skip


def _world_row(data: DataSet, result: Calibrated) -> list[str]:
    found = result.errors or {}
    return [
        data.name, number(found.get("scale_ratio"), 4), number(result.scale_sigma, 4),
        f"{number(found.get('gravity_error_deg'), 2)}°", f"{number(found.get('ground_error_mm'))} mm", result.verdict,
        f"{result.seconds:.1f} s", f"{result.peak_mb:.0f} MB",
    ]  # fmt: skip
