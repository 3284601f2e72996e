"""`docs/results/page.md`: the local page in a real browser, beside the goals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from datasets import ROOT
from local_page import clicks, first, hour, kills
from pages.cases import Outcomes
from pages.page import Page, number, reached, table
from pages.parts import Wanted, finished, grown
from pages.sections import Found, Heading, Section

CODE = ("local_page",)
"""Folders of the benchmarks that the outcomes depend on, beside the package."""
KEPT = ROOT / "build" / "page" / "kept"
FILES = ROOT / "build" / "page"
"""The demonstration, the films and the scene that the cases copy."""

_HEAD = """# The local page

`passerby open` in Chromium, driven by Playwright as a person would: [what the page is](../page.md)."""

GOALS_CLICKS = (
    ("six clicks: error of the scale, median", "0.8 %", "0.4 %"),
    ("six clicks: error of the heading, median", "0.8°", "0.4°"),
    ("solving again, 4 cameras, 60 s, median", "8 s", "3 s"),
    ("requests to other hosts, errors of the console", "0", "0"),
    ("serious faults of accessibility by axe-core", "0", "0"),
)
GOAL_FIRST = ("first picture, 16 cameras, an hour, median", "2 s", "0.7 s")
GOALS_KILLS = (
    ("acknowledged marks that are missing after 30 kills", "0", "0"),
    ("half files after 30 kills", "0", "0"),
)


@dataclass(frozen=True)
class Part:
    """A part of the page: a heading, its goals, its cases and what is said of them."""

    heading: Heading
    goals: Sequence[tuple[str, str, str]]
    """Text, acceptable and aim; of a part that was not run they stand as not run."""
    cases: Callable[[int], Mapping[str, Any]]
    """Of a number of repetitions, by key."""
    work: Callable[[Any], Mapping[str, Any]]
    found_in: Callable[[str, Mapping[str, Any], Outcomes, str], Found]
    repeats: int


def clicks_found(part: str, wanted: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """Errors of scale and heading, time of solving again, and what the browser complained about."""
    del part
    some = list(done.values())
    if not some:
        return Found(_note(wanted, done, code))
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
    values = [
        _goal(GOALS_CLICKS[0], float(np.median(scale)), f"{np.median(scale):.2f} %", 0.8, 0.4),
        _goal(GOALS_CLICKS[1], float(np.median(heading)), f"{np.median(heading):.2f}°", 0.8, 0.4),
        _goal(GOALS_CLICKS[2], float(np.median(seconds)), f"{np.median(seconds):.1f} s", 8.0, 3.0),
        _goal(GOALS_CLICKS[3], complaints, str(complaints), 0, 0),
        _goal(GOALS_CLICKS[4], len(faults), str(len(faults)), 0, 0),
    ]
    told = f"{_note(wanted, done, code)} {most} clicks each at most. {_load(some)}\n\n{table(('', 'median', 'largest'), rows)}"
    listed = "".join(f"\n- {fault}" for fault in faults)
    return Found(told + (f"\n\nFaults of accessibility:\n{listed}" if faults else ""), {"goals": values})


_CPU = ("processor time of the server until the first picture", "first_cpu_s")


def first_found(part: str, wanted: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """Times until the first picture and until all."""
    del part
    some = list(done.values())
    if not some:
        return Found(_note(wanted, done, code))
    rows = []
    for name, key in (("address printed", "address_s"), ("first picture", "first_s"), ("all pictures", "all_s"), _CPU):
        values = np.array([case[key] for case in some])
        rows.append([name, *(number(float(value), 2) for value in (values.min(), np.median(values), values.max()))])
    median = float(np.median([case["first_s"] for case in some]))
    goals = [_goal(GOAL_FIRST, median, f"{median:.2f} s", 2.0, 0.7)]
    told = f"{_note(wanted, done, code)} {_load(some)}"
    return Found(f"{told}\n\n{table(('seconds', 'least', 'median', 'most'), rows)}", {"goals": goals})


def kills_found(part: str, wanted: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """What was left of marks and files."""
    del part
    rows, lost, broken = [], 0, 0
    for name, solving in (("marking", False), ("marking and solving", True)):
        some = [case for case in done.values() if case["solving"] == solving]
        missing, half = (sum(len(case[key]) for case in some) for key in ("missing", "broken"))
        lost, broken = lost + missing, broken + half
        rest = (sum(case[key] for case in some) for key in ("marked", "unacknowledged", "temporary"))
        marked, unacknowledged, temporary = map(str, rest)
        rows.append([name, str(len(some)), marked, str(missing), unacknowledged, str(half), temporary])
    heads = (
        "killed while",
        "kills",
        "acknowledged",
        "missing",
        "written, not acknowledged",
        "half files",
        "temporary files left",
    )
    values = (lost, broken)
    goals = [_goal(goal, value, str(value), 0, 0) for goal, value in zip(GOALS_KILLS, values, strict=True)] if done else []
    return Found(f"{_note(wanted, done, code)}\n\n{table(heads, rows)}", {"goals": goals} if goals else {})


def _note(wanted: Mapping[str, Any], done: Outcomes, code: str) -> str:
    return f"{len(done)} of {len(wanted)} cases; code of commit {code}."


def _load(some: Sequence[Mapping[str, Any]]) -> str:
    """Times on a machine on which much else runs are not those of a user's."""
    return f"Mean load of the machine at the end of a case: {np.median([case['load'] for case in some]):.1f} (median)."


