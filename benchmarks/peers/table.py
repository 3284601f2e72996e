"""The tables of the page: errors and failures, seconds and memory, and whether the goals are met."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, median

from pages.tables import Table, errors, number, table, yes
from passerby.core.cameras import Rig
from passerby.evaluation.metrics import compare
from peers.runners import Outcome

LARGEST_MM, LARGEST_DEG = 1000.0, 10.0  # a mean error beyond is a failure: nobody can use such cameras


@dataclass(frozen=True)
class Result:
    """One engine on one table of points."""

    mm: float | None  # mean position error over all cameras after the best similarity; None where it has none or is a failure's
    degrees: float | None
    failure: str | None
    registered: int
    solve_seconds: float
    whole_seconds: float
    peak_mb: float
    version: str


def mean_result(results: Sequence[Result]) -> Result:
    """Several seeds as one: means, the largest memory; a failure where any of them fails, so that none is averaged away."""
    if len(results) == 1:
        return results[0]
    failures = [result.failure for result in results if result.failure]
    return Result(
        mm=None if failures else fmean(result.mm or 0.0 for result in results),
        degrees=None if failures else fmean(result.degrees or 0.0 for result in results),
        failure=f"{len(failures)} of {len(results)}: {failures[0]}" if failures else None,
        registered=min(result.registered for result in results),
        solve_seconds=fmean(result.solve_seconds for result in results),
        whole_seconds=fmean(result.whole_seconds for result in results),
        peak_mb=max(result.peak_mb for result in results),
        version=results[0].version,
    )


def judge(outcome: Outcome, truth: Rig) -> Result:
    """Compare with the truth. A failure is: no result, a camera that is missing, more than 1 m or more than 10 degrees."""
    poses = {name: pose for name, pose in outcome.poses.items() if name in truth.names}
    failure, mm, degrees = outcome.failure, None, None
    if failure is None and len(poses) < len(truth):
        failure = f"{len(poses)} of {len(truth)} cameras"
    if failure is None:
        estimate = Rig(tuple(replace(camera, pose=poses[camera.name], sigma=None) for camera in truth))
        similarity = compare(estimate, truth).similarity
        mm, degrees = similarity.mean_position_mm, similarity.mean_orientation_deg
        if mm is None or degrees is None:
            failure = "no similarity to the truth"
        elif mm > LARGEST_MM or degrees > LARGEST_DEG:
            failure, mm, degrees = f"{mm / 1000:.1f} m {degrees:.0f}°", None, None
    return Result(
        mm, degrees, failure, len(poses), outcome.solve_seconds, outcome.whole_seconds, outcome.peak_mb, outcome.version
    )


PASSERBY, CALISCOPE = "Passerby", "caliscope"


@dataclass(frozen=True)
class Row:
    """All engines on one table of points."""

    data: str
    condition: str
    points: str
    results: Mapping[str, Result]  # engine -> result; those that were not run are missing

    @property
    def ours(self) -> Result:
        """Passerby's."""
        return self.results[PASSERBY]

    @property
    def place(self) -> tuple[str, str, str]:
        """The first cells."""
        return self.data, self.condition, self.points


def errors_table(rows: Sequence[Row], engines: Sequence[str]) -> Table:
    """Similarity errors and failures, an engine a column; the last column names the peers that are better."""
    head = ("data", "condition", "points", PASSERBY, *engines, "better than Passerby")
    return table(
        head, ([*row.place, *(_error(row.results.get(name)) for name in (PASSERBY, *engines)), _better(row)] for row in rows)
    )


def costs_table(rows: Sequence[Row], engines: Sequence[str]) -> Table:
    """Seconds of the solver alone and of the whole process, and peak memory."""
    head = ("data", "condition", "points", *(f"{name}: solve, whole, memory" for name in (PASSERBY, *engines)))
    return table(head, ([*row.place, *(_cost(row.results.get(name)) for name in (PASSERBY, *engines))] for row in rows))


def summary_table(rows: Sequence[Row], engines: Sequence[str]) -> Table:
    """A line a peer: failures, in how many cases Passerby's error is lower, and the ratios of error and time."""
    head = ("peer", "cases", "fails", "Passerby fails", "Passerby lower, mm", "lower, degrees", "mm ratio",
            "solve ratio", "whole ratio", "peak memory")  # fmt: skip
    return table(head, (_summary(name, [row for row in rows if name in row.results]) for name in engines))


