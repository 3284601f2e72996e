"""Clocks that disagree: found from people whose identities are given, and from people whom nobody told apart."""

from __future__ import annotations

from concurrent.futures import Executor

from passerby.benchmark.conditions import Condition, Outcome
from passerby.benchmark.goals import BOX_NOISE
from passerby.benchmark.page import Page, Wanted, number, table
from passerby.benchmark.plots import Axis
from passerby.benchmark.spread import FAILS, failures, of, quartiles
from passerby.benchmark.sweep import Swept, curve_page, sweep
from passerby.progress import Progress
from passerby.scene_tables import SEARCHED_S
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (0.0, 0.2, 0.5, 1.0), (0.5,)
SEEDS = 5
PRESETS = ("terrace",)
GIVEN, UNSEARCHED, COMBINED = "given, searched", "given, not searched", "combined"
METHODS = (GIVEN, COMBINED, UNSEARCHED)


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """One scene, four levels, five seeds, three ways to deal with clocks; one level and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, PRESETS, METHODS, levels, SEEDS, wanted, executor, tell, "clocks")
    head = _HEAD.format(seeds=swept.seeds, noise=100 * BOX_NOISE, search=SEARCHED_S)
    axis = Axis("largest clock offset, s", "offsets, s")
    return curve_page("clocks", head, swept, axis, _clocks(swept))


_HEAD = """# Clocks

Every camera but the first has a clock of its own, constantly off by up to plus or minus so much; 5 instants a second, so that
most offsets are no whole frames. Edges of boxes have noise of {noise:g} % of the box height; {seeds} seeds.

*given, searched*: identities are given, offsets up to {search:g} s are searched for. *combined*: neither identities nor clocks
are known, the default of a scene file; boxes come without appearance, and everybody is one tracklet in each camera. *given, not
searched*: the clocks are taken to agree."""


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(
        preset=preset, seed=seed, box_noise=BOX_NOISE, clock_offsets=level, unrelated_ids=method == COMBINED
    )
    return Condition(options, search_s=0.0 if method == UNSEARCHED else SEARCHED_S)


def _clocks(swept: Swept) -> str:
    """How well the clocks are found."""
    rows = [
        [preset, f"{level:g}", method, *_clock_cells(swept.outcomes[preset, method, level])]
        for preset in swept.presets
        for level in swept.levels
        for method in swept.methods
    ]
    head = ("scene", "offsets, s", "method", "clock error, median", "worst", "failed")
    about = "Mean error over the cameras of the offsets to the first camera's clock:"
    return f"{about}\n\n{table(head, rows)}"


def _clock_cells(outcomes: tuple[Outcome, ...]) -> list[str]:
    errors = of(outcomes, "clock_ms")
    shown = [FAILS if error == float("inf") else f"{number(error)} ms" for error in (quartiles(errors)[1], max(errors))]
    return [*shown, failures(outcomes)]
