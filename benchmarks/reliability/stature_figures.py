"""How well is the mean stature of the people of a recording known, and what their boxes show of it, if nobody states it?

Groups of people are drawn by published statures: a group is of one country, has some share of women, is of some age, and wears
shoes. What boxes add to bodies is measured on rendered films whose people's mean stature is stated: their scale is then off by
what the detector makes of bodies. Both are common to all people of a recording, so that more people do not average them out.
The heights of the boxes themselves are held against the true ones as well, which needs no rig.
"""

from __future__ import annotations

import math
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from datasets import models_folder
from metrics.detections import paired
from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.calibration.calibrate import calibrate
from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.core.observations import Boxes
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.evaluation.metrics import compare
from passerby.scene.scene import Scene
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from passerby.solver.cues import POPULATION_BIAS
from perception_runs import found_boxes

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
LEAST_OVERLAP = 0.5
"""Of a found box and the true one that it stands for, intersection over union."""
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
    films = [
        (name, preset, FIRST_SEED + k) for name in detectors_at_hand() for preset in PRESETS for k in range(max(1, seeds // 2))
    ]
    return {" ".join(map(str, film)): film for film in films}


def detectors_at_hand() -> list[str]:
    """The names of the detectors whose models are there."""
    models = models_folder()
    networks = models is not None and (models / "yolox_nano.onnx").is_file()
    return [name for name in DETECTORS if name == "background" or networks]


def measure(film: tuple[str, str, int]) -> dict[str, Any]:
    """What a detector makes of a rendered film, as logarithms.

    `log_scale`: of the scale where the people's mean stature is stated; NaN where there is no rig. `log_boxes`: the median of
    found over true heights of boxes, `boxes` of them; NaN where there is none. True are boxes of whole bodies in their
    postures, whoever stands before them: what a detector loses behind others is its own.
    """
    detector, preset, seed = film
    options = SimulationOptions(preset=preset, seed=seed, cameras=3, people=5, seconds=25.0)
    scene = simulate(options)
    with tempfile.TemporaryDirectory() as scratch:
        path, out = write_scene(scene, Path(scratch) / "scene", video=RenderOptions()), Path(scratch) / "out"
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        mean = float(np.mean([*scene.heights.values()]))
        content["scale"] = {"person_height_m": mean, "person_height_mean_sd_m": 0.01}
        content["perception"] = DETECTORS[detector] | ({"models": str(models_folder())} if detector == "network" else {})
        path.write_text(tomli_w.dumps(content), encoding="utf-8")
        found = calibrate(Scene.load(path), keep=out)
        boxes = found_boxes(path, out)  # as kept: nobody looks for them twice
    whole = simulate(replace(options, occlusion=False))
    ratios = [height_ratios(camera, boxes[camera.name], whole) for camera in scene.rig]
    heights = np.concatenate([ratio for ratio, _ in ratios])
    ratio = compare(found.rig, scene.rig).scale_ratio if len(found.rig.posed()) > 1 else None
    return {
        "detector": detector, "log_scale": math.nan if ratio is None else -math.log(ratio),
        "log_boxes": float(np.median(heights)) if len(heights) else math.nan, "boxes": len(heights),
    }  # fmt: skip


def height_ratios(camera: Camera, found: Boxes, scene: SimulatedScene) -> tuple[Floats, Floats]:
    """(N,) logarithms of found over true heights of boxes that stand for each other, and of the people's distances, metres.

    Boxes that the picture's border cuts off are left out.
    """
    whole = [boxes.take(boxes.inside(camera.lens.size)) for boxes in (scene.truth[camera.name], found)]
    true, seen = (boxes.take(np.argsort(boxes.frame, kind="stable")) for boxes in whole)
    rows, columns = paired(true, seen, LEAST_OVERLAP)
    assert camera.pose is not None
    place = scene.ground_positions[true.frame[rows] - 1, true.identity[rows] - 1]
    away = np.linalg.norm(place - camera.pose.centre[:2], axis=1)
    return np.log(seen.ltwh[columns, 3] / true.ltwh[rows, 3]), np.log(away)


def tabulate(outcomes: Outcomes, _: Mapping[str, Any]) -> Found:
    """The parts of what is common to all people, together, and the constant that holds it; `outcomes` of `measure`, by key."""
    rng = np.random.default_rng(FIRST_SEED)
    groups = drawn_groups(rng, GROUPS)
    scales, heights = (_by_detector(outcomes, key) for key in ("log_scale", "log_boxes"))
    total, by_heights = (_together(groups, films, rng) for films in (scales, heights))
    rows = [_row("mean stature of the group", groups, "drawn")]
    rows += [_row(f"boxes by the {name}, rendered films", own, str(len(own))) for name, own in scales.items()]
    rows.append(_row("together", total, "drawn"))
    rows += [_row(f"heights of boxes by the {name}", own, str(len(own))) for name, own in heights.items()]
    rows.append(_row("the group and heights of boxes", by_heights, "drawn"))
    within = [f"{100 * np.mean(np.abs(total) < k * POPULATION_BIAS):.0f} %" for k in (1, 2)]
    missing = [] if "network" in scales else ["The models were not at hand: silhouettes alone."]
    note = f"The root mean square of both is {100 * _rms(total):.1f} %; of the groups alone {100 * _rms(groups):.1f} %. "
    note += f"{within[0]} of the draws are within the constant, {within[1]} within twice as much."
    head = ("", "number", "mean", "standard deviation", "5 %", "95 %", "root mean square")
    return Found({"POPULATION_BIAS": table(head, rows)}, [note, *missing], f"POPULATION_BIAS = {POPULATION_BIAS:g}")


def _by_detector(outcomes: Outcomes, key: str) -> dict[str, Floats]:
    """The known values of each detector that has any."""
    known = [(str(one["detector"]), float(one[key])) for one in outcomes.values()]
    films = {name: np.array([value for whose, value in known if whose == name and np.isfinite(value)]) for name in DETECTORS}
    return {name: values for name, values in films.items() if len(values)}


def _together(groups: Floats, films: Mapping[str, Floats], rng: np.random.Generator) -> Floats:
    """Each group filmed, by any of the films."""
    return groups + rng.choice(np.concatenate([*films.values()]), len(groups)) if films else groups


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _row(what: str, values: Floats, number: str) -> list[str]:
    low, high = (float(end) for end in np.quantile(values, (0.05, 0.95)))
    mean, sd = float(np.mean(values)), float(np.std(values))
    signed = [f"{100 * mean:+.1f}", f"{100 * sd:.1f}", f"{100 * low:+.1f}", f"{100 * high:+.1f}"]
    return [what, number, *signed, f"{100 * _rms(values):.1f}"]
