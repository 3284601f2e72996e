"""The number of people."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor

from pages.page import Page
from paper.conditions import Condition, Method
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.sweep import curve_page, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (1.0, 2.0, 4.0, 7.0, 12.0, 20.0), (1.0, 7.0)
SEEDS = 5
PRESETS = ("terrace",)
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """One scene, six numbers, five seeds, two methods; two numbers and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, PRESETS, tuple(METHODS), levels, SEEDS, wanted, executor, tell, "people")
    axis = Axis("people", "people", scale="log")
    return curve_page("people", _HEAD.format(seeds=swept.seeds, noise=100 * BOX_NOISE), swept, axis)


_HEAD = """# Number of people

So many people are in the same area for 40 s; three in ten come in later. Identities are given; edges of boxes have noise of
{noise:g} % of the box height; {seeds} seeds. The scale comes from the mean of those who are there, who differ from the
assumed 1.72 m with a standard deviation of 9 cm each: few people leave a metric error that no method can avoid."""


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    return Condition(SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, people=int(level)), METHODS[method])
