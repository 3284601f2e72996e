"""Errors against one condition: number of cameras or people, seconds, missing boxes, or swapped identities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from pages.records import Found
from pages.tables import Table, number, table, yes
from paper.conditions import Condition, Method, Outcome, run_conditions
from paper.goals import BOX_NOISE
from paper.parts import Wanted
from paper.plots import FAILS, Axis, failures, median, median_errors, of, percent, quartiles, worst_errors
from paper.sweep import Swept, curve_found, presets_of, seeds_of, sweep
from passerby.common.progress import Progress
from passerby.geometry.two_view import MIN_POINTS
from passerby.scene.tables import SEARCHED_S
from passerby.simulation import SimulationOptions

SEEDS = 5
METHODS: Mapping[str, Method] = {"geopose": "geopose", "people": "people"}
BORNE, LARGEST_RATIO = 0.3, 1.3
"""With 30 % of the identities wrong the errors of the default method may be this many times those without."""
MISSING, TRACKLET_S = 0.1, 4.0


SHARED_METHODS: dict[str, dict[str, Any]] = {
    "geopose": {"method": "geopose", "solver": (("min_correspondences", MIN_POINTS),)},
    "people": {"method": "people"},
    "people, joints": {"method": "people", "points": "joints"},
}
JOINT_NOISE_PX = 2.0
CLAIMS = {
    "geopose": (30.0, "the paper: 30 suffice"), "people": (10.0, "10 are enough"), "people, joints": (10.0, "10 are enough"),
}  # fmt: skip
ENOUGH_MM, ENOUGH_DEG = 400.0, 1.1
"""The paper's own mean over its three scenes, of all its correspondences, is 404 mm and 1.08 degrees."""
GIVEN, UNSEARCHED, COMBINED = "given, searched", "given, not searched", "combined"

RATES = (5.0, 12.5, 25.0, 30.0, 50.0, 60.0)
EVERY = (1, 2, 3, 6)
UNEVEN_FPS = 50.0
SAMPLED_OFFSET_S, SAMPLED_SEEDS = 1.3, 2


@dataclass(frozen=True)
class Curve:
    """One condition at several levels."""

    levels: tuple[float, ...]
    quick_levels: tuple[float, ...]
    condition: Callable[[str, str, float, int], Condition]  # of a preset, a method, a level and a seed
    axis: Axis
    presets: int = 1  # the first so many of all presets
    methods: tuple[str, ...] = tuple(METHODS)
    tables: Callable[[Swept, Wanted, Executor | None, Progress], dict[str, Table]] = lambda *_: {}  # further ones


def _with(options: Callable[[float], dict[str, Any]]) -> Callable[[str, str, float, int], Condition]:
    """Conditions with these options of the simulation at a level, beside preset, seed and noise."""

    def condition(preset: str, method: str, level: float, seed: int) -> Condition:
        chosen = SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, **options(level))
        return Condition(chosen, METHODS[method]) if method in METHODS else Condition(chosen, search_s=SEARCHED_S)

    return condition


def _compare_swapped(swept: Swept, *_: object) -> dict[str, Table]:
    """The goal of the default method: its errors with swapped identities over those without."""
    rows = []
    for preset in swept.presets:
        clean, swapped = (swept.outcomes[preset, "people", level] for level in (0.0, BORNE))
        figures = [median(swapped, figure) / median(clean, figure) for figure in ("similarity_mm", "similarity_deg")]
        rows.append([preset, *(number(ratio, 2) for ratio in figures), yes(max(figures) <= LARGEST_RATIO)])
    return {"Ratios": table(("scene", "ratio, mm", "ratio, degrees", f"at most {LARGEST_RATIO}"), rows)}


