"""The length of the recording."""

from __future__ import annotations

from concurrent.futures import Executor

from pages.page import Page
from paper.conditions import Condition
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.sweep import curve_page, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.scene.tables import SEARCHED_S
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (10.0, 20.0, 40.0, 80.0), (10.0,)
SEEDS = 5
PRESETS = ("terrace",)
MISSING, TRACKLET_S = 0.1, 4.0


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """One scene, four lengths, five seeds; one length and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, PRESETS, ("combined",), levels, SEEDS, wanted, executor, tell, "seconds")
    head = _HEAD.format(seeds=swept.seeds, noise=100 * BOX_NOISE, missing=100 * MISSING, tracklet=TRACKLET_S)
    return curve_page("seconds", head, swept, Axis("seconds", "seconds", scale="log"))


_HEAD = """# Length of the recording

Four cameras see seven people for so many seconds. Neither identities nor clocks are known, the default of a scene file;
tracklets last {tracklet:g} s in the mean. Edges of boxes have noise of {noise:g} % of the box height, {missing:g} % of the
boxes are missing; {seeds} seeds."""


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(
        preset=preset, seed=seed, seconds=level, box_noise=BOX_NOISE, missing=MISSING, tracklet_seconds=TRACKLET_S,
        unrelated_ids=method == "combined",
    )  # fmt: skip
    return Condition(options, search_s=SEARCHED_S)
