"""What the usual design effect is held against: what recordings show of theirs, by how much of it the fit leaves to be seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.arrays import Floats
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.write import MEAN_SD
from passerby.solver import uncertainty
from passerby.solver.uncertainty import USUAL_COUNTS, USUAL_EFFECT
from reliability.coverage import in_sigmas
from reliability.overheard import overheard

FIRST_SEED = 951_000
PRESETS = ("terrace", "basketball", "construction")
AMOUNTS = ((1, 8.0), (1, 12.0), (2, 12.0), (1, 30.0), (3, 20.0), (5, 40.0), (8, 60.0))
"""People and seconds."""
BOX_NOISE = 0.02
CAMERAS = (3, 4, 5, 6)
"""By turns."""
LEFT = ((0, 0), (1, 20), (21, 60), (61, 200), (201, 100_000))
"""Ranges of `sums_left`."""
SHAPE = ("shape position", "shape orientation")
TRIED = (1.0, 1.4, 1.8, 2.2, 2.6, 3.0)


def cases(seeds: int) -> dict[str, tuple[str, int, float, int]]:
    """Scenes by key: preset, people, seconds and seed; four times as many seeds as of other parts, for they are short."""
    wanted = [
        (preset, people, seconds, FIRST_SEED + k) for preset in PRESETS for people, seconds in AMOUNTS for k in range(4 * seeds)
    ]
    return {" ".join(map(str, one)): one for one in wanted}


def measure(case: tuple[str, int, float, int]) -> dict[str, Any]:
    """The design effect that is seen, for how many sums it counts, and the errors in sigmas; nothing where no rig comes out."""
    preset, people, seconds, seed = case
    options = SimulationOptions(
        preset=preset, people=people, seconds=seconds, seed=seed, box_noise=BOX_NOISE, cameras=CAMERAS[seed % len(CAMERAS)]
    )
    scene = simulate(options)
    height_m = options.person_height_mean_m
    with overheard(uncertainty, "sums_left") as left, overheard(uncertainty, "_design_effect") as effects:
        found = calibrate_observations(
            scene.rig, {name: camera.boxes for name, camera in scene.observations.cameras.items()}, fps=options.fps,
            association={"mode": "given"},
            scale={
                "person_height_m": height_m, "person_height_sd_m": options.person_height_sd_m,
                "person_height_mean_sd_m": MEAN_SD * height_m,
            },
        )  # fmt: skip
    if len(found.rig.posed()) < 2 or not left:
        return {}
    sigmas = in_sigmas(found, scene, clocked=False)
    return {"left": left[-1], "effect": max(1.0, *effects[-2:]), "sigmas": {kind: sigmas[kind] for kind in SHAPE}}


def tabulate(outcomes: Outcomes, _: Mapping[str, Any]) -> Found:
    """What is seen, and errors in sigmas, by what the fit leaves; other usual effects; `outcomes` of `measure`, by key."""
    results = [one for one in outcomes.values() if one]
    rows, curve = [], []
    for first, last in LEFT:
        some = [one for one in results if first <= one["left"] <= last]
        seen = np.array([one["effect"] for one in some])
        quantiles = [f"{np.quantile(seen, q):.2f}" for q in (0.1, 0.5, 0.9)] if len(seen) else ["-"] * 3
        name = str(first) if first == last else f"{first} or more" if last == LEFT[-1][1] else f"{first} to {last}"
        rows.append([name, str(len(some)), *quantiles, *(_within(some, kind, USUAL_EFFECT) for kind in SHAPE)])
    for effect in TRIED:
        shares = [
            _within([one for one in results if first <= one["left"] <= last], kind, effect)
            for first, last in LEFT[:3]
            for kind in SHAPE
        ]
        curve.append([f"**{effect:g}**" if effect == USUAL_EFFECT else f"{effect:g}", *shares])
    seen_rows = table(("sums left", "scenes", "10 %", "median", "90 %", *SHAPE), rows)
    trade = table(("usual effect", *(f"{kind}, {row[0]} left" for row in rows[:3] for kind in SHAPE)), curve)
    run = f"{len(results)} scenes; USUAL_EFFECT = {USUAL_EFFECT:g}, USUAL_COUNTS = {USUAL_COUNTS:g}"
    return Found({"Effects seen": seen_rows, "USUAL_EFFECT": trade}, run=run)


def _within(results: Sequence[Mapping[str, Any]], kind: str, effect: float) -> str:
    """Percentages of errors within one sigma and two, had the usual effect been another one."""
    errors = [_errors(one, kind, effect) for one in results]
    known = np.concatenate(errors) if errors else np.zeros(0)
    return f"{100 * np.mean(known < 1):.0f}, {100 * np.mean(known < 2):.0f} of {len(known)}" if len(known) else "-"


def _errors(result: Mapping[str, Any], kind: str, effect: float) -> Floats:
    left, seen = result["left"], result["effect"]
    used, other = (left * seen + USUAL_COUNTS * usual for usual in (USUAL_EFFECT, effect))
    return np.asarray(np.asarray(result["sigmas"][kind]) * np.sqrt(used / other))
