"""Does the verdict let a wrong rig pass, and does it let right ones pass? Hostile cases and ordinary scenes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from pages.records import Found
from pages.tables import Table, table
from reliability import hostile, ordinary
from reliability.hostile import EVERY
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept, percent, seeds

HOSTILE_SEEDS = seeds(106_000, 1)
ORDINARY_SEEDS = seeds(107_000, 200)
QUICK_CASES = ("line-given", "court-confused", "flipped", "focal-20-all", "moved-pan-15", "drift-4", "slope-10", "apart-found")
QUICK_ORDINARY = 6
MOST_REFUSED = 0.03
"""Share of the ordinary scenes that may be turned down."""


def run(wanted: Wanted) -> Found:
    """All hostile cases and all ordinary scenes; a few of each in a quick run."""
    names = QUICK_CASES if wanted.quick else tuple(EVERY)
    cases = {f"{name} {seed}": (name, seed) for seed in HOSTILE_SEEDS for name in names}
    found = kept(wanted, "hostile", cases, hostile.work)
    scenes = {str(seed): seed for seed in (ORDINARY_SEEDS[:QUICK_ORDINARY] if wanted.quick else ORDINARY_SEEDS)}
    usual = kept(wanted, "ordinary", scenes, ordinary.work)
    return part_found(_lines(found, usual), _tables(cases, found, usual))


def false_accepts(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The cases that were accepted although a camera is off."""
    return [key for key, result in found.items() if result["verdict"] == "accepted" and result["wrong"]]


def _lines(found: Mapping[str, Mapping[str, Any]], usual: Mapping[str, Mapping[str, Any]]) -> list[Line]:
    """What goes into the table over all parts."""
    wrong = false_accepts(found)
    wrong_usual = false_accepts(usual)
    lines = [Line(f"wrong rigs accepted, {len(found)} hostile cases", str(len(wrong)), "0", not wrong)]
    for kind, results in _by_kind(usual).items():
        passed = sum(result["verdict"] == "accepted" for result in results)
        lines.append(
            Line(f"rigs accepted, {len(results)} ordinary scenes of {kind}", percent(passed, len(results)), "97 % or more",
                 passed >= (1 - MOST_REFUSED) * len(results))
        )  # fmt: skip
    return [*lines, Line(f"wrong rigs accepted, {len(usual)} ordinary scenes", str(len(wrong_usual)), "0", not wrong_usual)]


def _by_kind(usual: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """The results of ordinary scenes by what is handed in."""
    out: dict[str, list[Mapping[str, Any]]] = {}
    for result in usual.values():
        out.setdefault(result["kind"], []).append(result)
    return {kind: out[kind] for kind in sorted(out)}


def _tables(
    cases: Mapping[str, tuple[str, int]], found: Mapping[str, Mapping[str, Any]], usual: Mapping[str, Mapping[str, Any]]
) -> dict[str, Table]:
    """Verdicts of hostile cases and of ordinary scenes, and each hostile case."""
    counts = [[verdict, *_rigs([one for one in found.values() if one["verdict"] == verdict])] for verdict in _VERDICTS]
    wrong = {key: found[key] for key in false_accepts(found)}
    turned_down = [result for result in usual.values() if result["verdict"] != "accepted"]
    why = Counter(_kind(reason) for result in turned_down for reason in result["reasons"])
    verdicts = [
        [kind, str(len(results)), *(str(sum(one["verdict"] == verdict for one in results)) for verdict in _VERDICTS),
         str(sum(one["verdict"] == "accepted" and one["wrong"] for one in results))]
        for kind, results in _by_kind(usual).items()
    ]  # fmt: skip
    return {
        "Hostile cases by verdict": table(("verdict", "rig right", "rig wrong", "no rig"), counts),
        "Wrong rigs accepted": _case_table(cases, wrong),
        "Ordinary scenes": table(("handed in", "scenes", *_VERDICTS, "wrong and accepted"), verdicts),
        "Reasons of ordinary scenes": table(("reason", "scenes"), [[reason, str(n)] for reason, n in why.most_common()]),
        "Hostile cases": _case_table(cases, found),
    }


def _case_table(cases: Mapping[str, tuple[str, int]], found: Mapping[str, Mapping[str, Any]]) -> Table:
    """One row for each case."""
    head = ("case", "verdict", "worst camera, mm", "degrees", "placed, mm", "first reason")
    return table(
        head,
        [
            [EVERY[cases[key][0]][0], result["verdict"], *_errors(result), _first(result["reasons"])]
            for key, result in found.items()
        ],
    )


def _rigs(results: Sequence[Mapping[str, Any]]) -> list[str]:
    """How many of the results are right rigs, wrong rigs, and none."""
    wrong, none = sum(one["wrong"] for one in results), sum("similarity_mm" not in one for one in results)
    return [str(len(results) - wrong - none), str(wrong), str(none)]


_VERDICTS = ("accepted", "doubtful", "refused")


def _errors(result: Mapping[str, Any]) -> list[str]:
    """The columns of errors; bold where they are too large."""
    if "similarity_mm" not in result:
        return ["-", "-", "-"]
    mark = "**" if result["wrong"] else ""
    return [f"{mark}{result[key]:{form}}{mark}" for key, form in
            (("similarity_mm", ".0f"), ("similarity_deg", ".2f"), ("placed_mm", ".0f"))]  # fmt: skip


def _first(reasons: Sequence[str]) -> str:
    """The first reason, short."""
    if not reasons:
        return "-"
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    return reasons[0].replace("|", "/") + more


def _kind(reason: str) -> str:
    """A reason without its names and numbers."""
    return re.sub(r"\bC\d+\b", "C", re.sub(r"-?\d+(\.\d+)?", "N", reason))
