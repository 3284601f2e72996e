"""Where limits of the verdict come from: `python benchmarks/reliability/limits.py [--seeds N] [-o OUT]` writes limits.md.

Ordinary simulated scenes, short ones with few people among them, and the same with a fault; a limit lies above what the
ordinary ones reach. No real data, and seeds from 940 on that no page of results uses.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType, ModuleType

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from datasets import ROOT
from pages.cases import run_cases
from pages.commit import commit
from pages.kept import Kept
from pages.page import Page, publish, table
from passerby.calibration.calibration import Calibration
from passerby.calibration.held_out import HARMFUL_RATIO, held_out_ratio, hold_out, is_held_out
from passerby.calibration.pipeline import calibrate
from passerby.core.observations import CameraObservations, Observations
from passerby.scene.scene import Scene
from passerby.simulation import SimulationOptions, simulate, write_scene
from reliability import (
    clock_figures,
    joint_figures,
    lens_figures,
    move_figures,
    refined_figures,
    stature_figures,
    unusual_figures,
    verdict_figures,
)

FIRST_SEED, SEEDS = 940, 4
KEPT = ROOT / "build" / "limits"
PRESETS = ("terrace", "basketball", "construction")
AMOUNTS = ((2, 15.0), (3, 30.0), (6, 30.0), (8, 60.0), (4, 90.0))
"""People and seconds."""
BOX_NOISE = 0.02
SHIFTS = (0.0, 0.1, 0.2, 0.4)
"""Of one camera's boxes in the stretches that are held out, as shares of their height: what no other stretch shows."""
SECTIONS: Mapping[str, ModuleType] = MappingProxyType({
    "moves": move_figures,
    "clocks": clock_figures,
    "lenses": lens_figures,
    "refined": refined_figures,
    "statures": stature_figures,
    "unusual": unusual_figures,
    "joints": joint_figures,
    "figures": verdict_figures,
})  # fmt: skip
"""Each has cases by key for so many seeds, measures one, and makes a section of the page of their outcomes."""


@dataclass(frozen=True)
class Trial:
    """One scene: how much worse held-out people fit, by the shift of one camera's boxes among them; NaN where none is told."""

    preset: str
    people: int
    seconds: float
    seed: int
    ratios: tuple[float, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("-o", "--out", type=Path, default=None, help="folder of the page; it is printed where none is given")
    arguments = parser.parse_args()
    publish(_page(arguments.seeds), arguments.out, "python benchmarks/reliability/limits.py")


def _page(seeds: int) -> Iterator[Page]:
    wanted = [
        (preset, people, seconds, seed)
        for preset in PRESETS
        for people, seconds in AMOUNTS
        for seed in range(FIRST_SEED, FIRST_SEED + seeds)
    ]
    with ProcessPoolExecutor(2) as pool:
        trials = list(pool.map(_trial, *zip(*wanted, strict=True)))
    text = _text(trials)
    yield Page("limits", text)
    store = Kept(KEPT, ("reliability",))
    whole = text
    for name, figures in SECTIONS.items():
        wanted = figures.cases(seeds)
        for done in run_cases(store, name, wanted, figures.measure, 2):
            text = f"{whole}\n{figures.section(done, wanted)}"
            yield Page("limits", text)
        whole = text


def _trial(preset: str, people: int, seconds: float, seed: int) -> Trial:
    options = SimulationOptions(preset=preset, people=people, seconds=seconds, seed=seed, box_noise=BOX_NOISE)
    with tempfile.TemporaryDirectory() as scratch:
        write_scene(simulate(options), Path(scratch) / "scene")
        found = calibrate(Scene.load(Path(scratch) / "scene" / "scene.toml"))
    return Trial(preset, people, seconds, seed, tuple(_ratio(found, shift) for shift in SHIFTS))


def _ratio(found: Calibration, shift: float) -> float:
    """How much worse held-out people fit where one camera's boxes are shifted in the stretches that are held out."""
    height_m = found.scene.scale.person_height_m
    figures = hold_out(found.rig, found.instants, height_m, 0)
    if figures is None:
        return float("nan")
    if shift:
        figures = hold_out(found.rig, _shifted(found, figures.stretch_s, shift), height_m, 0)
    return float("nan") if figures is None else held_out_ratio(figures) or float("nan")


def _shifted(found: Calibration, stretch_s: float, shift: float) -> Observations:
    """The first camera's boxes moved sideways in every fifth stretch."""
    instants, name = found.instants, found.rig.names[0]
    seen = instants[name]
    ltwh = seen.boxes.ltwh.copy()
    rows = is_held_out(seen.boxes.frame, found.rig, instants, stretch_s)
    ltwh[rows, 0] += shift * ltwh[rows, 3]
    moved = CameraObservations(replace(seen.boxes, ltwh=ltwh), seen.keypoints)
    return replace(instants, cameras={**instants.cameras, name: moved})


def _text(trials: Sequence[Trial]) -> str:
    rows = []
    for index, shift in enumerate(SHIFTS):
        for people, seconds in AMOUNTS:
            values = np.array([one.ratios[index] for one in trials if (one.people, one.seconds) == (people, seconds)])
            known = values[np.isfinite(values)]
            quantiles = [f"{np.quantile(known, q):.2f}" for q in (0.1, 0.5, 0.9, 1.0)] if len(known) else ["-"] * 4
            beyond = f"{np.count_nonzero(known > HARMFUL_RATIO)} of {len(known)}"
            rows.append([f"{100 * shift:.0f} %", f"{people}, {seconds:g} s", str(len(known)), *quantiles, beyond])
    clean = np.array([one.ratios[0] for one in trials])
    curve = [
        [f"{limit:g}", *(_beyond(trials, index, limit) for index in range(len(SHIFTS)))]
        for limit in (1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.0)
    ]
    quantities = table(("shift", "people", "scenes", "10 %", "median", "90 %", "largest", f"above {HARMFUL_RATIO:g}"), rows)
    trade = table(("limit", *(f"shift {100 * shift:.0f} %" for shift in SHIFTS)), curve)
    return f"""# Limits of the verdict

Each from simulated scenes alone, on seeds that no other page uses. Code of commit {commit()}.

## Held-out evidence

`HARMFUL_RATIO` in `passerby/calibration/held_out.py` is {HARMFUL_RATIO:g}: no rig is accepted whose held-out people disagree
with it by so many times as much as those who were fitted, in each of two stretches or more (median residual, as a share of the
size in the image). Recordings of less than 80 s have one stretch, which is only noted; its ratios are here as well. Presets
{", ".join(PRESETS)}; boxes with {100 * BOX_NOISE:g} % noise, identities known, {len(trials)} scenes, seeds from {FIRST_SEED}.
*shift*: one camera's boxes are moved sideways by that share of their height in the stretches that are held out, as if the
camera had been bumped there. Largest of ordinary scenes: {np.nanmax(clean):.2f}.

{quantities}

Share of the scenes beyond a limit:

{trade}
"""


def _beyond(trials: Sequence[Trial], index: int, limit: float) -> str:
    values = np.array([one.ratios[index] for one in trials])
    known = values[np.isfinite(values)]
    return f"{100 * np.mean(known > limit):.0f} %" if len(known) else "-"


if __name__ == "__main__":
    main()
