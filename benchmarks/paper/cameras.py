"""The number of cameras."""

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

LEVELS, QUICK_LEVELS = (2.0, 3.0, 4.0, 6.0, 8.0), (2.0, 6.0)
SEEDS = 5
PRESETS = ("terrace",)
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """One scene, five numbers, five seeds, two methods; two numbers and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, PRESETS, tuple(METHODS), levels, SEEDS, wanted, executor, tell, "cameras")
    axis = Axis("cameras", "cameras", scale="log")
    return curve_page("cameras", _HEAD.format(seeds=swept.seeds, noise=100 * BOX_NOISE), swept, axis)


_HEAD = """# Number of cameras

So many cameras stand around the same people. Identities are given; edges of boxes have noise of {noise:g} % of the box height;
{seeds} seeds. Of two cameras the similarity error tells of directions alone: two centres always fit."""


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    return Condition(SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, cameras=int(level)), METHODS[method])
