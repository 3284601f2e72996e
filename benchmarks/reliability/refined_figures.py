"""What `BOXES_MISLEAD` is held against: how far boxes alone put right focal lengths, in sigmas that do not know of it."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from datasets import models_folder
from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.calibration.calibrate import calibrate
from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.scene.scene import Scene
from passerby.simulation import PRESETS, SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from passerby.solver import initialisation
from passerby.solver.lens_sigmas import BOXES_MISLEAD, LensEvidence
from reliability.judging import calibrated
from reliability.overheard import overheard
from reliability.staging import staged
from reliability.stature_figures import DETECTORS, detectors_at_hand

FIRST_SEED = 948_000
NOISES: Mapping[str, float] = {f"{100 * noise:g} % noise": noise for noise in (0.01, 0.02, 0.04)}
"""Of the edges of boxes, as shares of their height."""
POINTS = "principal points, 2 % noise"
FILMS: Mapping[str, str] = {f"rendered films, by the {name}": name for name in DETECTORS}
REFINED: Mapping[str, Any] = {"refine": ["focal"]}
REFINED_POINTS: Mapping[str, Any] = {"refine": ["principal_point"]}


def cases(seeds: int) -> dict[str, tuple[str, str, int]]:
    """Scenes by key: kind of boxes, preset and seed; two for each seed, of films one for every two."""
    films = [kind for kind, detector in FILMS.items() if detector in detectors_at_hand()]
    wanted = [(kind, preset, FIRST_SEED + k) for kind in (*NOISES, POINTS) for preset in PRESETS for k in range(2 * seeds)]
    wanted += [(kind, preset, FIRST_SEED + k) for kind in films for preset in PRESETS for k in range(max(1, seeds // 2))]
    return {" ".join(map(str, one)): one for one in wanted}


def measure(case: tuple[str, str, int]) -> dict[str, Any]:
    """How far off the sightings alone would put each camera's focal length or principal point, and its sigma but for what
    misleads: logarithms, or shares of the image's width. At the end of the refinement, whether it is kept or not.
    """
    kind, preset, seed = case
    with overheard(initialisation, "lens_evidence") as returned:
        if kind in FILMS:
            rig = _film(FILMS[kind], preset, seed)
        else:
            scene = staged(seed, preset=preset, people=8, box_noise=NOISES.get(kind, 0.02))
            rig = calibrated(scene.with_tables(solver=REFINED_POINTS if kind == POINTS else REFINED)).rig
    if not returned:
        return {"off": [], "sd": []}
    last: LensEvidence = returned[-1]
    unit = rig[rig.names[0]].lens.size[0] if kind == POINTS else 1
    return {"off": (last.seen / unit).ravel().tolist(), "sd": (last.sd / BOXES_MISLEAD / unit).ravel().tolist()}


def _film(detector: str, preset: str, seed: int) -> Rig:
    """Calibrate a rendered film, its focal lengths refined."""
    scene = simulate(SimulationOptions(preset=preset, seed=seed, cameras=3, people=5, seconds=25.0))
    with tempfile.TemporaryDirectory() as scratch:
        path = write_scene(scene, Path(scratch) / "scene", video=RenderOptions())
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        content["perception"] = DETECTORS[detector] | ({"models": str(models_folder())} if detector == "network" else {})
        content["solver"] = dict(REFINED)
        path.write_text(tomli_w.dumps(content), encoding="utf-8")
        return calibrate(Scene.load(path)).rig


def tabulate(outcomes: Outcomes, wanted: Mapping[str, tuple[str, str, int]]) -> Found:
    """A table by boxes and preset, and the constant; `outcomes` of `measure`, by key."""
    rows, every = [], [np.zeros(0)]
    for kind in (*NOISES, POINTS, *FILMS):
        for preset in PRESETS:
            some = [one for key, one in outcomes.items() if wanted[key][:2] == (kind, preset)]
            off, sd = (_column(some, what) for what in ("off", "sd"))
            if not len(off):
                continue
            every.append(off / sd)
            within = [f"{100 * np.mean(np.abs(off / sd) < k * BOXES_MISLEAD):.0f} %" for k in (1, 2)]
            rows.append([kind, preset, str(len(off)), f"{100 * _rms(off):.1f}", f"{_rms(off / sd):.1f}", *within])
    head = ("boxes", "preset", "values", "off by, root mean square %", "over sigmas", "within 1", "within 2")
    note = f"Over all rows the root mean square of the errors over their sigmas is {_rms(np.concatenate(every)):.1f}."
    return Found({"BOXES_MISLEAD": table(head, rows)}, [note], f"BOXES_MISLEAD = {BOXES_MISLEAD:g}")


def _column(some: Sequence[Mapping[str, Any]], what: str) -> Floats:
    return np.concatenate([np.zeros(0), *(np.array(one[what]) for one in some)])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