def _goal(goal: tuple[str, str, str], value: float, said: str, acceptable: float, aim: float) -> list[str]:
    text, *rest = goal
    return [text, said, *rest, reached([value], [acceptable], [aim])]


PARTS: Mapping[str, Part] = {
    "clicks": Part(
        Heading(
            "Six clicks",
            "The output of `passerby demo`: a hand marks one length of 6.4 m on the ground in the two pictures with the "
            "smallest stated sigma, types it, and sets origin and x axis by two clicks; then *Solve again*. Each click is off "
            "by "
            f"{clicks.NOISE_PX:g} px (one sigma, each axis). Errors by the positions of the cameras, after solving again; "
            "*before*: of the demonstration, whose scale is that of the people's heights.",
        ),
        GOALS_CLICKS, lambda repeats: clicks.cases(FILES / "demo", repeats), clicks.work, clicks_found, clicks.SEEDS,
    ),
    "first": Part(
        Heading(
            "First picture",
            f"From the command to pictures in a browser that runs already: {hour.CAMERAS} cameras, {hour.SECONDS / 60:g} "
            f"minutes of {hour.SIZE[0]} x {hour.SIZE[1]} pixels, {hour.FPS} frames per second, a key frame every "
            f"{hour.KEY_EVERY / hour.FPS:g} s; nothing was calibrated before.",
        ),
        [GOAL_FIRST], lambda repeats: first.cases(FILES / "hour", repeats), first.work, first_found, first.REPEATS,
    ),
    "kills": Part(
        Heading(
            "Kills",
            "Lengths are marked one after the other as fast as the server acknowledges them; the server is ended by SIGKILL "
            f"at a random moment, up to {kills.MARKING_S:g} s after its beginning, or up to {kills.SOLVING_S:g} s after a "
            "calibration was started, which is killed as well.",
        ),
        GOALS_KILLS, lambda repeats: kills.cases(FILES / "small", repeats), kills.work, kills_found, kills.KILLS,
    ),
}  # fmt: skip
"""In their order on the page."""
HEADINGS: Mapping[str, Heading] = {name: part.heading for name, part in PARTS.items()}
QUICK = 2
"""Repetitions in a quick run."""


def run(scratch: Path, quick: bool, wanted: Wanted | None = None) -> Iterator[Page]:
    """The page after each finished case. One case at a time: their times count."""
    del scratch
    wanted = wanted or Wanted(KEPT)
    return grown("page", head, HEADINGS, partial(_part, quick=quick, wanted=wanted), wanted, CODE)


def _part(name: str, quick: bool, wanted: Wanted) -> Iterator[Found]:
    part = PARTS[name]
    return finished(name, part.cases(QUICK if quick else part.repeats), part.work, part.found_in, wanted, CODE)


def head(sections: Sequence[Section]) -> str:
    """What stands above the parts: the goals."""
    goals: list[list[str]] = []
    for section in sections:
        unmet = [[text, "not run", acceptable, aim, ""] for text, acceptable, aim in PARTS[section.part].goals]
        goals += section.facts.get("goals", unmet)
    return f"{_HEAD}\n\n## Goals\n\n{table(('case', 'measured', 'acceptable', 'aim', 'reached'), goals)}"
