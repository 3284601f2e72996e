"""What the limits of a clock's drift are held against: clocks that keep step, and clocks that run too fast."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.association.clocks.drift import HARMFUL_RATE, HARMFUL_S, LEAST_S, SIGMAS, SPOILING_S, Drift
from passerby.simulation import PRESETS
from reliability.judging import calibrated, errors_of
from reliability.staging import HandedIn, staged

FIRST_SEED = 946_000
FPS = 5.0
LENGTHS_S = (30.0, 60.0, 120.0)
RATES = (0.0, 0.001, 0.003, 0.01, 0.03)
"""By which the second camera's clock is too fast; 25 frames a second for 24 are 0.04."""
FAST = "C2"
SIGMAS_TRIED, LEAST_TRIED = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0), (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
SPOILING_TRIED, HARMFUL_TRIED = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0), (0.2, 0.35, 0.5, 0.75, 1.0)
HARMFUL_RATES_TRIED = (0.002, 0.005, 0.01, 0.02, 0.05)


@dataclass(frozen=True)
class ClockCase:
    """One scene."""

    preset: str
    seed: int
    seconds: float
    rate: float

    @property
    def drift_s(self) -> float:
        """How far the clock runs away."""
        return self.rate * self.seconds


@dataclass(frozen=True)
class Clocked:
    """One scene's rig, and what is known of its clocks."""

    case: ClockCase
    worst_mm: float
    wrong: bool
    """Whether a camera is off by more than may be accepted."""
    drifts: Mapping[str, Drift]
    """By camera; empty where nothing is known."""

    def told(self, name: str, *, sigmas: float = SIGMAS, least_s: float = LEAST_S) -> bool:
        """Whether a camera's drift would be told by these limits."""
        drift = self.drifts.get(name)
        return drift is not None and abs(drift.rate) > sigmas * drift.sigma and abs(drift.seconds) > least_s


