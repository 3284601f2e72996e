"""`docs/results/lenses.md`: what estimated lenses cost, the goals, then each part's own table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from datasets import ROOT
from lenses import recorded, simulated
from lenses_summary import PART_GOALS, TIME_GOAL, Summary
from lenses_tables import cost_rows, part_goals, recorded_goals, recorded_rows, simulated_rows, time_goal
from pages.cases import Outcomes
from pages.page import Page, reached, table
from pages.parts import Wanted, finished, grown
from pages.sections import Found, Heading, Section

CODE = ("lenses",)
"""Folders of the benchmarks that the outcomes depend on, beside the package; how they are shown is not among them."""
RECORDED = "recorded"
SEEDS = 10
"""Of each preset."""
KEPT = ROOT / "build" / "lenses"

_SIMULATED = ("scenes", "finished", "registered", "verdicts", "points", "ground", "focal, median", "95 %", "largest",
              "within 2 sigmas",
              "rig, true", "rig, estimated", "off centre", "ratio", "ratio, 90 %", "time ratio",
              "accepted, over 8 %")  # fmt: skip
_RECORDED = ("data", "registered", "verdict, true", "verdict, estimated", "points", "ground", "focal, median", "largest",
             "rig, true", "rig, estimated", "off centre", "ratio", "time ratio", "focal errors by camera, %")  # fmt: skip

HEADINGS: Mapping[str, Heading] = {
    "varied": Heading("A lens of its own for each camera", "Boxes only."),
    "shared": Heading(
        "One model of lens for all cameras",
        "Boxes only. All cameras have the same focal length and distortion, and the calibration knows that they are of one "
        "model. Their principal points differ.",
    ),
    "keypoints": Heading("With keypoints", "Boxes, and keypoints with 2 px noise (one standard deviation)."),
    "mixed": Heading(
        "Half of the lenses known",
        "Boxes only. The lenses of every second camera are withheld; the focal errors are those of these cameras.",
    ),
    RECORDED: Heading(
        "Real data",
        "The true intrinsics are those that come with the data. *unrelated*: the ids of each camera are replaced by others, "
        "and identities are estimated. Boxes, or for shelf and pose2sim_single keypoints.",
    ),
    recorded.DEMO: Heading(
        "The demonstration", "`passerby demo --no-intrinsics`, from the videos. The time includes rendering them."
    ),
}
"""Of the parts, in their order on the page."""

_HEAD = """# Cameras without intrinsics

The same scenes are calibrated twice: with the true intrinsics, and with the intrinsics withheld, so that only the image sizes
are known. Simulated scenes are the three presets with four cameras each, for 60 s; boxes have 2 % noise, and 10 % are missing.
Focal lengths are drawn log-uniformly between 0.5 and 2 image widths, the distortion k1 between -0.30 and 0.05 (as far as
every pixel of the image has a ray), principal points within 1 % of the image width around the image centre. If identities are
unknown, so are the clocks, which differ by up to 2 s.

*points*, *ground*: what the rig measures, with the true intrinsics → with estimated ones: points up to 1.8 m above the places
where people walked, triangulated by all cameras that see them, and positions on the ground by one camera; medians after one
similarity of the whole rig. A principal point that is off and a camera that is turned the other way are nearly the same camera
for every point that it measures. So people do not tell the two apart, and errors of the rotation alone, below, do little harm.

*focal*: how far focal lengths are off, in per cent, over all cameras whose intrinsics were withheld; a camera that is not
registered counts as infinitely wrong. *within 2 sigmas*: share of these errors within twice the stated sigma. *rig*: error of
positions and orientations after similarity alignment, mean over the cameras, then median over the scenes. *ratio*: the rig's
error with estimated intrinsics over that with the true ones, of positions and of orientations; the median over the scenes, and
what 90 % of them do not exceed. *time ratio*: the same for processor time (median). *off centre*: the angle by which true
principal points are off the image centres, mean over the cameras whose intrinsics were withheld, median over the scenes; a
camera whose principal point is assumed to be in the centre is turned by as much. *accepted, over 8 %*: scenes that were
accepted although a focal length is off by more than 8 %. A dash: undefined, or infinite."""


def run(scratch: Path, quick: bool, wanted: Wanted | None = None) -> Iterator[Page]:
    """The page after each finished case; one seed of each preset in a quick run."""
    del scratch
    wanted = wanted or Wanted(KEPT, seeds=SEEDS)
    count = 1 if quick else wanted.seeds
    return grown("lenses", head, HEADINGS, partial(_part, wanted=wanted, count=count), wanted, CODE)


def _part(part: str, wanted: Wanted, count: int) -> Iterator[Found]:
    """A part again and again, as its cases are finished."""
    cases: Mapping[str, Any]
    work: Callable[[Any], dict[str, Any]]
    if part == RECORDED:
        cases, work = recorded.cases(), recorded.work
    elif part == recorded.DEMO:
        cases, work = {recorded.DEMO: recorded.DEMO}, recorded.work_demo
    else:
        cases, work = simulated.cases(part, count), simulated.work
    return finished(part, cases, work, found_in, wanted, CODE)


def found_in(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """A part as far as it is finished."""
    hours = Summary([*done.values()]).cpu_hours
    note = f"{len(done)} of {len(cases)} cases; {60 * hours:.1f} minutes of processor time; code of commit {code}."
    if part == RECORDED:
        text = f"{note}\n\n{table(_RECORDED, recorded_rows(cases, done))}"
        absent = [case.key for case in recorded.CASES if case.key not in cases]
        text += f"\n\nNot run, because the data are not here: {'; '.join(absent)}." if absent else ""
        return Found(text, {"goals": recorded_goals(done), "cost": [], "slower": time_goal(done)})
    if part == recorded.DEMO:
        text = f"{note}\n\n{table(_RECORDED, recorded_rows(cases, done))}"
        return Found(text, {"goals": recorded_goals(done), "cost": cost_rows(part, done), "slower": None})
    text = f"{note}\n\n{table(_SIMULATED, simulated_rows(cases, done))}"
    goals = part_goals(part, len(cases), done) if part in PART_GOALS else []
    return Found(text, {"goals": goals, "cost": cost_rows(part, done), "slower": time_goal(done)})


def head(sections: Sequence[Section]) -> str:
    """What stands above the parts: what estimated lenses cost, and the goals."""
    cost = [row for section in sections for row in section.facts.get("cost", ())]
    goals: list[list[str]] = []
    for section in sections:
        asked = section.part in PART_GOALS or section.part in (RECORDED, recorded.DEMO)
        goals += section.facts.get("goals", [[section.title, "not run", "", "", ""]] if asked else [])
    slower = [value for section in sections if (value := section.facts.get("slower")) is not None]
    if slower:
        goals.append(_time_row(max(slower)))
    costs = table(
        ("case", "scenes", "points", "ground", "focal, median", "95 %", "rig, true intrinsics", "rig, estimated", "ratio"), cost
    )
    return f"""{_HEAD}

## What estimated intrinsics cost

{costs if cost else "Not run."}

## Goals

{table(("case", "measured", "acceptable", "aim", "reached"), goals)}"""


def _time_row(ratio: float) -> list[str]:
    return ["time, the slowest part's median", f"{ratio:.1f} x", *(f"{limit:g} x" for limit in TIME_GOAL),
            reached([ratio], [TIME_GOAL[0]], [TIME_GOAL[1]])]  # fmt: skip
