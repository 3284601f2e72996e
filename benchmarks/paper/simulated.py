"""The simulated scenes without faults: the person model against its goals, GeoPose against the paper's figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from pages.records import Found
from pages.tables import Table, number, reached, table, yes
from paper.conditions import Condition, Method, Outcome
from paper.goals import BOX_NOISE, GRAVITY_GOAL_DEG, GROUND_GOAL_MM, PRESETS, SCALE_GOAL
from paper.paper_figures import POSES, POSES_MEAN
from paper.parts import Wanted
from paper.plots import failures, of, percent, pose_errors, verdicts, worst_errors
from paper.sweep import sweep
from passerby.common.progress import Progress
from passerby.simulation import SimulationOptions

SEEDS = 10
METHODS: Mapping[str, Method] = {"people": "people", "geopose": "geopose"}

Results = Mapping[str, Sequence[Outcome]]


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """Three scenes, ten seeds, two methods; two seeds in a quick run."""
    swept = sweep(_condition, tuple(PRESETS), tuple(METHODS), (BOX_NOISE,), SEEDS, wanted, executor, tell, "simulated")
    people, geopose = ({p: swept.outcomes[p, method, BOX_NOISE] for p in swept.presets} for method in METHODS)
    return Found(
        {"Errors": _people(people), "World": _world(people), "GeoPose": _geopose(geopose, people)}, run=f"{swept.seeds} seeds"
    )


def _condition(preset: str, method: str, level: float, seed: int) -> Condition:
    return Condition(SimulationOptions(preset=preset, seed=seed, box_noise=level), METHODS[method])


def _mean(outcomes: Sequence[Outcome], figure: str) -> float:
    return float(np.mean(of(outcomes, figure)))


def _mean_errors(outcomes: Sequence[Outcome], placement: str) -> tuple[float, float]:
    return _mean(outcomes, f"{placement}_mm"), _mean(outcomes, f"{placement}_deg")


def _people(results: Results) -> Table:
    rows = []
    for preset, outcomes in results.items():
        goal = PRESETS[preset]
        means = (*_mean_errors(outcomes, "similarity"), _mean(outcomes, "scale_error"))
        limits = [(*bounds, share) for bounds, share in zip((goal.acceptable, goal.aim), SCALE_GOAL, strict=True)]
        rows.append(
            [preset, pose_errors(*means[:2]), worst_errors(outcomes, "similarity"), pose_errors(*goal.acceptable),
             percent(means[2], 2), percent(max(of(outcomes, "scale_error")), 2), reached(means, *limits), failures(outcomes)]
        )  # fmt: skip
    return table(("scene", "similarity", "worst seed", "acceptable", "scale error", "worst", "reached", "failed"), rows)


def _world(results: Results) -> Table:
    rows = []
    for preset, outcomes in results.items():
        gravity, ground = of(outcomes, "gravity_deg"), of(outcomes, "ground_mm")
        rows.append(
            [preset, f"{number(float(np.mean(gravity)), 3)}°", f"{number(max(gravity), 3)}°",
             f"{number(float(np.mean(ground)))} mm", f"{number(max(ground))} mm",
             yes(max(gravity) <= GRAVITY_GOAL_DEG and max(ground) <= GROUND_GOAL_MM),
             pose_errors(*_mean_errors(outcomes, "metric")), verdicts(outcomes)]
        )  # fmt: skip
    within = f"all within {GRAVITY_GOAL_DEG:g}°, {GROUND_GOAL_MM:g} mm"
    return table(("scene", "vertical", "worst", "ground", "worst", within, "metric", "verdicts"), rows)


def _geopose(results: Results, people: Results) -> Table:
    rows, means = [], []
    paper = POSES["boxes-re-id"]
    for preset, outcomes in results.items():
        metric = _mean_errors(outcomes, "metric")
        means.append(metric)
        pairs = list(zip(of(people[preset], "similarity_mm"), of(outcomes, "similarity_mm"), strict=True))
        no_worse = sum(ours <= theirs and math.isfinite(ours) for ours, theirs in pairs)
        rows.append(
            [preset, failures(outcomes), pose_errors(*metric), pose_errors(*paper[preset]), _below(metric, paper[preset]),
             pose_errors(*_mean_errors(outcomes, "similarity")), percent(_mean(outcomes, "scale_error"), 2),
             f"{no_worse} of {len(pairs)}"]
        )  # fmt: skip
    total = float(np.mean([mm for mm, _ in means])), float(np.mean([degrees for _, degrees in means]))
    rows.append(["mean", "", pose_errors(*total), pose_errors(*POSES_MEAN), _below(total, POSES_MEAN), "", "", ""])
    head = ("scene", "failed", "metric", "paper", "reached", "similarity", "scale error", "people no worse")
    return table(head, rows)


def _below(values: tuple[float, float], limits: tuple[float, float]) -> str:
    return yes(all(value <= limit for value, limit in zip(values, limits, strict=True)))
