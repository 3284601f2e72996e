"""What the figures behind limits of the verdict come to in right rigs and in wrong ones, on seeds kept for limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.association.ambiguity import AMBIGUOUS
from passerby.calibration.calibration import Calibration
from passerby.calibration.diagnostics.ground_planarity import STEEP_DEG, STEEP_SIGMAS
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.usability import CODE, ON_GROUND, USABLE_M, USABLE_SCALE
from passerby.simulation import simulate
from reliability.hostile import HOSTILE
from reliability.judging import calibrated, errors_of
from reliability.ordinary import ordinary_scene
from reliability.other_inputs import CALIBRATED, VIDEOS, drawn

ORDINARY_SEED, HOSTILE_SEED, FILM_SEED = 940_000, 941_000, 961_000
"""The first ones; no page of results uses them."""
ORDINARY, FILM = "ordinary", "film"


@dataclass(frozen=True)
class Figure:
    """What a limit of the verdict is held against."""

    limit: float
    constant: str
    code: str
    """Of the finding."""
    least: bool
    """Whether values below the limit speak against the rig; otherwise those above do."""
    tried: Sequence[float]
    """Other limits."""

    def speaks(self, value: float, limit: float) -> bool:
        """Whether a value speaks against the rig."""
        return value < limit if self.least else value > limit


FIGURES: Mapping[str, Figure] = MappingProxyType({
    "points": Figure(USABLE_M, "USABLE_M", CODE, False, (0.05, 0.1, 0.15, 0.2, 0.25, 0.35, 0.5, 1.0)),
    "ground": Figure(ON_GROUND * USABLE_M, "ON_GROUND times USABLE_M", CODE, False, (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.2, 2.0)),
    "scale": Figure(USABLE_SCALE, "USABLE_SCALE", CODE, False, (0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)),
    "slope": Figure(STEEP_DEG, "STEEP_DEG", "people_on_levels", False, (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)),
    "steep": Figure(STEEP_SIGMAS, "STEEP_SIGMAS", "people_on_levels", False, (2.0, 3.0, 4.0, 5.0, 7.0, 10.0)),
    "alike": Figure(AMBIGUOUS, "AMBIGUOUS", "arrangement_ambiguous", False, (0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.9)),
})  # fmt: skip
"""Points: one sigma of how far a camera's rays pass beside places, m; ground: one sigma of positions on the ground by one
camera, m; scale: relative sigma of all lengths; slope: of the ground below people's paths, degrees, and steep: the same in
sigmas, each if the other limit is exceeded; alike: score of a camera's runners-up as a share of its registrations'."""


@dataclass(frozen=True)
class Judged:
    """One scene."""

    case: str
    """`ORDINARY`, `FILM` or the name of a hostile case."""
    wrong: bool
    """Whether a camera is off by more than may be accepted."""
    codes: tuple[str, ...]
    """Of the doubts."""
    values: Mapping[str, float]
    """Of the figures, NaN where there is none."""


def cases(seeds: int) -> dict[str, tuple[str, int]]:
    """Ordinary scenes, twenty for each seed, five films, and each hostile case once for every four, by key."""
    ordinary = [(ORDINARY, seed) for seed in range(ORDINARY_SEED, ORDINARY_SEED + 20 * seeds)]
    ordinary += [(FILM, seed) for seed in range(FILM_SEED, FILM_SEED + 5 * seeds)]
    hostile = [(name, HOSTILE_SEED + k) for k in range(max(1, seeds // 4)) for name in HOSTILE]
    return {f"{name} {seed}": (name, seed) for name, seed in ordinary + hostile}


def measure(case: tuple[str, int]) -> dict[str, Any]:
    """A case calibrated, as plain values; nothing where its files are refused or fewer than two cameras have a pose."""
    found = judged(case)
    return {} if found is None else asdict(found)


def judged(case: tuple[str, int]) -> Judged | None:
    """The same with its types."""
    try:
        found, truths = _calibrated(*case)
    except InputError:
        return None
    errors = [one for truth in truths if (one := errors_of(found.rig, truth)) is not None]
    if not errors:
        return None
    codes = tuple(one.code for one in found.doubts)
    return Judged(case[0], any(one.wrong for one in errors), codes, _values(found))


def _calibrated(name: str, seed: int) -> tuple[Calibration, list[Rig]]:
    """A case calibrated, and what is true of it, at the beginning and, where that is another thing, later."""
    if name == FILM:
        filmed = simulate(drawn(VIDEOS, seed))
        return CALIBRATED[VIDEOS](filmed, seed)[0], [filmed.rig]
    scene = ordinary_scene(seed) if name == ORDINARY else HOSTILE[name][1](seed)
    return calibrated(scene), [scene.truth] if scene.later is None else [scene.truth, scene.later]


def _values(found: Calibration) -> dict[str, float]:
    figures = found.figures
    known = adjusted(figures)
    measured = [] if known.measuring is None else list(known.measuring.cameras.values())
    ground = figures.ground
    slope = math.nan if ground is None or ground.slope_deg is None else ground.slope_deg
    sigmas = slope / ground.slope_sigma_deg if ground is not None and ground.slope_sigma_deg else math.nan
    return {
        "points": max((one.across.median_mm for one in measured), default=math.nan) / 1000,
        "ground": max((one.ground.median_mm for one in measured if one.ground is not None), default=math.nan) / 1000,
        "scale": math.nan if known.scale.relative_sigma is None else known.scale.relative_sigma,
        "slope": slope if sigmas > STEEP_SIGMAS else min(slope, 0.0),
        "steep": sigmas if slope > STEEP_DEG else min(sigmas, 0.0),
        "alike": max(_alike(found).values(), default=math.nan),
    }


def _alike(found: Calibration) -> dict[str, float]:
    """By camera, what the runners-up of its used registrations score together, as a share of these; empty without any."""
    best, second = dict[str, float](), dict[str, float]()
    for pair in (None if found.association is None else found.association.figures.pairs) or ():
        if pair.route == "tracks" and pair.used and pair.score is not None and pair.runner_up is not None:
            for name in pair.cameras:
                best[name] = best.get(name, 0.0) + pair.score
                second[name] = second.get(name, 0.0) + pair.runner_up * pair.score
    return {name: second[name] / best[name] for name in best}


def tabulate(outcomes: Outcomes, _: Mapping[str, Any]) -> Found:
    """A table of what each figure comes to, and one of what other limits would do; `outcomes` of `measure`, by key."""
    results = [Judged(**one) for one in outcomes.values() if one]
    kinds = {
        "ordinary scenes, right": [one for one in results if one.case == ORDINARY and not one.wrong],
        "rendered films, right": [one for one in results if one.case == FILM and not one.wrong],
        "hostile cases, right": [one for one in results if one.case not in (ORDINARY, FILM) and not one.wrong],
        "wrong rigs": [one for one in results if one.wrong],
    }
    tables, limits = {}, []
    for name, figure in FIGURES.items():
        rows = []
        for kind, some in kinds.items():
            values = np.array([one.values[name] for one in some])
            known = values[np.isfinite(values)]
            worst = (0.0, 0.01, 0.05, 0.5) if figure.least else (1.0, 0.99, 0.95, 0.5)
            quantiles = [f"{np.quantile(known, q):.2f}" for q in worst] if len(known) else ["-"] * 4
            rows.append([kind, str(len(known)), *quantiles])
        curve = []
        for limit in figure.tried:
            alone = [one for one in kinds["wrong rigs"] if set(one.codes) <= {figure.code}]
            curve.append([
                f"**{limit:g}**" if limit == figure.limit else f"{limit:g}",
                *(_share(figure, name, some, limit) for some in kinds.values()),
                str(sum(figure.speaks(one.values[name], limit) for one in alone)),
            ])  # fmt: skip
        tables[figure.constant] = table(("", "rigs", "worst", "1 % are worse", "5 % are worse", "median"), rows)
        tables[f"{figure.constant}, other limits"] = table(("limit", *kinds, "wrong rigs that nothing else tells"), curve)
        limits.append(f"{figure.constant} = {figure.limit:g}")
    return Found(tables, run=", ".join(limits))


def _share(figure: Figure, name: str, some: Sequence[Judged], limit: float) -> str:
    known = [one.values[name] for one in some if math.isfinite(one.values[name])]
    beyond = sum(figure.speaks(value, limit) for value in known)
    return f"{beyond} of {len(known)}"
