"""`docs/results/sources.md`: films as phones, recorders and streams give them against plain files, beside the goals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from datasets import ROOT
from pages.cases import Outcomes
from pages.page import Page, errors, number, reached, table
from pages.parts import Wanted, finished, grown
from pages.sections import Found, Heading, Section
from sources import containers, far, pieces, recorded_films, sound, streams, watching, zones

CODE = ("sources",)
"""Folders of the benchmarks that the outcomes depend on, beside the package; how they are shown is not among them."""
KEPT = ROOT / "build" / "sources"
SCENES = ROOT / "build" / "scenes"
SEEDS = 3
"""Of each preset, for the zones."""
QUICK_S = 40.0
"""Of the video of processing time in a quick run."""
FACTOR = 1.1
"""Of the plain film's error, up to which a packaging gives the same rig."""

_HEAD = """# Sources

Films in the containers, pieces and streams that people have, against the same films as plain MP4 files."""


@dataclass(frozen=True)
class Asked:
    """What the cases of the parts depend on."""

    seeds: int = SEEDS
    watched_s: float = watching.SECONDS
    """Length of the video of processing time."""
    against: str = watching.EARLIER
    """The version that it is compared with: a commit, a tag or a branch."""


@dataclass(frozen=True)
class Part:
    """A part of the page: a heading, its goals, its cases and what is said of them. Another one is one more line in `PARTS`."""

    heading: Heading
    goals: Sequence[tuple[str, str, str]]
    """Text, acceptable and aim; of a part that was not run they stand as not run."""
    cases: Callable[[Asked], Mapping[str, Any]]
    """By key."""
    work: Callable[[Any], Mapping[str, Any]]
    found_in: Callable[[str, Mapping[str, Any], Outcomes, str], Found]
    alone: bool = False
    """Whether its cases are run one after the other, since their time counts, or they take real time."""


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


def streams_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """The rig and the clock offsets of streams beside those of files."""
    del part
    plain, found = done.get(streams.FILES, {}), done.get(streams.STREAMS)
    rows = []
    for case in done.values():
        cameras = case.get("recording", {}).get("cameras", {})
        lost = [gap for camera in cameras.values() for gap in camera["gaps_s"]]
        clocks = ", ".join(sorted({camera["clock"] or "-" for camera in cameras.values()})) or "names"
        rows.append([
            *_rig_cells(case, plain), f"{number(case['offset_ms'], 0)} ms", clocks,
            f"{len(lost)} ({number(sum(lost), 1)} s)" if cameras else "-",
        ])  # fmt: skip
    columns = ("films", "result", "error", "ratio", "largest error of an offset", "wall times", "breaks (lost)")
    facts = {}
    if found is not None and plain:
        ratio, refused = _ratio(found, plain), int(found["verdict"] != "accepted")
        offset = found["offset_ms"]
        facts["goals"] = [
            [GOALS_STREAMS[0][0], f"{number(ratio, 2)} x, {found['verdict']}", *GOALS_STREAMS[0][1:],
             reached([ratio, refused], [1.3, 0], [1.05, 0])],
            [GOALS_STREAMS[1][0], f"{number(offset, 0)} ms", *GOALS_STREAMS[1][1:], reached([offset], [50.0], [15.0])],
        ]  # fmt: skip
    return Found(f"{_note(cases, done, code)}\n\n{table(columns, rows)}", facts)


def pieces_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """The rig of a recorder's pieces beside that of whole files, and which gaps were reported."""
    del part
    plain, found = done.get(pieces.FILES, {}), done.get(pieces.PIECES)
    rows, facts = [], {}
    for case in done.values():
        count = sum(pieces.gaps_of(case["lost"]).values()) if "lost" in case else None
        rows.append([*_rig_cells(case, plain), "-" if count is None else f"{pieces.reported_once(case)} of {count}"])
    if found is not None and plain:
        ratio, refused = _ratio(found, plain), int(found["verdict"] != "accepted")
        once, count = pieces.reported_once(found), sum(pieces.gaps_of(found["lost"]).values())
        facts["goals"] = [
            [GOALS_PIECES[0][0], f"{number(ratio, 2)} x, {found['verdict']}", *GOALS_PIECES[0][1:],
             reached([ratio, refused], [1.3, 0], [1.05, 0])],
            [GOALS_PIECES[1][0], f"{once} of {count}", *GOALS_PIECES[1][1:], reached([-once], [-count], [-count])],
        ]  # fmt: skip
    columns = ("films", "result", "error", "ratio", "gaps reported once")
    return Found(f"{_note(cases, done, code)}\n\n{table(columns, rows)}", facts)


def _rig_cells(case: Mapping[str, Any], plain: Mapping[str, Any]) -> list[str]:
    """What the films are, what came of them, the errors, and their ratio to those of the files."""
    said = f"{case['verdict']}, {case['registered']} cameras"
    return [case["about"]["text"], said, errors(case["mm"], case["deg"]), number(_ratio(case, plain), 2)]


