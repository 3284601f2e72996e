"""Swapped identities on the real sets: what becomes of the result when 30 % of the people of each instant carry a wrong one.

The simulated scenes are `python benchmarks/run_paper.py swaps`.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from accuracy import NOT_HERE
from command import ONE_THREAD, Calibrated, calibrate
from datasets import DataSet, data_set, folder_of, swap_identities, write_scene
from pages.records import Found
from pages.tables import errors, table, yes
from simulations import WORKERS, figures

SHARE = 0.3
LARGEST_RATIO = 1.3
SEEDS = 3
REAL = ("wildtrack", "pets2009")


def run(scratch: Path, quick: bool) -> Found:
    """Three seeds of each set; one in a quick run."""
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
    before = [np.array(figures(clean, "similarity", key)) for key in ("mean_position_mm", "mean_orientation_deg")]
    after = [np.array(figures(swapped, "similarity", key)) for key in ("mean_position_mm", "mean_orientation_deg")]
    mm, degrees = (float(a.mean() / b.mean()) for a, b in zip(after, before, strict=True))
    return [
        name, str(len(swapped)), errors(*(float(b.mean()) for b in before)), errors(*(float(a.mean()) for a in after)),
        f"{mm:.2f}", f"{degrees:.2f}", f"{after[0].max():.1f} mm", yes(mm <= LARGEST_RATIO and degrees <= LARGEST_RATIO),
    ]  # fmt: skip
