"""Errors against one condition: number of cameras or people, seconds, missing boxes, or swapped identities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from pages.records import Found
from pages.tables import Table, number, table, yes
from paper.conditions import Condition, Method
from paper.goals import BOX_NOISE
from paper.plots import Axis
from paper.spread import median, percent
from paper.sweep import Swept, curve_found, presets_of, sweep
from paper.wanted import Wanted
from passerby.common.progress import Progress
from passerby.scene.tables import SEARCHED_S
from passerby.simulation import SimulationOptions

SEEDS = 5
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}
BORNE, LARGEST_RATIO = 0.3, 1.3
"""With 30 % of the identities wrong the errors of the default method may be this many times those without."""
MISSING, TRACKLET_S = 0.1, 4.0


@dataclass(frozen=True)
class Curve:
    """One condition at several levels."""

    levels: tuple[float, ...]
    quick_levels: tuple[float, ...]
    options: Callable[[float], dict[str, Any]]
    """Options of the simulation at a level, besides preset, seed and noise."""
    axis: Axis
    presets: int = 1
    """The first so many of all presets."""
    methods: tuple[str, ...] = tuple(METHODS)
    tables: Callable[[Swept], dict[str, Table]] = lambda _: {}
    """Further ones."""


def _compare_swapped(swept: Swept) -> dict[str, Table]:
    """The goal of the default method: its errors with swapped identities over those without."""
    rows = []
    for preset in swept.presets:
        clean, swapped = (swept.outcomes[preset, "people", level] for level in (0.0, BORNE))
        figures = [median(swapped, figure) / median(clean, figure) for figure in ("similarity_mm", "similarity_deg")]
        rows.append([preset, *(number(ratio, 2) for ratio in figures), yes(max(figures) <= LARGEST_RATIO)])
    return {"Ratios": table(("scene", "ratio, mm", "ratio, degrees", f"at most {LARGEST_RATIO}"), rows)}


CURVES: Mapping[str, Curve] = MappingProxyType({
    "swaps": Curve(
        (0.0, 0.1, 0.2, 0.3, 0.5), (0.0, 0.3), lambda share: {"identity_swaps": share},
        Axis("swapped identities", "swapped", partial(percent, digits=0)), 3, tables=_compare_swapped,
    ),
    "missing": Curve(
        (0.0, 0.2, 0.5, 0.8), (0.0, 0.8), lambda share: {"missing": share},
        Axis("missing boxes", "missing", partial(percent, digits=0)), 2,
    ),
    "cameras": Curve(
        (2.0, 3.0, 4.0, 6.0, 8.0), (2.0, 6.0), lambda count: {"cameras": int(count)}, Axis("cameras", "cameras", scale="log")
    ),
    "people": Curve(
        (1.0, 2.0, 4.0, 7.0, 12.0, 20.0), (1.0, 7.0), lambda count: {"people": int(count)},
        Axis("people", "people", scale="log"),
    ),
    "seconds": Curve(
        (10.0, 20.0, 40.0, 80.0), (10.0,), lambda seconds: {"seconds": seconds, "missing": MISSING,
        "tracklet_seconds": TRACKLET_S, "unrelated_ids": True}, Axis("seconds", "seconds", scale="log"), methods=("combined",),
    ),
})  # fmt: skip
"""By page. In `seconds` neither identities nor clocks are known."""


def run(name: str, wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """One curve with five seeds; two levels of one scene and two seeds in a quick run."""
    curve = CURVES[name]
    levels = curve.quick_levels if wanted.quick else curve.levels
    make, presets = partial(_condition, name), presets_of(wanted)[: curve.presets]
    swept = sweep(make, presets, curve.methods, levels, SEEDS, wanted, executor, tell, name)
    return curve_found(name, swept, curve.axis, curve.tables(swept))


def _condition(name: str, preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, **CURVES[name].options(level))
    return Condition(options, METHODS[method]) if method in METHODS else Condition(options, search_s=SEARCHED_S)
