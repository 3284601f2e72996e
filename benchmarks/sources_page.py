"""`docs/results/sources.md`: films as phones, recorders and streams give them against plain files, beside the goals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from datasets import ROOT
from goals import goal_row
from pages.cases import Outcomes
from pages.parts import Cases, Part, PartedPage, found_of
from pages.records import Found
from pages.tables import errors, number, reached, table
from sources import containers, far, pieces, sound, streams, watching, zones

CODE = ("sources",)
"""Folders of the benchmarks that the outcomes depend on, beside the package; how they are shown is not among them."""
KEPT = ROOT / "build" / "sources"
SCENES = ROOT / "build" / "scenes"
SEEDS = 3  # of each preset, for the zones
QUICK_S = 40.0  # of the video of processing time in a quick run
FACTOR = 1.1  # of the plain film's error, up to which a packaging gives the same rig


CONTAINERS = "containers and codecs with the rig of the plain MP4 (1.1 x), or one line why not"


def tabulate_containers(cases: Cases, done: Outcomes) -> Found:
    """The rig of each packaging beside that of the plain film."""
    plain = done.get("plain", {})
    rows, same = [], 0
    for key, case in done.items():
        ratio = _ratio(case, plain)
        same += key != "plain" and (case.get("unsupported") is not None or ratio <= FACTOR)
        said = case.get("unsupported") or f"{case['verdict']}, {case['registered']} cameras"
        rows.append([case["about"]["text"], said, errors(case["mm"], case["deg"]), number(ratio, 2)])
    count = len(cases) - 1
    verdict = reached([-same], [-count], [-count]) if len(done) == len(cases) else f"{len(done)} of {len(cases)} run"
    goal = [CONTAINERS, f"{same} of {count}", "all 12", "all 12", verdict]
    return found_of(cases, done, {"Result": table(("container and codec", "result", "error", "ratio"), rows)}, [goal])


def _ratio(case: Mapping[str, Any], plain: Mapping[str, Any]) -> float:
    """The error of positions over that of the plain film."""
    if case.get("mm") is None or not plain.get("mm"):
        return math.inf
    return float(case["mm"] / plain["mm"])


def tabulate_streams(cases: Cases, done: Outcomes) -> Found:
    """The rig and the clock offsets of streams beside those of files."""
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
    goals = []
    if found is not None and plain:
        ratio, refused = _ratio(found, plain), int(found["verdict"] != "accepted")
        offset = found["offset_ms"]
        goals = [
            goal_row("streams: accepted, error, times that of the files", ("1.3 x", "1.05 x"),
                     f"{number(ratio, 2)} x, {found['verdict']}", [ratio, refused], [1.3, 0], [1.05, 0]),
            goal_row("streams: offsets", ("50 ms", "15 ms"), f"{number(offset, 0)} ms", [offset], [50.0], [15.0]),
        ]  # fmt: skip
    return found_of(cases, done, {"Result": table(columns, rows)}, goals)


def tabulate_pieces(cases: Cases, done: Outcomes) -> Found:
    """The rig of a recorder's pieces beside that of whole files, and which gaps were reported."""
    plain, found = done.get(pieces.FILES, {}), done.get(pieces.PIECES)
    rows: list[list[str]] = []
    goals = []
    for case in done.values():
        count = sum(pieces.gaps_of(case["lost"]).values()) if "lost" in case else None
        rows.append([*_rig_cells(case, plain), "-" if count is None else f"{pieces.reported_once(case)} of {count}"])
    if found is not None and plain:
        ratio, refused = _ratio(found, plain), int(found["verdict"] != "accepted")
        once, count = pieces.reported_once(found), sum(pieces.gaps_of(found["lost"]).values())
        goals = [
            goal_row("pieces: accepted, error, times that of the files", ("1.3 x", "1.05 x"),
                     f"{number(ratio, 2)} x, {found['verdict']}", [ratio, refused], [1.3, 0], [1.05, 0]),
            goal_row("pieces: gaps that are reported once", ("all", "all"), f"{once} of {count}", [-once], [-count], [-count]),
        ]  # fmt: skip
    columns = ("films", "result", "error", "ratio", "gaps reported once")
    return found_of(cases, done, {"Result": table(columns, rows)}, goals)


def _rig_cells(case: Mapping[str, Any], plain: Mapping[str, Any]) -> list[str]:
    """What the films are, what came of them, the errors, and their ratio to those of the files."""
    said = f"{case['verdict']}, {case['registered']} cameras"
    return [case["about"]["text"], said, errors(case["mm"], case["deg"]), number(_ratio(case, plain), 2)]


