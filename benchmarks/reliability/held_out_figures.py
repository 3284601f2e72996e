"""What `HARMFUL_RATIO` is held against: people who are held out of ordinary scenes, and cameras that were bumped for a while.

Short scenes with few people are among them; a limit lies above what the ordinary ones reach.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.page import table
from passerby.calibration.calibration import Calibration
from passerby.calibration.held_out import HARMFUL_RATIO, held_out_ratio, hold_out, is_held_out
from passerby.calibration.pipeline import calibrate
from passerby.common.arrays import Floats
from passerby.core.observations import CameraObservations, Observations
from passerby.scene.scene import Scene
from passerby.simulation import SimulationOptions, simulate, write_scene

FIRST_SEED = 940
PRESETS = ("terrace", "basketball", "construction")
AMOUNTS = ((2, 15.0), (3, 30.0), (6, 30.0), (8, 60.0), (4, 90.0))
"""People and seconds."""
BOX_NOISE = 0.02
SHIFTS = (0.0, 0.1, 0.2, 0.4)
"""Of one camera's boxes in the stretches that are held out, as shares of their height: what no other stretch shows."""
TRIED = (1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.75, 2.0)


def cases(seeds: int) -> dict[str, tuple[str, int, float, int]]:
    """Scenes by key: preset, people, seconds and seed."""
    wanted = [
        (preset, people, seconds, FIRST_SEED + k) for preset in PRESETS for people, seconds in AMOUNTS for k in range(seeds)
    ]
    return {" ".join(map(str, one)): one for one in wanted}


def measure(case: tuple[str, int, float, int]) -> dict[str, Any]:
    """How much worse held-out people fit, by the shift of one camera's boxes among them; None where none is told."""
    preset, people, seconds, seed = case
    options = SimulationOptions(preset=preset, people=people, seconds=seconds, seed=seed, box_noise=BOX_NOISE)
    with tempfile.TemporaryDirectory() as scratch:
        write_scene(simulate(options), Path(scratch) / "scene")
        found = calibrate(Scene.load(Path(scratch) / "scene" / "scene.toml"))
    return {"ratios": [_ratio(found, shift) for shift in SHIFTS]}


def _ratio(found: Calibration, shift: float) -> float | None:
    """How much worse held-out people fit where one camera's boxes are shifted in the stretches that are held out."""
    height_m = found.scene.scale.person_height_m
    figures = hold_out(found.rig, found.instants, height_m, 0)
    if figures is None:
        return None
    if shift:
        figures = hold_out(found.rig, _shifted(found, figures.stretch_s, shift), height_m, 0)
    return None if figures is None else held_out_ratio(figures) or None


def _shifted(found: Calibration, stretch_s: float, shift: float) -> Observations:
    """The first camera's boxes moved sideways in every fifth stretch."""
    instants, name = found.instants, found.rig.names[0]
    seen = instants[name]
    ltwh = seen.boxes.ltwh.copy()
    rows = is_held_out(seen.boxes.frame, found.rig, instants, stretch_s)
    ltwh[rows, 0] += shift * ltwh[rows, 3]
    moved = CameraObservations(replace(seen.boxes, ltwh=ltwh), seen.keypoints)
    return replace(instants, cameras={**instants.cameras, name: moved})


def section(outcomes: Outcomes, wanted: Mapping[str, tuple[str, int, float, int]]) -> str:
    """Ratios by shift and length, and the share of scenes beyond other limits; `outcomes` of `measure`, by key."""
    rows = []
    for index, shift in enumerate(SHIFTS):
        for amount in AMOUNTS:
            known = _known({key: one for key, one in outcomes.items() if wanted[key][1:3] == amount}, index)
            quantiles = [f"{np.quantile(known, q):.2f}" for q in (0.1, 0.5, 0.9, 1.0)] if len(known) else ["-"] * 4
            beyond = f"{np.count_nonzero(known > HARMFUL_RATIO)} of {len(known)}"
            rows.append([f"{100 * shift:.0f} %", f"{amount[0]}, {amount[1]:g} s", str(len(known)), *quantiles, beyond])
    curve = []
    for limit in TRIED:
        shares = [_known(outcomes, index) > limit for index in range(len(SHIFTS))]
        name = f"**{limit:g}**" if limit == HARMFUL_RATIO else f"{limit:g}"
        curve.append([name, *(f"{100 * np.mean(share):.0f} %" if len(share) else "-" for share in shares)])
    quantities = table(("shift", "people", "scenes", "10 %", "median", "90 %", "largest", f"above {HARMFUL_RATIO:g}"), rows)
    trade = table(("limit", *(f"shift {100 * shift:.0f} %" for shift in SHIFTS)), curve)
    return f"""### HARMFUL_RATIO in `calibration/held_out.py`: {HARMFUL_RATIO:g}

No rig is accepted whose held-out people disagree with it by so many times as much as those who were fitted, in each of two
stretches or more (median residual, as a share of the size in the image). Recordings of less than 80 s have one stretch, which
is only noted; its ratios are here as well. Presets {", ".join(PRESETS)}; boxes with {100 * BOX_NOISE:g} % noise, identities
known, {len(outcomes)} scenes, seeds from {FIRST_SEED}. *shift*: one camera's boxes are moved sideways by that share of their
height in the stretches that are held out, as if the camera had been bumped there. Largest of ordinary scenes:
{max(_known(outcomes, 0), default=float("nan")):.2f}.

{quantities}

Share of the scenes beyond a limit:

{trade}
"""


def _known(outcomes: Outcomes, index: int) -> Floats:
    """The ratios of one shift that are known."""
    return np.array([one["ratios"][index] for one in outcomes.values() if one["ratios"][index] is not None])
