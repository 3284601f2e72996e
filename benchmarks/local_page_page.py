"""`docs/results/page.md`: the local page in a real browser, beside the goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from datasets import ROOT
from goals import goal_row
from local_page import clicks, first, kills
from pages.cases import Outcomes
from pages.parts import Cases, Part, PartedPage, found_of
from pages.records import Found
from pages.tables import number, table

CODE = ("local_page",)  # folders of the benchmarks that the outcomes depend on, beside the package
KEPT = ROOT / "build" / "page" / "kept"
FILES = ROOT / "build" / "page"  # the demonstration, the films and the scene that the cases copy


def tabulate_clicks(cases: Cases, done: Outcomes) -> Found:
    """Errors of scale and heading, time of solving again, and what the browser complained about."""
    some = list(done.values())
    if not some:
        return found_of(cases, done, {})
    scale, before = (100 * np.abs([case[key] for case in some]) for key in ("scale", "scale_before"))
    heading, seconds, cpu = (np.abs([case[key] for case in some]) for key in ("heading_deg", "solving_s", "solving_cpu_s"))
    rows = [
        [name, *(number(float(value), digits) for value in (np.median(values), values.max()))]
        for name, values, digits in (
            ("scale, %", scale, 2), ("scale before, %", before, 2), ("heading, °", heading, 2),
            ("solving again, s", seconds, 1), ("its processor time, s", cpu, 1),
        )
    ]  # fmt: skip
    complaints = sum(len(case["errors"]) + len(case["foreign"]) for case in some)
    faults = sorted({fault for case in some for fault in case["faults"]})
    most = max(case["clicks"] for case in some)
    goals = [
        goal_row(text, (acceptable, aim), said, [value], [float(acceptable.strip(" %°s"))], [float(aim.strip(" %°s"))])
        for text, acceptable, aim, value, said in (
            ("six clicks: error of the scale, median", "0.8 %", "0.4 %", np.median(scale), f"{np.median(scale):.2f} %"),
            ("six clicks: error of the heading, median", "0.8°", "0.4°", np.median(heading), f"{np.median(heading):.2f}°"),
            ("solving again, 4 cameras, 60 s, median", "8 s", "3 s", np.median(seconds), f"{np.median(seconds):.1f} s"),
            ("requests to other hosts, errors of the console", "0", "0", complaints, str(complaints)),
            ("serious faults of accessibility by axe-core", "0", "0", len(faults), str(len(faults))),
        )
    ]
    notes = [f"{most} clicks each at most. {_load(some)}"]
    notes += ["Faults of accessibility:\n" + "".join(f"\n- {fault}" for fault in faults)] if faults else []
    return found_of(cases, done, {"Result": table(("", "median", "largest"), rows)}, goals, notes)


_CPU = ("processor time of the server until the first picture", "first_cpu_s")


def tabulate_first(cases: Cases, done: Outcomes) -> Found:
    """Times until the first picture and until all."""
    some = list(done.values())
    if not some:
        return found_of(cases, done, {})
    rows = []
    for name, key in (("address printed", "address_s"), ("first picture", "first_s"), ("all pictures", "all_s"), _CPU):
        values = np.array([case[key] for case in some])
        rows.append([name, *(number(float(value), 2) for value in (values.min(), np.median(values), values.max()))])
    median = float(np.median([case["first_s"] for case in some]))
    goals = [
        goal_row("first picture, 16 cameras, an hour, median", ("2 s", "0.7 s"), f"{median:.2f} s", [median], [2.0], [0.7])
    ]
    return found_of(cases, done, {"Result": table(("seconds", "least", "median", "most"), rows)}, goals, [_load(some)])


def tabulate_kills(cases: Cases, done: Outcomes) -> Found:
    """What was left of marks and files."""
    rows, lost, broken = [], 0, 0
    for name, solving in (("marking", False), ("marking and solving", True)):
        some = [case for case in done.values() if case["solving"] == solving]
        missing, half = (sum(len(case[key]) for case in some) for key in ("missing", "broken"))
        lost, broken = lost + missing, broken + half
        rest = (sum(case[key] for case in some) for key in ("marked", "unacknowledged", "temporary"))
        marked, unacknowledged, temporary = map(str, rest)
        rows.append([name, str(len(some)), marked, str(missing), unacknowledged, str(half), temporary])
    heads = (
        "killed while", "kills", "acknowledged", "missing", "written, not acknowledged", "half files", "temporary files left",
    )  # fmt: skip
    counts = {"acknowledged marks that are missing after 30 kills": lost, "half files after 30 kills": broken}
    goals = [goal_row(text, ("0", "0"), str(count), [count], [0], [0]) for text, count in counts.items()] if done else []
    return found_of(cases, done, {"Result": table(heads, rows)}, goals)


def _load(some: Sequence[Mapping[str, Any]]) -> str:
    """Times on a machine on which much else runs are not those of a user's."""
    return f"Mean load of the machine at the end of a case: {np.median([case['load'] for case in some]):.1f} (median)."


PAGE = PartedPage(
    "page",
    {
        "clicks": Part(
            lambda repeats: clicks.cases(FILES / "demo", repeats), clicks.work, tabulate_clicks, alone=True, seeds=clicks.SEEDS
        ),
        "first": Part(
            lambda repeats: first.cases(FILES / "hour", repeats), first.work, tabulate_first, alone=True, seeds=first.REPEATS
        ),
        "kills": Part(
            lambda repeats: kills.cases(FILES / "small", repeats), kills.work, tabulate_kills, alone=True, seeds=kills.KILLS
        ),
    },
    CODE, KEPT, 1, quick_seeds=2,
)  # fmt: skip