def cases(seeds: int) -> dict[str, ClockCase]:
    """Scenes of each preset, length and rate, one for every two seeds, by key."""
    wanted = [
        ClockCase(preset, FIRST_SEED + 100 * number + k, seconds, rate)
        for number, preset in enumerate(PRESETS)
        for seconds in LENGTHS_S
        for rate in RATES
        for k in range(max(1, seeds // 2))
    ]
    return {f"{one.preset} {one.seed} {one.seconds:g} {one.rate:g}": one for one in wanted}


def measure(case: ClockCase) -> dict[str, Any]:
    """A scene calibrated by identities that are given; nothing where fewer than two cameras have a pose."""
    scene = _scene(case)
    found = calibrated(scene)
    errors = errors_of(found.rig, scene.truth)
    if errors is None:
        return {}
    drifts = {} if found.association is None else found.association.drifts
    return {
        "worst_mm": errors.similarity_mm, "wrong": errors.wrong,
        "drifts": {name: [one.rate, one.sigma, one.span_s] for name, one in drifts.items()},
    }  # fmt: skip


def _scene(case: ClockCase) -> HandedIn:
    fast = (FPS, FPS * (1 + case.rate), FPS, FPS)
    scene = staged(case.seed, preset=case.preset, seconds=case.seconds, camera_fps=fast)
    return replace(scene, fps=FPS)


def tabulate(outcomes: Outcomes, wanted: Mapping[str, ClockCase]) -> Found:
    """Tables of drifts by rate and length, and of what other limits would do; `outcomes` of `measure`, by key."""
    known = [
        Clocked(wanted[key], one["worst_mm"], one["wrong"], {name: Drift(*drift) for name, drift in one["drifts"].items()})
        for key, one in outcomes.items()
        if one
    ]
    head = (
        "clock too fast by", "over", "drift", "scenes", "known in", "found, median", "sigma, median", "worst camera, median",
        "largest", "wrong rigs",
    )  # fmt: skip
    others = ("limit", "drifting clocks told", "clocks in step told")
    doubts = ("limit", "drifting scenes that are a doubt", "wrong rigs without one", "median of the worst cameras without one")
    steady = _median([one.worst_mm for one in known if not one.case.rate])
    tables = {
        "Scenes": table(head, list(_rows(known))),
        "SIGMAS": table(others, [_telling(known, limit, SIGMAS, sigmas=limit, least_s=0.0) for limit in SIGMAS_TRIED]),
        "LEAST_S": table(others, [_telling(known, limit, LEAST_S, sigmas=0.0, least_s=limit) for limit in LEAST_TRIED]),
        "SPOILING_S": table(doubts, [_judging(known, limit, SPOILING_S, spoiling=limit) for limit in SPOILING_TRIED]),
        "HARMFUL_S": table(doubts, [_judging(known, limit, HARMFUL_S, harmful=limit) for limit in HARMFUL_TRIED]),
        "HARMFUL_RATE": table(doubts, [_judging(known, limit, HARMFUL_RATE, rate=limit) for limit in HARMFUL_RATES_TRIED]),
    }
    run = f"SIGMAS = {SIGMAS:g}, LEAST_S = {LEAST_S:g}, SPOILING_S = {SPOILING_S:g}, HARMFUL_S = {HARMFUL_S:g}, "
    note = f"The worst cameras of rigs whose clocks keep step are off by {steady} mm."
    return Found(tables, [note], f"{run}HARMFUL_RATE = {HARMFUL_RATE:g}")


def _rows(known: list[Clocked]) -> Iterator[list[str]]:
    for rate in RATES:
        for seconds in LENGTHS_S:
            some = [one for one in known if (one.case.rate, one.case.seconds) == (rate, seconds)]
            own = [one.drifts[FAST] for one in some if FAST in one.drifts]
            yield [
                f"{100 * rate:g} %", f"{seconds:g} s", f"{rate * seconds:g} s", str(len(some)), str(len(own)),
                _median([abs(one.seconds) for one in own], 2), _median([one.sigma * one.span_s for one in own], 3),
                _median([one.worst_mm for one in some]), f"{max((one.worst_mm for one in some), default=np.nan):.0f}",
                str(sum(one.wrong for one in some)),
            ]  # fmt: skip


def _telling(known: list[Clocked], limit: float, in_force: float, **limits: float) -> list[str]:
    drifting = [one for one in known if one.case.drift_s >= LEAST_S]
    told = sum(one.told(FAST, **limits) for one in drifting)
    steady = [(one, name) for one in known for name in one.drifts if not one.case.rate]
    mistaken = sum(one.told(name, **limits) for one, name in steady)
    return [_bold(limit, in_force), f"{told} of {len(drifting)}", f"{mistaken} of {len(steady)}"]


def _judging(
    known: list[Clocked], limit: float, in_force: float, *, spoiling: float = SPOILING_S, harmful: float = HARMFUL_S,
    rate: float = HARMFUL_RATE,
) -> list[str]:  # fmt: skip
    """How many scenes with drifting clocks a limit doubts, and what the rigs without a doubt are like."""

    def doubted(one: Clocked) -> bool:
        return any(
            one.told(name) and (abs(drift.seconds) > spoiling or (abs(drift.seconds) > harmful and abs(drift.rate) > rate))
            for name, drift in one.drifts.items()
        )

    drifting = [one for one in known if one.case.rate]
    passed = [one for one in drifting if not doubted(one)]
    wrong = sum(one.wrong for one in passed)
    return [
        _bold(limit, in_force), f"{len(drifting) - len(passed)} of {len(drifting)}", str(wrong),
        f"{_median([one.worst_mm for one in passed])} mm",
    ]  # fmt: skip


def _median(values: list[float], digits: int = 0) -> str:
    return f"{np.median(values):.{digits}f}" if values else "-"


def _bold(limit: float, in_force: float) -> str:
    return f"**{limit:g}**" if limit == in_force else f"{limit:g}"
