"""Clocks that disagree: found from people whose identities are given, and from people whom nobody told apart."""

from __future__ import annotations

from concurrent.futures import Executor

from pages.records import Found
from pages.tables import Table, number, table
from paper.conditions import Condition, Outcome, run_conditions
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.spread import FAILS, failures, of, quartiles
from paper.sweep import Swept, curve_found, seeds_of, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.scene.tables import SEARCHED_S
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (0.0, 0.2, 0.5, 1.0), (0.5,)
SEEDS = 5
PRESETS = ("terrace",)
GIVEN, UNSEARCHED, COMBINED = "given, searched", "given, not searched", "combined"
METHODS = (GIVEN, COMBINED, UNSEARCHED)

RATES = (5.0, 12.5, 25.0, 30.0, 50.0, 60.0)
EVERY = (1, 2, 3, 6)
UNEVEN_FPS = 50.0
SAMPLED_OFFSET_S, SAMPLED_SEEDS = 1.3, 2


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """One scene, four levels, five seeds, three ways to deal with clocks; one level and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, PRESETS, METHODS, levels, SEEDS, wanted, executor, tell, "clocks")
    axis = Axis("largest clock offset, s", "offsets, s")
    tables = {"Clock errors": _clocks(swept), "Sampled frames": _sampled_frames(wanted, executor, tell)}
    return curve_found("clocks", swept, axis, tables)


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(
        preset=preset, seed=seed, box_noise=BOX_NOISE, clock_offsets=level, unrelated_ids=method == COMBINED
    )
    return Condition(options, search_s=0.0 if method == UNSEARCHED else SEARCHED_S)


def _sampled_frames(wanted: Wanted, executor: Executor | None, tell: Progress) -> Table:
    """How well the clocks are found from every n-th picture of videos of all usual rates."""
    rates: tuple[float | None, ...] = (25.0,) if wanted.quick else (*RATES, None)
    every, seeds = (1, 6) if wanted.quick else EVERY, range(seeds_of(wanted, SAMPLED_SEEDS))
    keys = [(rate, step, method) for rate in rates for step in every for method in (GIVEN, COMBINED)]
    conditions = {key: [_of_rate(*key, seed) for seed in seeds] for key in keys}
    found = run_conditions([one for some in conditions.values() for one in some], executor, tell, "sampled frames", wanted.kept)
    rows = []
    for (rate, step, method), some in conditions.items():
        outcomes = tuple(found[one] for one in some)
        shown = ", ".join(f"{number(outcome.similarity_mm)} mm {outcome.similarity_deg:.3f}°" for outcome in outcomes)
        verdicts = ", ".join(outcome.verdict for outcome in outcomes)
        rate_shown = "uneven" if rate is None else f"{rate:g}"
        rows.append([rate_shown, f"{step}", method, shown, *_clock_cells(outcomes), verdicts])
    head = ("frames per second", "every n-th", "method", "similarity", "clock error, median", "worst", "failed", "verdicts")
    return table(head, rows)


def _of_rate(rate: float | None, every: int, method: str, seed: int) -> Condition:
    options = SimulationOptions(
        preset="terrace", seed=seed, fps=rate or UNEVEN_FPS, box_noise=BOX_NOISE, clock_offsets=SAMPLED_OFFSET_S,
        unrelated_ids=method == COMBINED,
    )  # fmt: skip
    return Condition(options, search_s=SEARCHED_S, every=every, uneven=rate is None)


def _clocks(swept: Swept) -> Table:
    """How well the clocks are found."""
    rows = [
        [preset, f"{level:g}", method, *_clock_cells(swept.outcomes[preset, method, level])]
        for preset in swept.presets
        for level in swept.levels
        for method in swept.methods
    ]
    head = ("scene", "offsets, s", "method", "clock error, median", "worst", "failed")
    return table(head, rows)


def _clock_cells(outcomes: tuple[Outcome, ...]) -> list[str]:
    errors = of(outcomes, "clock_ms")
    shown = [FAILS if error == float("inf") else f"{number(error)} ms" for error in (quartiles(errors)[1], max(errors))]
    return [*shown, failures(outcomes)]