def watching_found(part: str, cases: Mapping[str, Any], done: Outcomes, code: str) -> Found:
    """Processor time of this version beside that of an earlier one."""
    del part
    rows, ratios = [], {}
    for case in done.values():
        about, now, earlier = case["about"], case["now"], case["earlier"]
        ratios[about["detector"]] = watching.ratio(case)
        rows.append([
            about["detector"], f"{about['seconds']:g} s", str(now["pictures"]), f"{earlier['boxes']}, {now['boxes']}",
            f"{number(earlier['cpu_s'], 1)} s", f"{number(now['cpu_s'], 1)} s", number(watching.ratio(case), 2),
        ])  # fmt: skip
    columns = ("detector", "video", "frames looked at", "boxes, earlier and now", "earlier", "now", "ratio")
    against = next((case["about"]["against"] for case in done.values()), "")
    text = f"{_note(cases, done, code)} Earlier version: commit `{against[:10]}`.\n\n{table(columns, rows)}"
    said = ", ".join(f"{number(value, 2)} x ({name})" for name, value in ratios.items())
    reaches = reached(list(ratios.values()), [0.8] * len(ratios), [0.5] * len(ratios))
    whole = reaches if len(done) == len(cases) else f"{len(done)} of {len(cases)} run"
    return Found(text, {"goals": [[GOAL_WATCHING[0], said, *GOAL_WATCHING[1:], whole]]} if done else {})


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


GOALS_STREAMS = (
    ("streams: accepted, error, times that of the files", "1.3 x", "1.05 x"),
    ("streams: offsets", "50 ms", "15 ms"),
)
GOALS_PIECES = (
    ("pieces: accepted, error, times that of the files", "1.3 x", "1.05 x"),
    ("pieces: gaps that are reported once", "all", "all"),
)
GOAL_WATCHING = ("processing time, times that of an earlier version", "0.8 x", "0.5 x")
GOALS_FAR = (
    ("starts 20 minutes apart: found, of 10 scenes", "10", "10"),
    ("starts 20 minutes apart: time of search and registration, against +-5 s", "3 x", "1.5 x"),
)
GOAL_SOUND = ("sound: offset, or no answer, 50 of 50", "20 ms", "5 ms")
GOAL_CONTAINERS = ("containers and codecs with the rig of the plain MP4 (1.1 x), or one line why not", "all 12", "all 12")
GOAL_ZONES = ("Frigate zones: error of side lengths, 95 %", "2 %", "1 %")

PARTS: Mapping[str, Part] = {
    "streams": Part(
        Heading(
            "Streams",
            f"Rendered films of {recorded_films.CAMERAS} cameras ({containers.PRESET}, {recorded_films.SECONDS:g} s, "
            f"{containers.FPS:g} frames per second, seed {containers.SEED}), served by RTSP on loopback, recorded in real time "
            f"by `passerby record` and calibrated without networks. The cameras are switched on up to {streams.LATEST_S:g} s "
            f"apart; the connection of one breaks {len(streams.BREAKS)} times, and the clock of another is off by "
            f"{streams.CLOCK_OFF_S:g} s. *files*: what each camera films from when it is switched on, one file each, with its "
            "wall time in its name. *error*: positions and orientations after similarity alignment, mean over the cameras. "
            "*ratio*: of positions, to the files.",
        ),
        GOALS_STREAMS, lambda _: streams.cases(SCENES), streams.work, streams_found, alone=True,
    ),
    "pieces": Part(
        Heading(
            "Pieces of a recorder",
            f"The same films cut at key frames into pieces of {pieces.PIECE_S:g} s in Frigate's layout, "
            f"{100 * pieces.MISSING:g} % of them missing and one broken, against the whole films as one MP4 file each.",
        ),
        GOALS_PIECES, lambda _: pieces.cases(SCENES), pieces.work, pieces_found,
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
        Heading(
            "Processing time",
            "A video of 1920 x 1080 pixels with 25 frames per second and a key frame every "
            f"{watching.KEY_EVERY_S:g} s: 20 s of the construction site, repeated. Processor time of detecting people in it, "
            "without association and solving, by this version and by an earlier one, one after the other. Four cameras take "
            "four times as long.",
        ),
        [GOAL_WATCHING], lambda asked: watching.cases(SCENES, asked.watched_s, asked.against), watching.work, watching_found,
        alone=True,
    ),
    "zones": Part(
        Heading(
            "Zones for Frigate",
            f"Simulated scenes of {zones.SECONDS:g} s, boxes with {100 * zones.BOX_NOISE:g} % noise, identities and one "
            f"distance between two cameras known. {zones.ZONES} rectangles are drawn at random in the images of each rig, and "
            "the lengths of their sides on the ground are compared with the true ones.",
        ),
        [GOAL_ZONES], lambda asked: zones.cases(asked.seeds), zones.work, zones_found,
    ),
}  # fmt: skip
"""In their order on the page."""
HEADINGS: Mapping[str, Heading] = {name: part.heading for name, part in PARTS.items()}


def run(scratch: Path, quick: bool, wanted: Wanted | None = None, asked: Asked | None = None) -> Iterator[Page]:
    """The page after each finished case; one seed, and a short video, in a quick run."""
    del scratch
    wanted, asked = wanted or Wanted(KEPT, tuple(PARTS)), asked or Asked()
    asked = replace(asked, seeds=1, watched_s=min(asked.watched_s, QUICK_S)) if quick else asked
    return grown("sources", head, HEADINGS, partial(_part, wanted=wanted, asked=asked), wanted, CODE)


def _part(name: str, wanted: Wanted, asked: Asked) -> Iterator[Found]:
    part = PARTS[name]
    wanted = replace(wanted, workers=1) if part.alone else wanted
    return finished(name, part.cases(asked), part.work, part.found_in, wanted, CODE)


def head(sections: Sequence[Section]) -> str:
    """What stands above the parts: the goals."""
    goals: list[list[str]] = []
    for section in sections:
        unmet = [[text, "not run", acceptable, aim, ""] for text, acceptable, aim in PARTS[section.part].goals]
        goals += section.facts.get("goals", unmet)
    return f"{_HEAD}\n\n## Goals\n\n{table(('case', 'measured', 'acceptable', 'aim', 'reached'), goals)}"
