"""How many correspondences are needed: errors against the person-instants that each camera shares with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any

from pages.records import Found
from pages.tables import Table, table, yes
from paper.conditions import Condition, Outcome
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.spread import failures, median_errors, of, quartiles, worst_errors
from paper.sweep import Swept, curve_found, presets_of, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.geometry.two_view import MIN_POINTS
from passerby.simulation import SimulationOptions

LEVELS, QUICK_LEVELS = (5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 200.0, 500.0), (10.0, 30.0, 200.0)
SEEDS = 5
AXIS = Axis("shared person-instants", "shared", scale="log")
METHODS: dict[str, dict[str, Any]] = {
    "geopose": {"method": "geopose", "solver": (("min_correspondences", MIN_POINTS),)},
    "people": {"method": "people"},
    "people, joints": {"method": "people", "points": "joints"},
}
JOINT_NOISE_PX = 2.0
CLAIMS = {
    "geopose": (30.0, "the paper: 30 suffice"),
    "people": (10.0, "10 are enough"),
    "people, joints": (10.0, "10 are enough"),
}
ENOUGH_MM, ENOUGH_DEG = 400.0, 1.1
"""The paper's own mean over its three scenes, of all its correspondences, is 404 mm and 1.08 degrees."""


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """Three scenes, eight numbers, five seeds, three methods; one scene, three numbers and two seeds in a quick run."""
    levels = QUICK_LEVELS if wanted.quick else LEVELS
    swept = sweep(_condition, presets_of(wanted), tuple(METHODS), levels, SEEDS, wanted, executor, tell, "correspondences")
    return curve_found("correspondences", swept, AXIS, {"Claims": _claims(swept)})


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, joint_noise_px=JOINT_NOISE_PX)
    return Condition(options, shared=int(level), **METHODS[method])


def _claims(swept: Swept) -> Table:
    rows = []
    for preset in swept.presets:
        for method in swept.methods:
            level, claim = CLAIMS[method]
            outcomes = swept.outcomes[preset, method, level]
            cells = [cell for placement in ("similarity", "metric") for cell in _claim_cells(outcomes, placement)]
            rows.append([preset, method, claim, *cells, failures(outcomes)])
    return table(("scene", "method", "claim", "similarity, median", "worst seed", "enough", "metric, median", "worst seed",
                  "enough", "failed"), rows)  # fmt: skip


def _claim_cells(outcomes: Sequence[Outcome], placement: str) -> list[str]:
    """Median and worst errors, and whether they are small enough."""
    mm, degrees = (of(outcomes, f"{placement}_{unit}") for unit in ("mm", "deg"))
    enough = sum(a <= ENOUGH_MM and b <= ENOUGH_DEG for a, b in zip(mm, degrees, strict=True))
    middle = quartiles(mm)[1] <= ENOUGH_MM and quartiles(degrees)[1] <= ENOUGH_DEG
    verdict = f"{yes(middle)} ({enough} of {len(outcomes)})"
    return [median_errors(outcomes, placement), worst_errors(outcomes, placement), verdict]
