"""Table 3 of the paper: errors under uniform noise of the boxes' corners, beside the paper's own figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace

from pages.records import Found
from pages.tables import Table, number, table, yes
from paper.conditions import Condition, Method, Outcome
from paper.paper_figures import NOISE, NOISE_FAILS_PX, POSES
from paper.parts import Wanted
from paper.plots import FAILS, Axis, Line, Panel, error_plot, failures, median, median_errors, of, worst_errors
from paper.sweep import Swept, curve_found, sweep
from passerby.common.progress import Progress
from passerby.simulation import PRESETS, SimulationOptions

LEVELS, QUICK_LEVELS = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0), (10.0, 20.0)
SEEDS = 5
AXIS = Axis("corner noise, px", "N, px", scale="symlog")
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}


@dataclass(frozen=True)
class Goal:
    """What must hold at one level, by the similarity placement."""

    preset: str
    level: float
    mm: float
    degrees: float


GOALS = (Goal("basketball", 10.0, 100.0, 0.5), Goal("basketball", 20.0, 100.0, 0.5))


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """Three scenes, seven levels, five seeds, two methods; two levels and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, tuple(PRESETS), tuple(METHODS), levels, SEEDS, wanted, executor, tell, "noise")
    found = curve_found("noise", swept, AXIS, {"Against the paper": _against_paper(swept), "Default method": _goals(swept)})
    metric = error_plot(_with_paper(swept), AXIS, "metric error, mm")
    return replace(found, files={**found.files, "noise-metric.svg": metric})


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    return Condition(SimulationOptions(preset=preset, seed=seed, corner_noise_px=level), METHODS[method])


def _against_paper(swept: Swept) -> Table:
    rows = []
    for preset in swept.presets:
        for level in swept.levels:
            paper = _paper(preset, level)
            cells = [preset, f"{level:g}", _paper_text(paper)]
            for method in swept.methods:
                outcomes = swept.outcomes[preset, method, level]
                cells += [median_errors(outcomes, "metric"), failures(outcomes), _better(outcomes, paper)]
            rows.append(cells)
    head = [cell for method in swept.methods for cell in (method, "failed", "better")]
    return table(("scene", "N, px", "paper", *head), rows)


def _paper(preset: str, level: float) -> tuple[float, float] | None:
    """The paper's own errors, infinite where it fails; None where it states none."""
    if level >= NOISE_FAILS_PX:
        return math.inf, math.inf
    return POSES["boxes-re-id"][preset] if level == 0 else NOISE[preset].get(level)


def _paper_text(paper: tuple[float, float] | None) -> str:
    """With the paper's own digits."""
    if paper is None:
        return "-"
    return f"{paper[0]:.0f} mm {paper[1]:.2f}°" if math.isfinite(paper[0]) else FAILS


def _better(outcomes: tuple[Outcome, ...], paper: tuple[float, float] | None) -> str:
    """Whether the medians are better than the paper's figures, and of how many seeds it holds."""
    if paper is None:
        return "-"
    pairs = zip(of(outcomes, "metric_mm"), of(outcomes, "metric_deg"), strict=True)
    better = [mm < paper[0] and degrees < paper[1] for mm, degrees in pairs]
    middle = median(outcomes, "metric_mm") < paper[0] and median(outcomes, "metric_deg") < paper[1]
    return f"{yes(middle)} ({sum(better)} of {len(better)})"


def _goals(swept: Swept) -> Table:
    rows = []
    for goal in GOALS:
        outcomes = swept.outcomes[goal.preset, "people", goal.level]
        middle = median(outcomes, "similarity_mm") <= goal.mm and median(outcomes, "similarity_deg") <= goal.degrees
        worst = max(of(outcomes, "similarity_mm")) <= goal.mm and max(of(outcomes, "similarity_deg")) <= goal.degrees
        rows.append(
            [goal.preset, f"{goal.level:g}", f"{number(goal.mm, 0)} mm {number(goal.degrees)}°",
             median_errors(outcomes, "similarity"), yes(middle), worst_errors(outcomes, "similarity"), yes(worst)]
        )  # fmt: skip
    return table(("scene", "N, px", "goal", "median", "reached", "worst seed", "reached"), rows)


def _with_paper(swept: Swept) -> list[Panel]:
    """The panels of the metric errors with the paper's figures as one more line."""
    panels = []
    for panel in swept.panels("metric_mm"):
        known = {level: errors[0] for level in swept.levels if (errors := _paper(panel.title, level)) is not None}
        paper = Line("paper, real scene", tuple(known), tuple((mm,) for mm in known.values()))
        panels.append(Panel(panel.title, (*panel.lines, paper)))
    return panels
