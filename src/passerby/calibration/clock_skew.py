"""Correction of wrong frame rates by the drift of the people's times, for `[solver] refine = ["clock_rate"]`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from passerby.association.clocks.drift import Drift
from passerby.calibration.run import Correction, Estimate
from passerby.core.figures import FittedRate
from passerby.core.observations import Clock
from passerby.findings.finding import Finding, notice
from passerby.scene.inputs import SceneInputs

MOST_CORRECTIONS = 6
"""Largest number of corrections. A drift of 4 % settles in three or four: each estimate shows the rest of it more clearly."""
SETTLED_SIGMAS, SETTLED_S = 8.0, 0.04
"""A drift below this many of its sigmas, or below this many seconds over the recording, is not corrected: sound clocks seem to
drift by as much."""
SYSTEMATIC, SYSTEMATIC_S = 2.0, 0.02
"""Error of a fitted rate: this many times its sigma by the scatter of the people's trajectories, and this many seconds over the
recording."""


def clock_skew_findings(rates: Mapping[str, FittedRate]) -> tuple[Finding, ...]:
    """Return a notice for each frame rate that was changed."""
    return tuple(
        notice("clock_fitted", name, fps=rate.fps, sigma=rate.sigma, stated=rate.stated)
        for name, rate in rates.items()
        if rate.fps != rate.stated
    )


class ClockRateCorrection(Correction):
    """Inputs with corrected frame rates."""


def correct_clock_rates(inputs: SceneInputs, estimate: Estimate) -> ClockRateCorrection | None:
    """Correct the frame rates by the drifts that an estimate shows; None if no rate is known, or if no clock still drifts."""
    clocks = _clocks(inputs)
    rest = {name: drift for name, drift in relative_to_first(estimate.association.drifts).items() if not _settled(drift)}
    if not clocks or not rest:
        return None
    clocks |= {name: replace(clocks[name], fps=clocks[name].fps / (1 - drift.rate)) for name, drift in rest.items()}
    return ClockRateCorrection(replace(inputs, observations=replace(inputs.observations, clocks=clocks)))


def clock_rate_figures(stated: SceneInputs, corrected: SceneInputs, estimate: Estimate) -> dict[str, FittedRate]:
    """Return the fitted rate of each camera, with the stated one."""
    before, after = _clocks(stated), _clocks(corrected)
    return {
        name: FittedRate(fps=after[name].fps, stated=before[name].fps, sigma=_sigma(drift) * after[name].fps)
        for name, drift in estimate.association.drifts.items()
        if name in before
    }


def relative_to_first(drifts: Mapping[str, Drift]) -> dict[str, Drift]:
    """Return the drifts of two cameras with that of the first as 0 and of the second relative to it; of more unchanged."""
    if len(drifts) != 2:
        return dict(drifts)
    (first, a), (second, b) = drifts.items()
    return {first: replace(a, rate=0.0), second: replace(b, rate=b.rate - a.rate)}


def _clocks(inputs: SceneInputs) -> dict[str, Clock]:
    """Return each camera's clock; empty if no rate is known."""
    seen = inputs.observations
    if seen.clocks or seen.fps is None:
        return dict(seen.clocks)
    return dict.fromkeys(inputs.rig.names, Clock(seen.fps))


def _sigma(drift: Drift) -> float:
    """Return one sigma of a fitted rate, relative."""
    return math.hypot(SYSTEMATIC * drift.sigma, SYSTEMATIC_S / max(drift.span_s, 1.0))


def _settled(drift: Drift) -> bool:
    """Check whether a drift is too small to correct."""
    return abs(drift.rate) < SETTLED_SIGMAS * drift.sigma or abs(drift.seconds) < SETTLED_S
