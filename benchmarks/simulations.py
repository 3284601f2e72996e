"""Runs on simulated scenes over many seeds: their goals, and what the runs have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from command import Calibrated
from paper.goals import PRESETS

__all__ = ["PRESETS", "WORKERS", "complete", "figures", "mean"]

WORKERS = 2


def figures(results: Sequence[Calibrated], *path: str) -> list[float]:
    """One figure of `evaluate --json` over the seeds; infinite where it is undefined, so that no failure is averaged away."""

    def of(result: Calibrated) -> float:
        value: Any = result.errors
        for key in path:
            value = None if value is None else value.get(key)
        return float("inf") if value is None or not complete(result) else float(value)

    return [of(result) for result in results]


def mean(results: Sequence[Calibrated], *path: str) -> float:
    """The mean of a figure over the seeds."""
    return float(np.mean(figures(results, *path)))


def complete(result: Calibrated) -> bool:
    """Whether all cameras were registered."""
    return result.errors is not None and result.errors["registered"] == result.cameras
