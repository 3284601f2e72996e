"""How well is the mean stature of the people of a recording known, and what their boxes show of it, if nobody states it?

Groups of people are drawn by published statures: a group is of one country, has some share of women, is of some age, and wears
shoes. What boxes add to bodies is measured on rendered films whose people's mean stature is stated: their scale is then off by
what the detector makes of bodies. Both are common to all people of a recording, so that more people do not average them out.
"""

from __future__ import annotations

import math
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from datasets import models_folder
from pages.cases import Outcomes
from pages.page import table
from passerby.calibration.pipeline import calibrate
from passerby.common.arrays import Floats
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.evaluation.metrics import compare
from passerby.scene.scene import Scene
from passerby.simulation import PRESETS, SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from passerby.solver.cues import POPULATION_BIAS

FIRST_SEED, GROUPS = 949_000, 100_000
MEN_AND_WOMEN_CM = {
    "Argentina": (174.6, 161.0), "Australia": (179.2, 165.9), "Bangladesh": (163.8, 150.8), "Brazil": (173.6, 160.9),
    "Canada": (178.1, 163.9), "China": (171.8, 159.7), "Colombia": (169.5, 156.9), "Czechia": (180.1, 168.5),
    "Denmark": (181.4, 167.2), "Egypt": (166.7, 157.3), "Ethiopia": (166.2, 155.7), "France": (179.7, 164.9),
    "Germany": (179.9, 165.9), "Guatemala": (163.4, 149.4), "India": (164.9, 152.6), "Indonesia": (163.6, 152.8),
    "Iran": (173.6, 159.7), "Italy": (177.8, 164.6), "Japan": (170.8, 158.3), "Kenya": (169.6, 158.2),
    "Mexico": (169.0, 156.9), "Netherlands": (182.5, 168.7), "Nigeria": (165.9, 156.3), "Pakistan": (166.9, 153.8),
    "Peru": (165.2, 152.9), "Philippines": (163.2, 149.6), "Poland": (177.3, 164.6), "Russia": (176.5, 165.3),
    "South Africa": (166.7, 158.0), "South Korea": (174.9, 162.3), "Spain": (176.6, 163.4), "Sweden": (179.7, 165.7),
    "Thailand": (169.2, 157.9), "Turkey": (174.2, 160.5), "Ukraine": (178.5, 166.3), "United Kingdom": (177.5, 164.4),
    "United States": (177.1, 163.5), "Vietnam": (164.4, 153.6),
}  # fmt: skip
"""Mean heights without shoes of people born in 1996: NCD Risk Factor Collaboration, "A century of trends in adult human
height", eLife 5 (2016), e13410."""
OLDER_CM, SHOES_CM = (0.0, 4.0), (1.0, 4.0)
"""By how much older people are shorter (the same paper: they grew by about a centimetre in ten years), and shoes; uniform."""
DETECTORS = {
    "background": {"detector": "background", "embedder": "stripes", "keypoints": "none"},
    "network": {"detector": "yolox-nano", "embedder": "person-reid-retail-0248", "keypoints": "none"},
}


def drawn_groups(rng: np.random.Generator, count: int) -> Floats:
    """(N,) logarithms of the mean statures of groups, shoes on, over the mean that is assumed."""
    cm = np.array([*MEN_AND_WOMEN_CM.values()])[rng.integers(len(MEN_AND_WOMEN_CM), size=count)]
    women = rng.uniform(0.0, 1.0, count)
    mean = (1 - women) * cm[:, 0] + women * cm[:, 1] - rng.uniform(*OLDER_CM, count) + rng.uniform(*SHOES_CM, count)
    return np.asarray(np.log(mean / (100 * PERSON_HEIGHT_M)))


def cases(seeds: int) -> dict[str, tuple[str, str, int]]:
    """Films by key: the detector, the preset and the seed; without networks where these are not at hand."""
    there = [name for name in DETECTORS if name == "background" or (models_folder() / "yolox_nano.onnx").is_file()]
    films = [(name, preset, FIRST_SEED + k) for name in there for preset in PRESETS for k in range(seeds)]
    return {" ".join(map(str, film)): film for film in films}


def measure(film: tuple[str, str, int]) -> dict[str, Any]:
    """The logarithm of the scale of a rendered film whose people's mean stature is stated; NaN where there is no rig."""
    detector, preset, seed = film
    scene = simulate(SimulationOptions(preset=preset, seed=seed, cameras=3, people=5, seconds=25.0))
    with tempfile.TemporaryDirectory() as scratch:
        path = write_scene(scene, Path(scratch) / "scene", video=RenderOptions())
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        mean = float(np.mean([*scene.heights.values()]))
        content["scale"] = {"person_height_m": mean, "person_height_mean_sd_m": 0.01}
        content["perception"] = DETECTORS[detector] | ({"models": str(models_folder())} if detector == "network" else {})
        path.write_text(tomli_w.dumps(content), encoding="utf-8")
        found = calibrate(Scene.load(path))
    ratio = compare(found.rig, scene.rig).scale_ratio if len(found.rig.posed()) > 1 else None
    return {"detector": detector, "log_scale": math.nan if ratio is None else -math.log(ratio)}


def section(outcomes: Outcomes) -> str:
    """The parts of what is common to all people, together, and the constant that holds it; `outcomes` of `measure`, by key."""
    rng = np.random.default_rng(FIRST_SEED)
    groups = drawn_groups(rng, GROUPS)
    known = [one for one in outcomes.values() if np.isfinite(one["log_scale"])]
    films = {name: np.array([one["log_scale"] for one in known if one["detector"] == name]) for name in DETECTORS}
    boxes = np.concatenate([*films.values()])
    total = groups + (rng.choice(boxes, GROUPS) if len(boxes) else 0.0)
    rows = [_row("mean stature of the group", groups, "drawn")]
    rows += [_row(f"boxes by the {name}, rendered films", own, str(len(own))) for name, own in films.items() if len(own)]
    rows.append(_row("together", total, "drawn"))
    within = [f"{100 * np.mean(np.abs(total) < k * POPULATION_BIAS):.0f} %" for k in (1, 2)]
    return f"""## POPULATION_BIAS in `solver/cues.py`: {POPULATION_BIAS:g}

One sigma of what the statures and boxes of all people have in common, where nobody states how tall they are. Groups: of one of
{len(MEN_AND_WOMEN_CM)} countries, each as likely, any share of women, up to 4 cm shorter for their age, shoes of 1 to 4 cm,
against the {PERSON_HEIGHT_M:g} m that are assumed. Boxes: films of 25 s, three cameras, five people, whose mean stature is
stated; positive where people seem taller than they are, so that distances come out short. Seeds from {FIRST_SEED}. In percent.
The constant is the root mean square of both together, to half a percent: {100 * _rms(total):.1f} %. Within it are
{within[0]} of the draws, within twice as much {within[1]}.

{table(("", "number", "mean", "5 %", "95 %", "root mean square"), rows)}
"""


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _row(what: str, values: Floats, number: str) -> list[str]:
    low, high = np.quantile(values, (0.05, 0.95))
    return [what, number, *(f"{100 * value:+.1f}" for value in (values.mean(), low, high)), f"{100 * _rms(values):.1f}"]
