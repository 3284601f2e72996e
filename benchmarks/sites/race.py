"""Passerby's solver against COLMAP's incremental mapper, on the cases of the page of peers."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from peers.cases import all_cases
from peers.page import merged, run_case
from peers.runners import PASSERBY, PEERS

COLMAP = next(peer for peer in PEERS if peer.name == "COLMAP")


@dataclass(frozen=True)
class RaceCase:
    """All cases of the page of peers."""


def cases(seeds: int) -> dict[str, RaceCase]:
    """By key; none where COLMAP's environment was not made."""
    del seeds
    return {} if COLMAP.interpreter() is None else {"against COLMAP": RaceCase()}


def measure(case: RaceCase) -> dict[str, Any]:
    """Processor seconds of both solvers where neither fails: plain values."""
    del case
    with tempfile.TemporaryDirectory(prefix="passerby-race-") as folder:
        rows = merged([row for one in all_cases() for row in run_case(one, Path(folder), (COLMAP,))])
    pairs = [(row.results[PASSERBY.name], row.results[COLMAP.name]) for row in rows]
    both = [(ours, theirs) for ours, theirs in pairs if not ours.failure and not theirs.failure]
    spent = [one.whole_seconds for pair in pairs for one in pair if math.isfinite(one.whole_seconds)]
    return {
        "cpu_s": sum(spent), "rows": len(rows), "neither_fails": len(both),
        "ours_fail": sum(bool(ours.failure) for ours, _ in pairs),
        "theirs_fail": sum(bool(theirs.failure) for _, theirs in pairs),
        "ratio": median(ours.solve_seconds / theirs.solve_seconds for ours, theirs in both),
        "whole_ratio": median(ours.whole_seconds / theirs.whole_seconds for ours, theirs in both),
        "ours_s": sum(ours.solve_seconds for ours, _ in both), "theirs_s": sum(theirs.solve_seconds for _, theirs in both),
    }  # fmt: skip
