"""`[solver] refine = ["clock_rate"]`: clocks that drift, set right by the people; solved again until they keep step."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from passerby.association.clocks.drift import Drift
from passerby.association.result import Association
from passerby.core.observations import Clock
from passerby.core.solution import Solution
from passerby.scene.inputs import SceneInputs

Solve = Callable[[SceneInputs], tuple[Solution, Association]]

MOST_ROUNDS = 6
"""A drift of 4 % settles in three or four: each solve sees the rest of it the better."""
SETTLED_SIGMAS, SETTLED_S = 8.0, 0.04
"""A drift below so many of its sigmas, or of so little over the recording, is none: sound clocks seem to drift by as much."""
SYSTEMATIC, SYSTEMATIC_S = 2.0, 0.02
"""What a fitted rate is off by: so many times the scatter of the people's ways, and so much over the recording."""


def rate_findings(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """What is told of the rates that were changed."""
    return tuple(
        f"the clock of {name} was fitted: {rate['fps']:.6g} frames per second (sigma {rate['sigma']:.1g}) in place of the "
        f"stated {rate['stated']:.6g}"
        for name, rate in figures.get("clock_rates", {}).items()
        if rate["fps"] != rate["stated"]
    )


def rated(inputs: SceneInputs, solve: Solve) -> tuple[Solution, Association]:
    """Solve, correct the frame rates by the drifts that are left, and solve again until none is.

    Args:
        inputs: all that was seen; where no frame rate is known, nothing is fitted.
        solve: makes a rig of it.
    """
    solution, association = solve(inputs)
    stated = _clocks(inputs)
    if not stated:
        return solution, association
    for _ in range(MOST_ROUNDS):
        rest = {name: drift for name, drift in against_one(association.drifts).items() if not _settled(drift)}
        if not rest:
            break
        clocks = _clocks(inputs)
        clocks |= {name: replace(clocks[name], fps=clocks[name].fps / (1 - drift.rate)) for name, drift in rest.items()}
        inputs = replace(inputs, observations=replace(inputs.observations, clocks=clocks))
        solution, association = solve(inputs)
    clocks = _clocks(inputs)
    rates = {
        name: {"fps": clocks[name].fps, "stated": stated[name].fps, "sigma": _sigma(drift) * clocks[name].fps}
        for name, drift in association.drifts.items()
    }
    return replace(solution, figures=solution.figures | {"clock_rates": rates}), association


def against_one(drifts: Mapping[str, Drift]) -> dict[str, Drift]:
    """Of two cameras the second's drift against the first, of which half was each one's; of more as they are."""
    if len(drifts) != 2:
        return dict(drifts)
    (first, a), (second, b) = drifts.items()
    return {first: replace(a, rate=0.0), second: replace(b, rate=b.rate - a.rate)}


def _clocks(inputs: SceneInputs) -> dict[str, Clock]:
    """Each camera's clock; empty where no rate is known."""
    seen = inputs.observations
    if seen.clocks or seen.fps is None:
        return dict(seen.clocks)
    return dict.fromkeys(inputs.rig.names, Clock(seen.fps))


def _sigma(drift: Drift) -> float:
    """One sigma of a rate that was fitted, relative."""
    return math.hypot(SYSTEMATIC * drift.sigma, SYSTEMATIC_S / max(drift.span_s, 1.0))


def _settled(drift: Drift) -> bool:
    """Whether nothing is left to correct."""
    return abs(drift.rate) < SETTLED_SIGMAS * drift.sigma or abs(drift.seconds) < SETTLED_S
