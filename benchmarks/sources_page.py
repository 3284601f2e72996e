"""`docs/results/sources.md`: films as phones, recorders and streams give them against plain files, beside the goals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from datasets import ROOT
from pages.cases import Outcomes
from pages.page import Page, errors, number, reached, table
from pages.parts import Wanted, finished, grown
from pages.sections import Found, Heading, Section
from sources import containers, far, sound, zones

CODE = ("sources",)
"""Folders of the benchmarks that the outcomes depend on, beside the package; how they are shown is not among them."""
KEPT = ROOT / "build" / "sources"
SCENES = ROOT / "build" / "scenes"
SEEDS = 3
"""Of each preset, for the zones."""
FACTOR = 1.1
"""Of the plain film's error, up to which a packaging gives the same rig."""

_HEAD = """# Sources

Films in the containers, pieces and streams that people have, against the same films as plain MP4 files."""


@dataclass(frozen=True)
class Part:
    """A part of the page: a heading, its goals, its cases and what is said of them. Another one is one more line in `PARTS`."""

    heading: Heading
    goals: Sequence[tuple[str, str, str]]
    """Text, acceptable and aim; of a part without cases they stand as not run."""
    cases: Callable[[int], Mapping[str, Any]] | None = None
    """Of a number of seeds, by key."""
    work: Callable[[Any], Mapping[str, Any]] | None = None
    found_in: Callable[[str, Mapping[str, Any], Outcomes, str], Found] | None = None


def _note(cases: Mapping[str, Any], done: Outcomes, code: str) -> str:
    minutes = sum(case["cpu_s"] for case in done.values()) / 60
    return f"{len(done)} of {len(cases)} cases; {minutes:.1f} minutes of processor time; code of commit {code}."


def containers_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """The rig of each packaging beside that of the plain film."""
    del part
    plain = done.get("plain", {})
    rows, same = [], 0
    for key, case in done.items():
        ratio = _ratio(case, plain)
        same += key != "plain" and (case.get("unsupported") is not None or ratio <= FACTOR)
        said = case.get("unsupported") or f"{case['verdict']}, {case['registered']} cameras"
        rows.append([case["about"]["text"], said, errors(case["mm"], case["deg"]), number(ratio, 2)])
    count = len(cases) - 1
    verdict = reached([-same], [-count], [-count]) if len(done) == len(cases) else f"{len(done)} of {len(cases)} run"
    goal = [GOAL_CONTAINERS[0], f"{same} of {count}", *GOAL_CONTAINERS[1:], verdict]
    text = f"{_note(cases, done, code)}\n\n{table(('container and codec', 'result', 'error', 'ratio'), rows)}"
    return Found(text, {"goals": [goal]})


def _ratio(case: Mapping[str, Any], plain: Mapping[str, Any]) -> float:
    """The error of positions over that of the plain film."""
    if case.get("mm") is None or not plain.get("mm"):
        return math.inf
    return float(case["mm"] / plain["mm"])


