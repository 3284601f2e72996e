"""Rows of the tables of `docs/results/lenses.md`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from lenses.recorded import CASES, DEMO
from lenses_summary import GROUND_RATIO, MOST_PERCENT, PART_GOALS, POINTS_MM, RECORDED_GOALS, SHARE, Summary, median, within
from pages.cases import Outcomes
from pages.tables import errors, number, reached
from passerby.simulation import PRESETS

Row = list[str]
IDENTITIES = {True: "identities known", False: "identities unknown"}
COST_NAMES = {
    "varied": "boxes, each camera its own lens",
    "shared": "boxes, one model of lens",
    "keypoints": "boxes and keypoints",
    "mixed": "boxes, half of the lenses known",
    "demo": "the demonstration, from its videos",
}


def simulated_rows(cases: Mapping[str, Any], done: Outcomes) -> list[Row]:
    """A row for each preset and one for all, identities known and unknown; those that have begun."""
    rows = []
    for known, label in IDENTITIES.items():
        for preset in (None, *PRESETS):
            wanted = sum(case.identities_known == known and preset in (None, case.preset) for case in cases.values())
            some = _of(done, known, preset)
            if some:
                rows.append(_simulated_row(f"{preset or 'all'}, {label}", wanted, Summary(some)))
    return rows


def recorded_rows(cases: Mapping[str, Any], done: Outcomes) -> list[Row]:
    """A row for each set, or the demonstration."""
    return [_recorded_row(key, Summary([done[key]])) if key in done else [key, "not run", *[""] * 12] for key in cases]


def cost_rows(part: str, done: Outcomes) -> list[Row]:
    """What estimated lenses cost, in a row for known and one for unknown identities."""
    if part == DEMO:
        return [_cost_row(COST_NAMES[part], [*done.values()])] if done else []
    return [
        _cost_row(f"{COST_NAMES[part]}, {label}", some) for known, label in IDENTITIES.items() if (some := _of(done, known))
    ]


def part_goals(part: str, wanted: int, done: Outcomes) -> list[Row]:
    """A simulated part against what is asked, of the scenes whose identities are unknown; a row for each figure."""
    goal, summary = PART_GOALS[part], Summary(_of(done, known=False))
    name = f"{COST_NAMES[part]}, identities unknown"
    if not summary.cases:
        return [[name, "not run", "", "", ""]]
    count = f"{len(summary.cases)} of {wanted // 2} scenes"
    asked = [("focal error, median", median(summary.focal_errors), goal.median, " %")]
    if goal.most is not None:
        asked.append(("focal error, 95 %", within(summary.focal_errors, 0.95), goal.most, " %"))
    asked.append((f"rig's error, times that with true intrinsics, {100 * SHARE:.0f} % of scenes",
                  within(summary.ratios("mm", "deg"), SHARE), goal.ratio, " x"))  # fmt: skip
    rows = [
        [f"{name}: {what}", f"{number(value, 2)}{unit} ({count})", *(f"{limit:g}{unit}" for limit in limits),
         reached([_finite(value)], [limits[0]], [limits[1]])]
        for what, value, limits, unit in asked
    ]  # fmt: skip
    inside = 100 * sum(value <= 2 for value in summary.measured_in_sigmas) / len(summary.cases)
    for what, share, limits in (("accepted", summary.accepted, (89.0, 97.0)),
                                ("points and ground within two stated sigmas", inside, (90.0, 95.0))):  # fmt: skip
        rows.append([f"{name}: {what}", f"{share:.0f} % ({count})", *(f"{limit:g} %" for limit in limits),
                     reached([-share], [-limits[0]], [-limits[1]])])  # fmt: skip
    wrong = summary.accepted_wrong
    accepted = f"{name}: accepted with a focal error over {MOST_PERCENT:g} %"
    return [*rows, [accepted, f"{wrong} ({count})", "0", "0", reached([wrong], [0], [0])]]


def recorded_goals(done: Outcomes) -> list[Row]:
    """The real sets, or the demonstration, against what is asked."""
    rows = []
    names = {case.key: case.name for case in CASES} | {DEMO: DEMO}
    for key, outcome in done.items():
        goal = RECORDED_GOALS[names[key]]
        counted = outcome | {"withheld": [name for name in outcome["withheld"] if name not in goal.apart]}
        summary = Summary([counted])
        estimated, focal = outcome["estimated"], median(summary.focal_errors)
        measured = [f"{number(focal)} %", errors(estimated.get("mm"), estimated.get("deg"))]
        complete = estimated["registered"] == outcome["cameras"]
        verdict = goal.reached(focal, estimated.get("mm"), estimated.get("deg")) if complete else "**missed**"
        left_out = f", without {' and '.join(goal.apart)}" if goal.apart else ""
        count = f"{estimated['registered']} of {outcome['cameras']}"
        rows.append([f"{key}{left_out}", f"{count}, {', '.join(measured)}", goal.in_words(0), goal.in_words(1), verdict])
        if goal.measures:
            points, ground = summary.measured("points")[1], summary.measured("ground")[1] / summary.measured("ground")[0]
            asked = [f"{POINTS_MM[rank]:g} mm, {GROUND_RATIO[rank]:g} x" for rank in (0, 1)]
            met = reached([_finite(points), _finite(ground)], *zip(POINTS_MM, GROUND_RATIO, strict=True))
            rows.append([f"{key}: points; ground, times that with the true intrinsics",
                         f"{number(points)} mm, {number(ground, 2)} x", *asked, met])  # fmt: skip
    return rows


def time_goal(done: Outcomes) -> float | None:
    """The median ratio of processor times, with identities known or unknown, whichever is larger; None where nothing is
    finished.
    """
    if any("about" not in outcome for outcome in done.values()):
        return median(Summary([*done.values()]).time_ratios)
    return max((median(Summary(some).time_ratios) for known in IDENTITIES if (some := _of(done, known))), default=None)


def _of(done: Outcomes, known: bool, preset: str | None = None) -> list[Mapping[str, Any]]:
    return [
        outcome
        for outcome in done.values()
        if outcome["about"]["identities_known"] == known and preset in (None, outcome["about"]["preset"])
    ]


def _simulated_row(label: str, wanted: int, summary: Summary) -> Row:
    focal, sigmas = summary.focal_errors, summary.in_sigmas
    registered, cameras = summary.registered
    return [
        label,
        f"{len(summary.cases)} of {wanted}",
        f"{registered} of {cameras}",
        summary.verdicts(),
        *_measured(summary),
        f"{number(median(focal), 2)} %",
        f"{number(within(focal, 0.95), 2)} %",
        f"{number(max(focal), 2)} %",
        f"{100 * sum(value <= 2 for value in sigmas) / len(sigmas):.0f} %" if sigmas else "-",
        errors(*summary.errors("known")),
        errors(*summary.errors("estimated")),
        f"{median(case['off_centre_deg'] for case in summary.cases):.3f}°",
        _ratios(summary, 0.5),
        _ratios(summary, SHARE),
        number(median(summary.time_ratios), 2),
        str(summary.accepted_wrong),
    ]


def _recorded_row(label: str, summary: Summary) -> Row:
    (case,) = summary.cases
    registered, cameras = summary.registered
    lenses = case["estimated"]["lenses"]
    each = [f"{name} {lenses[name]['focal_percent']:+.1f}" if name in lenses else f"{name} -" for name in case["withheld"]]
    return [
        label,
        f"{registered} of {cameras}",
        case["known"]["verdict"],
        case["estimated"]["verdict"],
        *_measured(summary),
        f"{number(median(summary.focal_errors))} %",
        f"{number(max(summary.focal_errors))} %",
        errors(*summary.errors("known")),
        errors(*summary.errors("estimated")),
        f"{case['off_centre_deg']:.3f}°",
        _ratios(summary, 0.5),
        number(median(summary.time_ratios), 2),
        ", ".join(each),
    ]


def _cost_row(label: str, some: Sequence[Mapping[str, Any]]) -> Row:
    summary = Summary(some)
    return [
        label,
        str(len(some)),
        *_measured(summary),
        f"{number(median(summary.focal_errors))} %",
        f"{number(within(summary.focal_errors, 0.95))} %",
        errors(*summary.errors("known")),
        errors(*summary.errors("estimated")),
        _ratios(summary, 0.5),
    ]


def _measured(summary: Summary) -> list[str]:
    """Errors of points and on the ground, with the true lenses and with estimated ones."""
    return [f"{number(known)} → {number(estimated)} mm" for known, estimated in map(summary.measured, ("points", "ground"))]


def _ratios(summary: Summary, share: float) -> str:
    """Of positions and of orientations."""
    return ", ".join(number(within(summary.ratios(kind), share)) for kind in ("mm", "deg"))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
