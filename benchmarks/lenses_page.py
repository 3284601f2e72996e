"""`docs/results/lenses.md`: what estimated lenses cost, the goals, then each part's own table."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

from datasets import ROOT
from lenses import recorded, simulated
from lenses_summary import PART_GOALS, TIME_GOAL, Summary
from lenses_tables import cost_rows, part_goals, recorded_goals, recorded_rows, simulated_rows, time_goal
from pages.cases import Outcomes
from pages.parts import Cases, Part, PartedPage, found_of
from pages.records import Found
from pages.tables import reached, table

CODE = ("lenses",)
"""Folders of the benchmarks that the outcomes depend on, beside the package; how they are shown is not among them."""
RECORDED = "recorded"
COST_HEAD = (
    "case", "scenes", "points", "ground", "focal, median", "95 %", "rig, true intrinsics", "rig, estimated", "ratio",
)  # fmt: skip
SEEDS = 10
"""Of each preset."""
KEPT = ROOT / "build" / "lenses"

_SIMULATED = ("scenes", "finished", "registered", "verdicts", "points", "ground", "focal, median", "95 %", "largest",
              "within 2 sigmas",
              "rig, true", "rig, estimated", "off centre", "ratio", "ratio, 90 %", "time ratio",
              "accepted, over 8 %")  # fmt: skip
_RECORDED = ("data", "registered", "verdict, true", "verdict, estimated", "points", "ground", "focal, median", "largest",
             "rig, true", "rig, estimated", "off centre", "ratio", "time ratio", "focal errors by camera, %")  # fmt: skip


def tabulate(part: str, cases: Cases, done: Outcomes) -> Found:
    """A part as far as it is finished."""
    goals, notes = [], []
    if part in (RECORDED, recorded.DEMO):
        tables = {"Data": table(_RECORDED, recorded_rows(cases, done))}
        goals = recorded_goals(done)
    else:
        tables = {"Scenes": table(_SIMULATED, simulated_rows(cases, done))}
        goals = part_goals(part, len(cases), done) if part in PART_GOALS else []
    if part == RECORDED:
        absent = [case.key for case in recorded.CASES if case.key not in cases]
        notes = [f"Not run, because the data are not here: {'; '.join(absent)}."] if absent else []
    elif cost := cost_rows(part, done):
        tables["Cost"] = table(COST_HEAD, cost)
    ratio = time_goal(done) if part != recorded.DEMO else None
    if ratio is not None and math.isfinite(ratio):
        goals = [*goals, _time_row(part, ratio)]
    found = found_of(cases, done, tables, goals, notes)
    return replace(found, run=f"{found.run}; {60 * Summary([*done.values()]).cpu_hours:.1f} minutes of processor time")


def _time_row(part: str, ratio: float) -> list[str]:
    return [f"{part}: processor time, times that with the true intrinsics", f"{ratio:.1f} x",
            *(f"{limit:g} x" for limit in TIME_GOAL), reached([ratio], [TIME_GOAL[0]], [TIME_GOAL[1]])]  # fmt: skip


def _part(part: str) -> Part:
    if part == RECORDED:
        return Part(lambda _: recorded.cases(), recorded.work, partial(tabulate, part))
    if part == recorded.DEMO:
        return Part(lambda _: {recorded.DEMO: recorded.DEMO}, recorded.work_demo, partial(tabulate, part))
    return Part(partial(simulated.cases, part), simulated.work, partial(tabulate, part))


PARTS = ("varied", "shared", "keypoints", "mixed", RECORDED, recorded.DEMO)
PAGE = PartedPage("lenses", {part: _part(part) for part in PARTS}, CODE, KEPT, SEEDS)