def zones_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """How far the sides of zones are off."""
    del part
    rows = []
    for preset in (None, *dict.fromkeys(case["about"]["preset"] for case in done.values())):
        some = {key: case for key, case in done.items() if preset in (None, case["about"]["preset"])}
        off = zones.all_errors(some)
        if len(off):
            within = 100 * float((off <= 2).mean())
            rows.append([
                preset or "all", str(len(some)), str(len(off) // 4), f"{number(float(np.median(off)), 2)} %",
                f"{number(float(np.quantile(off, 0.95, method='higher')), 2)} %", f"{within:.0f} %",
            ])  # fmt: skip
    off = zones.all_errors(done)
    value = float(np.quantile(off, 0.95, method="higher")) if len(off) else None
    verdict = reached([value], [2.0], [1.0])
    goals = [[GOAL_ZONES[0], f"{number(value, 2)} % ({len(off) // 4} zones)", *GOAL_ZONES[1:], verdict]]
    columns = ("preset", "rigs", "zones", "error of a side, median", "95 %", "within 2 %")
    return Found(f"{_note(cases, done, code)}\n\n{table(columns, rows)}", {"goals": goals})


def far_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """Which starts were found, and what the search takes."""
    del part
    rows = []
    for kind in dict.fromkeys(case["about"]["kind"] for case in done.values()):
        some = [case for case in done.values() if case["about"]["kind"] == kind]
        off = [abs(error) for case in some for error in case["errors_s"] if error is not None]
        found, wrong = (sum(case[key] for case in some) for key in ("found", "wrong"))
        worst = f"{number(1000 * max(off), 0)} ms" if off else "-"
        rows.append([kind, str(len(some)), str(found), str(wrong), worst, f"{number(_time_ratio(some), 2)} x"])
    first = [case for case in done.values() if case["about"]["kind"] == "identities unknown"]
    found, wrong = (sum(case[key] for case in first) for key in ("found", "wrong"))
    ratio = _time_ratio(first) if first else None
    whole = reached([-found, wrong], [-far.SCENES, 0], [-far.SCENES, 0]) if len(first) == far.SCENES else "running"
    goals = [
        [GOALS_FAR[0][0], f"{found} of {len(first)}, {wrong} wrong", *GOALS_FAR[0][1:], whole],
        [GOALS_FAR[1][0], f"{number(ratio, 2)} x", *GOALS_FAR[1][1:], reached([ratio], [3.0], [1.5])],
    ]
    columns = ("scenes", "number", "found", "wrong", "largest error of a start", "time ratio")
    return Found(f"{_note(cases, done, code)}\n\n{table(columns, rows)}", {"goals": goals})


def _time_ratio(some: Sequence[Mapping[str, Any]]) -> float:
    return sum(case["far_s"] for case in some) / max(sum(case["near_s"] for case in some), 1e-9)


def sound_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """How many pairs get an answer, and how far it is off."""
    del part
    rows, wrong = [], sum(case["wrong"] for case in done.values())
    worst = 0.0
    for shared, text in ((True, "something in common"), (False, "nothing in common")):
        some = [case for case in done.values() if case["about"]["shared"] == shared]
        errors = [1000 * abs(case["error_s"]) for case in some if case["error_s"] is not None]
        if shared:
            worst = max(errors, default=math.nan)
        value = f"{number(float(np.median(errors)), 1)} ms" if errors else "-"
        largest = f"{number(max(errors), 1)} ms" if errors else "-"
        rows.append([text, str(len(some)), str(len(errors)), value, largest])
    limit = 1000 * sound.LIMIT_S
    verdict = reached([worst, wrong], [limit, 0], [5.0, 0]) if len(done) == len(cases) else f"{len(done)} of {len(cases)} run"
    said = f"{len(done) - wrong} of {len(done)}, answers within {number(worst, 1)} ms"
    text = f"{_note(cases, done, code)}\n\n{table(('heard', 'pairs', 'answers', 'error, median', 'largest'), rows)}"
    return Found(text, {"goals": [[GOAL_SOUND[0], said, *GOAL_SOUND[1:], verdict]]})


GOALS_FAR = (
    ("starts 20 minutes apart: found, of 10 scenes", "10", "10"),
    ("starts 20 minutes apart: time of search and registration, against +-5 s", "3 x", "1.5 x"),
)
GOAL_SOUND = ("sound: offset, or no answer, 50 of 50", "20 ms", "5 ms")
GOAL_CONTAINERS = ("containers and codecs with the rig of the plain MP4 (1.1 x), or one line why not", "all 12", "all 12")
GOAL_ZONES = ("Frigate zones: error of side lengths, 95 %", "2 %", "1 %")

PARTS: Mapping[str, Part] = {
    "streams": Part(
        Heading("Streams", "Four films served by RTSP on loopback, begun up to 60 s apart, one cut three times, one clock off "
                "by 2 s, against the files."),
        [("streams: error, times that of the files", "1.3 x", "1.05 x"), ("streams: offsets", "50 ms", "15 ms")],
    ),
    "pieces": Part(
        Heading("Pieces of a recorder", "The films cut into pieces of 10 s in Frigate's layout, 5 % missing, one broken."),
        [("pieces: error, times that of the files", "1.3 x", "1.05 x")],
    ),
    "far": Part(
        Heading(
            "Starts far apart",
            f"Three recordings of {far.SECONDS / 60:g} minutes that begin up to {far.APART_S / 60:g} minutes apart, without "
            f"wall times; starts up to {far.SEARCHED_S / 60:g} minutes apart are searched. Simulated people come and go "
            f"(seeds from {far.FIRST_SEED}). A camera that stands elsewhere has to remain unknown. *time ratio*: search and "
            f"registration of all pairs, to that with starts within {far.NEAR_S:g} s; tracking, needed by both, is in neither.",
        ),
        GOALS_FAR, lambda _: far.cases(), far.measured, far_found,
    ),
    "sound": Part(
        Heading(
            "Sound",
            f"Two recordings of {sound.SECONDS[0]:g} to {sound.SECONDS[1]:g} s with delay, reverberation and noise; every "
            "second pair has nothing in common.",
        ),
        [GOAL_SOUND], lambda _: sound.cases(), sound.measured, sound_found,
    ),
    "containers": Part(
        Heading(
            "Containers and codecs",
            f"A rendered film ({containers.PRESET}, {containers.CAMERAS} cameras, {containers.SECONDS:g} s, "
            f"{containers.FPS:g} frames per second, seed {containers.SEED}) packed in twelve ways and calibrated from the "
            "videos without networks, with clocks that agree. *error*: positions and orientations after similarity alignment, "
            "mean over the cameras. *ratio*: of positions, to the plain MP4.",
        ),
        [GOAL_CONTAINERS], lambda _: containers.cases(SCENES), containers.work, containers_found,
    ),
    "watching": Part(
        Heading("Processing time", "Ten minutes of 4 x 1920 x 1080, the same detector, against an earlier version."),
        [("processing time, times that of the earlier version", "0.8 x", "0.5 x")],
    ),
    "zones": Part(
        Heading(
            "Zones for Frigate",
            f"Simulated scenes of {zones.SECONDS:g} s, boxes with {100 * zones.BOX_NOISE:g} % noise, identities and one "
            f"distance between two cameras known. {zones.ZONES} rectangles are drawn at random in the images of each rig, and "
            "the lengths of their sides on the ground are compared with the true ones.",
        ),
        [GOAL_ZONES], zones.cases, zones.work, zones_found,
    ),
}  # fmt: skip
"""In their order on the page."""
HEADINGS: Mapping[str, Heading] = {name: part.heading for name, part in PARTS.items()}
RUNNABLE = tuple(name for name, part in PARTS.items() if part.work is not None)


def run(scratch: Path, quick: bool, wanted: Wanted | None = None) -> Iterator[Page]:
    """The page after each finished case; one seed in a quick run."""
    del scratch
    wanted = wanted or Wanted(KEPT, RUNNABLE, SEEDS)
    count = 1 if quick else wanted.seeds
    return grown("sources", head, HEADINGS, partial(_part, wanted=wanted, count=count), wanted, CODE)


def _part(name: str, wanted: Wanted, count: int) -> Iterator[Found]:
    part = PARTS[name]
    assert part.cases is not None
    assert part.work is not None
    assert part.found_in is not None
    return finished(name, part.cases(count), part.work, part.found_in, wanted, CODE)


def head(sections: Sequence[Section]) -> str:
    """What stands above the parts: the goals."""
    goals: list[list[str]] = []
    for section in sections:
        unmet = [[text, "not run", acceptable, aim, ""] for text, acceptable, aim in PARTS[section.part].goals]
        goals += section.facts.get("goals", unmet)
    return f"{_HEAD}\n\n## Goals\n\n{table(('case', 'measured', 'acceptable', 'aim', 'reached'), goals)}"
