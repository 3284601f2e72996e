"""What `HARMFUL_SHARE` and `LEAST_ODDS` are held against: people predicted by right rigs, and by wrong ones.

Ordinary scenes, scenes in which three of ten boxes are missing and people hide each other, rendered films, and hostile cases in
which a camera films other people, sees them at another time, or takes people for each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import Table, table
from passerby.calibration import group_figures as pipeline
from passerby.calibration.calibration import Calibration
from passerby.calibration.prediction import HARMFUL_SHARE, LEAST_ODDS, worst_part
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.simulation import SimulationOptions, simulate
from reliability.hostile import HOSTILE, LATER
from reliability.judging import calibrated, errors_of
from reliability.ordinary import ordinary_scene
from reliability.other_inputs import CALIBRATED, VIDEOS, drawn
from reliability.overheard import overheard
from reliability.staging import HandedIn

FIRST_SEED = 880_000
ORDINARY, MISSED, FILM = "ordinary", "missed", "film"
PRESETS = ("terrace", "basketball", "construction")
CASES = (
    "elsewhere-given", "flipped", "upside-down", "focal-20-all", "court-confused", "in-step-shifted", "names-by-camera",
    "numbers-mistaken", "four-seconds-late", "drift-4", "frames-lost", "burst-lost", "later-rehearsal", "later-half-last-week",
    "later-sides-changed",
)  # fmt: skip
TRIED = (0.5, 0.6, 0.65, HARMFUL_SHARE, 0.75, 0.8)
ODDS = (0.1, 1.0, LEAST_ODDS, 20.0, 1000.0)


def cases(seeds: int) -> dict[str, tuple[str, int]]:
    """Scenes by key: five ordinary ones a seed, one of each other kind."""
    wanted = [(ORDINARY, FIRST_SEED + k) for k in range(5 * seeds)]
    wanted += [(kind, FIRST_SEED + 100 + k) for kind in (MISSED, FILM) for k in range(seeds)]
    wanted += [(name, FIRST_SEED + 1000 + k) for name in CASES for k in range(max(1, seeds // 2))]
    return {f"{name} {seed}": (name, seed) for name, seed in wanted}


def measure(case: tuple[str, int]) -> dict[str, Any]:
    """The largest log odds of a camera and of the rig, by the share that counts as harmful; nothing of a refused scene."""
    with overheard(pipeline, "predict_people") as predicted:
        found, truths = _calibrated(*case)
    errors = [one for truth in truths if (one := errors_of(found.rig, truth)) is not None]
    if not errors or not predicted or not len(predicted[-1]):
        return {}
    outcomes = predicted[-1]
    cameras = np.unique(np.append(outcomes.by, outcomes.within)).tolist()
    largest, noise = [], adjusted(found.figures).noise
    for share in TRIED:
        every = [worst_part(outcomes, camera, len(cameras), share, noise) for camera in (None, *cameras)]
        largest.append(max(one.log_odds for one in every if one is not None))
    return {"wrong": any(one.wrong for one in errors), "log_odds": largest}


def _calibrated(name: str, seed: int) -> tuple[Calibration, list[Rig]]:
    """A scene calibrated, and what is true of it."""
    if name == FILM:
        filmed = simulate(drawn(VIDEOS, seed))
        return CALIBRATED[VIDEOS](filmed, seed)[0], [filmed.rig]
    if name == MISSED:
        options = SimulationOptions(
            preset=PRESETS[seed % len(PRESETS)], seed=seed, people=10, seconds=40.0, box_noise=0.02, missing=0.3,
            false_boxes=0.05, unrelated_ids=True, tracklet_seconds=10.0,
        )  # fmt: skip
        scene = simulate(options)
        boxes = {camera: scene.observations[camera].boxes for camera in scene.rig.names}
        handed = HandedIn(scene.rig, boxes, scene.rig, options.fps, {"association": {"mode": "combined"}})
    else:
        handed = ordinary_scene(seed) if name == ORDINARY else {**HOSTILE, **LATER}[name][1](seed)
    return calibrated(handed), [handed.truth, *([] if handed.later is None else [handed.later])]


def tabulate(outcomes: Outcomes, wanted: Mapping[str, tuple[str, int]]) -> Found:
    """How many rigs each limit speaks against; `outcomes` of `measure`, by key."""
    some = {key: one for key, one in outcomes.items() if one}
    sound = {
        f"{kind}, right": [one for key, one in some.items() if wanted[key][0] == name and not one["wrong"]]
        for name, kind in ((ORDINARY, "ordinary scenes"), (MISSED, "boxes missed"), (FILM, "rendered films"))
    }
    hostile = [one for key, one in some.items() if wanted[key][0] in CASES]
    kinds = {**sound, "hostile cases, right": [one for one in hostile if not one["wrong"]]}
    kinds["hostile cases, wrong"] = [one for one in hostile if one["wrong"]]
    shares = [(f"{share:g}", k, LEAST_ODDS) for k, share in enumerate(TRIED)]
    odds = [(f"{one:g}", TRIED.index(HARMFUL_SHARE), one) for one in ODDS]
    logs = [[kind, str(len(each)), *_quantiles(each)] for kind, each in kinds.items()]
    tables = {
        "HARMFUL_SHARE": _counts(kinds, shares, f"{HARMFUL_SHARE:g}"),
        "LEAST_ODDS": _counts(kinds, odds, f"{LEAST_ODDS:g}"),
        "Log odds": table(("", "rigs", "smallest", "median", "largest"), logs),
    }
    return Found(tables, run=f"HARMFUL_SHARE = {HARMFUL_SHARE:g}, LEAST_ODDS = {LEAST_ODDS:g}")


def _counts(kinds: Mapping[str, list[Any]], limits: list[tuple[str, int, float]], in_force: str) -> Table:
    rows = []
    for name, k, odds in limits:
        beyond = [f"{sum(one['log_odds'][k] > np.log(odds) for one in some)} of {len(some)}" for some in kinds.values()]
        rows.append([f"**{name}**" if name == in_force else name, *beyond])
    return table(("limit", *kinds), rows)


def _quantiles(some: list[Any]) -> list[str]:
    values = [one["log_odds"][TRIED.index(HARMFUL_SHARE)] for one in some]
    return [f"{np.quantile(values, q):.1f}" for q in (0.0, 0.5, 1.0)] if values else ["-"] * 3
