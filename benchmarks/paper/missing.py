"""Missing boxes: a detector that overlooks people at random."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from functools import partial

from pages.page import Page
from paper.conditions import Condition, Method
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.spread import percent
from paper.sweep import curve_page, presets_of, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (0.0, 0.2, 0.5, 0.8), (0.0, 0.8)
SEEDS = 5
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """Two scenes, four levels, five seeds, two methods; one scene, two levels and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, presets_of(wanted)[:2], tuple(METHODS), levels, SEEDS, wanted, executor, tell, "missing")
    axis = Axis("missing boxes", "missing", partial(percent, digits=0))
    return curve_page("missing", _HEAD.format(seeds=swept.seeds, noise=100 * BOX_NOISE), swept, axis)


_HEAD = """# Missing boxes

A random share of the boxes is dropped, in each camera on its own: of a share m that is missing, two cameras still share
(1 - m)² of what they did. Identities are given; edges of boxes have noise of {noise:g} % of the box height; {seeds} seeds."""


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    return Condition(SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, missing=level), METHODS[method])
