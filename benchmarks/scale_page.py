"""`docs/results/scale.md`: what each thing that is known of the scale buys, beside the goals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from datasets import ROOT
from pages.cases import Outcomes
from pages.parts import Cases, Part, PartedPage, found_of
from pages.records import Found
from pages.tables import errors, number, reached, table
from scale import simulated

CODE = ("scale",)
"""Folders of the benchmarks that the outcomes depend on, beside the package; how they are shown is not among them."""
SEEDS = 10  # of each preset
KEPT = ROOT / "build" / "scale"

_COLUMNS = ("known", "scenes", "registered", "verdicts", "error of lengths, median", "90 %", "largest", "mean, signed",
            "stated sigma, median", "within 2 sigmas", "largest, in sigmas", "shape")  # fmt: skip


@dataclass(frozen=True)
class Goal:
    """A figure of some cases that is asked for: (acceptable, aim)."""

    text: str
    known: str
    figure: Callable[[Sequence[Mapping[str, Any]]], float]
    limits: tuple[float, float]
    unit: str = " %"
    more: bool = False  # whether more is better


def _errors(cases: Sequence[Mapping[str, Any]]) -> list[float]:
    """Signed errors of the scale, per cent; infinite where there is none."""
    found = [case.get("scale_percent") for case in cases]
    return [math.inf if value is None or not math.isfinite(value) else float(value) for value in found]


def _in_sigmas(cases: Sequence[Mapping[str, Any]]) -> list[float]:
    """Errors over their stated sigmas; infinite where either is missing."""
    pairs = zip(_errors(cases), cases, strict=True)
    return [abs(off) / case["sigma_percent"] if case["sigma_percent"] else math.inf for off, case in pairs]


def _median(cases: Sequence[Mapping[str, Any]]) -> float:
    return float(np.median(np.abs(_errors(cases))))


def _signed(cases: Sequence[Mapping[str, Any]]) -> float:
    return abs(float(np.mean(_errors(cases))))


def _largest_in_sigmas(cases: Sequence[Mapping[str, Any]]) -> float:
    return max(_in_sigmas(cases))


def _within(cases: Sequence[Mapping[str, Any]]) -> float:
    return 100 * float(np.mean(np.array(_in_sigmas(cases)) <= 2))


def _shape(cases: Sequence[Mapping[str, Any]], key: str) -> float:
    return float(np.median([case.get(key, math.inf) for case in cases]))


def _unknown(cases: Sequence[Mapping[str, Any]]) -> float:
    values = [value for case in cases for value in case.values() if value is None or isinstance(value, float)]
    return float(sum(value is None or not math.isfinite(value) for value in values))


GOALS: Mapping[str, Sequence[Goal]] = {
    "nobody": (
        Goal("nobody known, boxes: error of lengths, median", "nothing", _median, (4.0, 3.0)),
        Goal("nobody known, boxes: mean signed error", "nothing", _signed, (2.5, 1.5)),
        Goal("nobody known, boxes: largest error in stated sigmas", "nothing", _largest_in_sigmas, (2.5, 2.0), ""),
    ),
    "person": (
        Goal("one person, boxes: error of lengths, median", "person", _median, (2.5, 2.0)),
        Goal("one person, boxes, identities found: median", "person, identities found", _median, (2.5, 2.0)),
        Goal("one person, keypoints: error of lengths, median", "person and keypoints", _median, (1.5, 1.0)),
    ),
    "plan": (
        Goal("a plan with two points: error of lengths, median", "two points", _median, (0.6, 0.4)),
        Goal("a plan with two cameras: error of lengths, median", "two cameras", _median, (0.6, 0.4)),
    ),
    "length": (Goal("one marked length: error of lengths, median", "length", _median, (0.6, 0.4)),),
    "upper": (
        Goal("upper bodies: position, median", "upper bodies", partial(_shape, key="mm"), (60.0, 40.0), " mm"),
        Goal("upper bodies: orientation, median", "upper bodies", partial(_shape, key="deg"), (1.5, 1.0), "°"),
        Goal("upper bodies: error of lengths, median", "upper bodies", _median, (8.0, 5.0)),
        Goal("upper bodies: within two stated sigmas", "upper bodies", _within, (90.0, 90.0), " %", more=True),
        Goal("upper bodies: figures that are no numbers", "upper bodies", _unknown, (0.0, 0.0), ""),
    ),
}


def tabulate(part: str, cases: Cases, done: Outcomes) -> Found:
    """A part as far as it is finished."""
    rows = []
    for known in dict.fromkeys(case.known for case in cases.values()):
        for preset in (None, *dict.fromkeys(case.preset for case in cases.values())):
            if some := _of(done, known, preset):
                rows.append(_row(f"{known}, {preset or 'all'}", some))
    goals = [_goal_row(goal, some) for goal in GOALS[part] if (some := _of(done, goal.known))]
    return found_of(cases, done, {"Scenes": table(_COLUMNS, rows)}, goals)


def _of(done: Outcomes, known: str, preset: str | None = None) -> list[Mapping[str, Any]]:
    return [one for one in done.values() if one["about"]["known"] == known and preset in (None, one["about"]["preset"])]


def _row(name: str, cases: Sequence[Mapping[str, Any]]) -> list[str]:
    """One line of a part's table."""
    off, of = np.array(_errors(cases)), [case["verdict"] for case in cases]
    sigma = [case["sigma_percent"] for case in cases if case["sigma_percent"] is not None]
    return [
        name, str(len(cases)), f"{sum(case['registered'] for case in cases)} of {sum(case['cameras'] for case in cases)}",
        ", ".join(f"{of.count(verdict)} {verdict}" for verdict in ("accepted", "doubtful", "refused") if verdict in of),
        f"{number(_median(cases), 2)} %", f"{number(float(np.sort(np.abs(off))[math.ceil(0.9 * len(off)) - 1]), 2)} %",
        f"{number(float(np.abs(off).max()), 2)} %", f"{number(float(np.mean(off)), 2)} %",
        f"{number(float(np.median(sigma)) if sigma else None, 2)} %", f"{number(_within(cases), 0)} %",
        number(_largest_in_sigmas(cases), 1), errors(_shape(cases, "mm"), _shape(cases, "deg")),
    ]  # fmt: skip


def _goal_row(goal: Goal, cases: Sequence[Mapping[str, Any]]) -> list[str]:
    """A figure against what is asked of it."""
    value = goal.figure(cases)
    sign = -1 if goal.more else 1
    limits = [[sign * limit] for limit in goal.limits]
    verdict = reached([sign * value if math.isfinite(value) else None], *limits)
    measured = f"{number(value, 2)}{goal.unit} ({len(cases)} scenes)"
    return [goal.text, measured, *(f"{limit:g}{goal.unit}" for limit in goal.limits), verdict]


PAGE = PartedPage(
    "scale", {part: Part(partial(simulated.cases, part), simulated.work, partial(tabulate, part)) for part in GOALS},
    CODE, KEPT, SEEDS,
)  # fmt: skip