def tabulate_watching(cases: Cases, done: Outcomes) -> Found:
    """Processor time of this version beside that of an earlier one."""
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
    said = ", ".join(f"{number(value, 2)} x ({name})" for name, value in ratios.items())
    reaches = reached(list(ratios.values()), [0.8] * len(ratios), [0.5] * len(ratios))
    whole = reaches if len(done) == len(cases) else f"{len(done)} of {len(cases)} run"
    goals = [["processing time, times that of an earlier version", said, "0.8 x", "0.5 x", whole]] if done else []
    return found_of(cases, done, {"Result": table(columns, rows)}, goals, [f"Earlier version: commit `{against[:10]}`."])


def tabulate_zones(cases: Cases, done: Outcomes) -> Found:
    """How far the sides of zones are off."""
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
    text = "Frigate zones: error of side lengths, 95 %"
    goals = [goal_row(text, ("2 %", "1 %"), f"{number(value, 2)} % ({len(off) // 4} zones)", [value], [2.0], [1.0])]
    columns = ("preset", "rigs", "zones", "error of a side, median", "95 %", "within 2 %")
    return found_of(cases, done, {"Result": table(columns, rows)}, goals)


def tabulate_far(cases: Cases, done: Outcomes) -> Found:
    """Which starts were found, and what the search takes."""
    rows = []
    for kind in dict.fromkeys(case["about"]["kind"] for case in done.values()):
        some = [case for case in done.values() if case["about"]["kind"] == kind]
        off = [abs(error) for case in some for error in case["errors_s"] if error is not None]
        found, wrong = (sum(case[key] for case in some) for key in ("found", "wrong"))
        worst = f"{number(1000 * max(off), 0)} ms" if off else "-"
        rows.append([kind, str(len(some)), str(found), str(wrong), worst, f"{number(_time_ratio(some), 2)} x"])
    first = [case for case in done.values() if case["about"]["kind"] == far.UNKNOWN]
    found, wrong = (sum(case[key] for case in first) for key in ("found", "wrong"))
    ratio = _time_ratio(first) if first else None
    whole = reached([-found, wrong], [-far.SCENES, 0], [-far.SCENES, 0]) if len(first) == far.SCENES else "running"
    goals = [
        ["starts 20 minutes apart: found, of 10 scenes", f"{found} of {len(first)}, {wrong} wrong", "10", "10", whole],
        goal_row("starts 20 minutes apart: time of search and registration, against +-5 s", ("3 x", "1.5 x"),
                 f"{number(ratio, 2)} x", [ratio], [3.0], [1.5]),
    ]  # fmt: skip
    columns = ("scenes", "number", "found", "wrong", "largest error of a start", "time ratio")
    return found_of(cases, done, {"Result": table(columns, rows)}, goals)


def _time_ratio(some: Sequence[Mapping[str, Any]]) -> float:
    return sum(case["far_s"] for case in some) / max(sum(case["near_s"] for case in some), 1e-9)


def tabulate_sound(cases: Cases, done: Outcomes) -> Found:
    """How many pairs get an answer, and how far it is off."""
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
    goal = ["sound: offset, or no answer, 50 of 50", said, "20 ms", "5 ms", verdict]
    head = ("heard", "pairs", "answers", "error, median", "largest")
    return found_of(cases, done, {"Result": table(head, rows)}, [goal])


def page(watched_s: float = watching.SECONDS, against: str = watching.EARLIER) -> PartedPage:
    """The page; processor time is that of a video of so many seconds, compared with another version (commit, tag or branch)."""
    parts = {
        "streams": Part(lambda _: streams.cases(SCENES), streams.work, tabulate_streams, alone=True),
        "pieces": Part(lambda _: pieces.cases(SCENES), pieces.work, tabulate_pieces),
        "far": Part(lambda _: far.cases(), far.work, tabulate_far),
        "sound": Part(lambda _: sound.cases(), sound.measured, tabulate_sound),
        "containers": Part(lambda _: containers.cases(SCENES), containers.work, tabulate_containers),
        "watching": Part(lambda _: watching.cases(SCENES, watched_s, against), watching.work, tabulate_watching, alone=True),
        "zones": Part(zones.cases, zones.work, tabulate_zones),
    }
    return PartedPage("sources", parts, CODE, KEPT, SEEDS)