def goal_lines(rows: Sequence[Row], engines: Sequence[str]) -> str:
    """The three goals, and the cases that miss them."""
    compared = [(row, name) for row in rows for name in engines if name in row.results]
    higher = [(row, name) for row, name in compared if not lower(row.ours, row.results[name])]
    failed = [(row, name) for row, name in compared if row.ours.failure and not row.results[name].failure]
    raced = [row for row in rows if CALISCOPE in row.results]
    slower = [row for row in raced if row.ours.whole_seconds > row.results[CALISCOPE].whole_seconds]
    slower_solving = [row for row in raced if _seconds(row.ours) > _seconds(row.results[CALISCOPE])]
    lines = [
        f"- Lower error than each peer, mm and degrees: {yes(not higher)}, {len(compared) - len(higher)} of {len(compared)}.",
        f"- No failure where a peer has none: {yes(not failed)}{_listed(failed)}.",
    ]
    if raced:
        ratio = sum(row.ours.whole_seconds for row in raced) / sum(row.results[CALISCOPE].whole_seconds for row in raced)
        lines.append(
            f"- Not slower than caliscope: {yes(not slower)} for the whole process, {len(raced) - len(slower)} of {len(raced)} "
            f"(all together {ratio:.2f} of its time); {yes(not slower_solving)} for the solver alone, "
            f"{len(raced) - len(slower_solving)} of {len(raced)}."
        )
    return "\n".join(lines)


def lower(ours: Result, theirs: Result) -> bool:
    """Whether our error is lower, in position and orientation; a failure is beaten by everything, and beats nothing."""
    if ours.failure:
        return False
    if theirs.failure:
        return True
    return _of(ours.mm) < _of(theirs.mm) and _of(ours.degrees) < _of(theirs.degrees)


def _of(value: float | None) -> float:
    return math.inf if value is None else value


def _error(result: Result | None) -> str:
    if result is None:
        return "-"
    return f"fails: {result.failure}" if result.failure else errors(result.mm, result.degrees)


def _better(row: Row) -> str:
    """The peers that are lower in something, and in what."""
    if len(row.results) == 1:
        return "-"
    found = []
    for name, theirs in row.results.items():
        if name == PASSERBY or theirs.failure:
            continue
        if row.ours.failure:
            found.append(name)
            continue
        where = [
            unit
            for unit, a, b in (("mm", row.ours.mm, theirs.mm), ("°", row.ours.degrees, theirs.degrees))
            if not _of(a) < _of(b)
        ]
        if where:
            found.append(f"{name} ({', '.join(where)})")
    return ", ".join(found) or "none"


def _cost(result: Result | None) -> str:
    if result is None:
        return "-"
    return f"{number(result.solve_seconds, 2)} s, {number(result.whole_seconds, 1)} s, {number(result.peak_mb, 0)} MB"


def _summary(name: str, rows: Sequence[Row]) -> list[str]:
    pairs = [(row.ours, row.results[name]) for row in rows]
    both = [(a, b) for a, b in pairs if not a.failure and not b.failure]
    used = [b.peak_mb for _, b in pairs if math.isfinite(b.peak_mb)]
    return [
        name, str(len(rows)), str(sum(bool(b.failure) for _, b in pairs)), str(sum(bool(a.failure) for a, _ in pairs)),
        f"{sum(_ahead(a, b, 'mm') for a, b in pairs)} of {len(rows)}",
        f"{sum(_ahead(a, b, 'degrees') for a, b in pairs)} of {len(rows)}",
        _median(_of(a.mm) / _of(b.mm) for a, b in both),
        _median(a.solve_seconds / b.solve_seconds for a, b in both),
        _median(a.whole_seconds / b.whole_seconds for a, b in pairs),
        f"{number(max(used, default=math.nan), 0)} MB",
    ]  # fmt: skip


def _ahead(ours: Result, theirs: Result, what: str) -> bool:
    """Whether our figure is the lower one."""
    if ours.failure:
        return False
    return bool(theirs.failure) or _of(getattr(ours, what)) < _of(getattr(theirs, what))


def _median(values: Iterable[float]) -> str:
    found = list(values)
    return f"{median(found):.2f}" if found else "-"


def _seconds(result: Result) -> float:
    """The solver's seconds; of one that was stopped, those of the process."""
    return result.solve_seconds if math.isfinite(result.solve_seconds) else result.whole_seconds


def _listed(cases: Sequence[tuple[Row, str]]) -> str:
    return f": {'; '.join(f'{name} on {row.data}, {row.condition}, {row.points}' for row, name in cases)}" if cases else ""