def _shared(preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(preset=preset, seed=seed, box_noise=BOX_NOISE, joint_noise_px=JOINT_NOISE_PX)
    return Condition(options, shared=int(level), **SHARED_METHODS[method])


def _claims(swept: Swept, *_: object) -> dict[str, Table]:
    rows = []
    for preset in swept.presets:
        for method in swept.methods:
            level, claim = CLAIMS[method]
            outcomes = swept.outcomes[preset, method, level]
            cells = [cell for placement in ("similarity", "metric") for cell in _claim_cells(outcomes, placement)]
            rows.append([preset, method, claim, *cells, failures(outcomes)])
    return {"Claims": table(("scene", "method", "claim", "similarity, median", "worst seed", "enough",
                             "metric, median", "worst seed", "enough", "failed"), rows)}  # fmt: skip


def _claim_cells(outcomes: Sequence[Outcome], placement: str) -> list[str]:
    """Median and worst errors, and whether they are small enough."""
    mm, degrees = (of(outcomes, f"{placement}_{unit}") for unit in ("mm", "deg"))
    enough = sum(a <= ENOUGH_MM and b <= ENOUGH_DEG for a, b in zip(mm, degrees, strict=True))
    middle = quartiles(mm)[1] <= ENOUGH_MM and quartiles(degrees)[1] <= ENOUGH_DEG
    verdict = f"{yes(middle)} ({enough} of {len(outcomes)})"
    return [median_errors(outcomes, placement), worst_errors(outcomes, placement), verdict]


def _clocked(preset: str, method: str, level: float, seed: int) -> Condition:
    options = SimulationOptions(
        preset=preset, seed=seed, box_noise=BOX_NOISE, clock_offsets=level, unrelated_ids=method == COMBINED
    )
    return Condition(options, search_s=0.0 if method == UNSEARCHED else SEARCHED_S)


def _clock_tables(swept: Swept, wanted: Wanted, executor: Executor | None, tell: Progress) -> dict[str, Table]:
    return {"Clock errors": _clock_table(swept), "Sampled frames": _sampled_frames(wanted, executor, tell)}


def _sampled_frames(wanted: Wanted, executor: Executor | None, tell: Progress) -> Table:
    """How well the clocks are found from every n-th picture of videos of all usual rates."""
    rates: tuple[float | None, ...] = (25.0,) if wanted.quick else (*RATES, None)
    every, seeds = (1, 6) if wanted.quick else EVERY, range(seeds_of(wanted, SAMPLED_SEEDS))
    keys = [(rate, step, method) for rate in rates for step in every for method in (GIVEN, COMBINED)]
    conditions = {key: [_of_rate(*key, seed) for seed in seeds] for key in keys}
    found = run_conditions([one for some in conditions.values() for one in some], executor, tell, "sampled frames", wanted.kept)
    rows = []
    for (rate, step, method), some in conditions.items():
        outcomes = tuple(found[one] for one in some)
        shown = ", ".join(f"{number(outcome.similarity_mm)} mm {outcome.similarity_deg:.3f}°" for outcome in outcomes)
        verdicts = ", ".join(outcome.verdict for outcome in outcomes)
        rate_shown = "uneven" if rate is None else f"{rate:g}"
        rows.append([rate_shown, f"{step}", method, shown, *_clock_cells(outcomes), verdicts])
    head = ("frames per second", "every n-th", "method", "similarity", "clock error, median", "worst", "failed", "verdicts")
    return table(head, rows)


def _of_rate(rate: float | None, every: int, method: str, seed: int) -> Condition:
    options = SimulationOptions(
        preset="terrace", seed=seed, fps=rate or UNEVEN_FPS, box_noise=BOX_NOISE, clock_offsets=SAMPLED_OFFSET_S,
        unrelated_ids=method == COMBINED,
    )  # fmt: skip
    return Condition(options, search_s=SEARCHED_S, every=every, uneven=rate is None)


def _clock_table(swept: Swept) -> Table:
    """How well the clocks are found."""
    rows = [
        [preset, f"{level:g}", method, *_clock_cells(swept.outcomes[preset, method, level])]
        for preset in swept.presets
        for level in swept.levels
        for method in swept.methods
    ]
    head = ("scene", "offsets, s", "method", "clock error, median", "worst", "failed")
    return table(head, rows)


def _clock_cells(outcomes: tuple[Outcome, ...]) -> list[str]:
    errors = of(outcomes, "clock_ms")
    shown = [FAILS if error == float("inf") else f"{number(error)} ms" for error in (quartiles(errors)[1], max(errors))]
    return [*shown, failures(outcomes)]


CURVES: Mapping[str, Curve] = MappingProxyType({
    "swaps": Curve(
        (0.0, 0.1, 0.2, 0.3, 0.5), (0.0, 0.3), _with(lambda share: {"identity_swaps": share}),
        Axis("swapped identities", "swapped", partial(percent, digits=0)), 3, tables=_compare_swapped,
    ),
    "missing": Curve(
        (0.0, 0.2, 0.5, 0.8), (0.0, 0.8), _with(lambda share: {"missing": share}),
        Axis("missing boxes", "missing", partial(percent, digits=0)), 2,
    ),
    "cameras": Curve(
        (2.0, 3.0, 4.0, 6.0, 8.0), (2.0, 6.0), _with(lambda count: {"cameras": int(count)}),
        Axis("cameras", "cameras", scale="log"),
    ),
    "people": Curve(
        (1.0, 2.0, 4.0, 7.0, 12.0, 20.0), (1.0, 7.0), _with(lambda count: {"people": int(count)}),
        Axis("people", "people", scale="log"),
    ),
    "seconds": Curve(
        (10.0, 20.0, 40.0, 80.0), (10.0,), _with(lambda seconds: {"seconds": seconds, "missing": MISSING,
        "tracklet_seconds": TRACKLET_S, "unrelated_ids": True}), Axis("seconds", "seconds", scale="log"), methods=("combined",),
    ),
    "correspondences": Curve(
        (5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 200.0, 500.0), (10.0, 30.0, 200.0), _shared,
        Axis("shared person-instants", "shared", scale="log"), 3, tuple(SHARED_METHODS), _claims,
    ),
    "clocks": Curve(
        (0.0, 0.2, 0.5, 1.0), (0.5,), _clocked, Axis("largest clock offset, s", "offsets, s"), 1, (GIVEN, COMBINED, UNSEARCHED),
        _clock_tables,
    ),
})  # fmt: skip
"""By page. In `seconds` neither identities nor clocks are known."""


def run(name: str, wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """One curve with five seeds; two levels of one scene and two seeds in a quick run."""
    curve = CURVES[name]
    levels = curve.quick_levels if wanted.quick else curve.levels
    presets = presets_of(wanted)[: curve.presets]
    swept = sweep(curve.condition, presets, curve.methods, levels, SEEDS, wanted, executor, tell, name)
    return curve_found(name, swept, curve.axis, curve.tables(swept, wanted, executor, tell))
