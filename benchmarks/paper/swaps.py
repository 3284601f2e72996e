"""Swapped identities: what becomes of the result when a share of the people of each camera and instant carry a wrong one."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from functools import partial

from pages.page import Page, number, table, yes
from paper.conditions import Condition, Method
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.spread import median, percent
from paper.sweep import Swept, curve_page, presets_of, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (0.0, 0.1, 0.2, 0.3, 0.5), (0.0, 0.3)
SEEDS = 5
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}
BORNE, LARGEST_RATIO = 0.3, 1.3
"""With 30 % of the identities wrong the errors of the default method may be this many times those without."""


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """Three scenes, five levels, five seeds, two methods; one scene, two levels and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, presets_of(wanted), tuple(METHODS), levels, SEEDS, wanted, executor, tell, "swaps")
    axis = Axis("swapped identities", "swapped", partial(percent, digits=0))
    return curve_page("swaps", _HEAD.format(seeds=swept.seeds, noise=100 * BOX_NOISE), swept, axis, _ratios(swept))


_HEAD = """# Swapped identities

The identities of a random share of the boxes of each camera and instant are exchanged among each other, anew at every instant;
edges of boxes have noise of {noise:g} % of the box height; {seeds} seeds."""


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    return Condition(SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, identity_swaps=level), METHODS[method])


def _ratios(swept: Swept) -> str:
    """The goal of the default method."""
    rows = []
    for preset in swept.presets:
        clean, swapped = (swept.outcomes[preset, "people", level] for level in (0.0, BORNE))
        figures = [median(swapped, figure) / median(clean, figure) for figure in ("similarity_mm", "similarity_deg")]
        rows.append([preset, *(number(ratio, 2) for ratio in figures), yes(max(figures) <= LARGEST_RATIO)])
    head = ("scene", "ratio, mm", "ratio, degrees", f"at most {LARGEST_RATIO}")
    about = (
        f"The default method with {percent(BORNE, 0)} swapped against none: the ratios of the medians of the similarity errors."
    )
    return f"{about}\n\n{table(head, rows)}"
