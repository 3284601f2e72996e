"""Faults of the machine: each command killed or out of disk at any change of a file; the program disturbed from outside."""

from __future__ import annotations

import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pages.kept import code_behind, code_digest
from pages.records import Found
from pages.tables import table
from reliability.disturbed import DISTURBANCES, SkippedError, calibration, program
from reliability.machine import Fault
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept
from reliability.writers import WRITERS, Writer, fate, make, undisturbed

SEED = 100_000
CHUNK = 8
"""Faults of one case: what it begins with is made once for them."""
REPEATED = 4
"""Out of disk the command is run once more after every so many faults; killed, after each."""
SPARSE = {"calibrate videos": 8, "calibrate with report": 6}
"""Writers that take long: so many faults, evenly spread."""
TITLES = {
    "kill": "killed (SIGKILL) at every change of a file",
    "full": "disk full from any change of a file on",
    "killed": "killed at any time, with all its processes",
    "small_disk": "a disk of a few kilobytes",
    "small_files": "files break off in the middle",
    "read_only": "a folder that may not be written",
    "two": "another command in the same folder",
    "clock": "a clock that jumps, files of the future",
    "bit_rot": "a bit of every kept file is wrong",
    "wrong_result": "a bit of the rig or of a track is wrong",
    "another_video": "a video replaced, size and times the same",
    "full_output": "standard output takes no more",
}


@dataclass(frozen=True)
class Chunk:
    """Faults of one kind in one command."""

    made: Path
    writer: Writer
    fault: Fault
    moments: tuple[int, ...]


@dataclass(frozen=True)
class Disturbed:
    """One disturbance from outside."""

    made: Path
    kind: str
    value: Any


def run(wanted: Wanted) -> Found:
    """All faults, and what became of them."""
    made = _made(wanted)
    cases = _cases(wanted, made)
    results = kept(wanted, "faults", cases, work)
    return _part(cases, results)


def work(case: Chunk | Disturbed) -> Mapping[str, Any]:
    """Faults injected, those that were not survived, with what is wrong, and whether the machine let them be made."""
    if isinstance(case, Disturbed):
        try:
            wrong = DISTURBANCES[case.kind](case.made, case.value)
        except SkippedError as reason:
            return {"injected": 0, "wrong": {}, "skipped": str(reason)}
        return {"injected": 1, "wrong": {str(case.value): wrong} if wrong else {}}
    _, before, after = undisturbed(case.writer, case.made)
    found = {}
    for at in case.moments:
        repeat = case.fault == "kill" or at % REPEATED == 0
        wrong = fate(case.writer, case.made, case.fault, at, before, after, repeat=repeat)
        if wrong:
            found[str(at)] = wrong
    return {"injected": len(case.moments), "wrong": found}


def _made(wanted: Wanted) -> Path:
    """The scenes and what is known of them, made once for this code."""
    made = wanted.kept.resolve() / "faults-scenes"
    mark = made / "code"
    if mark.is_file() and mark.read_text() == code_digest(*code_behind(__name__)):
        return made
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    make(made)
    began = time.monotonic()
    ended = program(calibration(made, made / "watched"))
    if ended.returncode not in (0, 3):
        raise RuntimeError(ended.stderr)
    (made / "seconds").write_text(f"{time.monotonic() - began:.2f}")
    (made / "events").mkdir()
    for writer in WRITERS:
        (made / "events" / writer.name).write_text(str(undisturbed(writer, made)[0].events))
    mark.write_text(code_digest(*code_behind(__name__)))
    return made


def _cases(wanted: Wanted, made: Path) -> dict[str, Chunk | Disturbed]:
    """All cases by key."""
    cases: dict[str, Chunk | Disturbed] = {}
    for writer in WRITERS:
        events = int((made / "events" / writer.name).read_text())
        count = min(events, 2 if wanted.quick else SPARSE.get(writer.name, events))
        moments = np.unique(np.linspace(1, events, count).round().astype(int)).tolist()
        for fault in ("kill", "full"):
            for first in range(0, len(moments), CHUNK):
                chunk = tuple(moments[first : first + CHUNK])
                cases[f"{writer.name}, {fault} {chunk[0]} to {chunk[-1]}"] = Chunk(made, writer, fault, chunk)
    rng = np.random.default_rng(SEED)
    few = 1 if wanted.quick else None
    values: Mapping[str, list[Any]] = {
        "killed": rng.uniform(0.1, 1.05, 8).round(3).tolist(),
        "small_disk": [8, 32, 100, 200],
        "small_files": [0, 300, 3000],
        "read_only": ["calibrate", "report", "track", "align", "export"],
        "two": ["calibrate", "report", "align"],
        "clock": ["jumps", "from nothing", "future", "past"],
        "bit_rot": [SEED, SEED + 1],
        "wrong_result": [SEED, SEED + 1],
        "another_video": [SEED],
        "full_output": ["formats", "json"],
    }
    for kind, options in values.items():
        for value in options[:few]:
            cases[f"{kind} {value}"] = Disturbed(made, kind, value)
    return cases


def _part(cases: Mapping[str, Chunk | Disturbed], results: Mapping[str, Mapping[str, Any]]) -> Found:
    """The table of kinds, and what went wrong."""
    injected: Counter[str] = Counter()
    lost: Counter[str] = Counter()
    skipped: dict[str, str] = {}
    by_writer: defaultdict[str, Counter[str]] = defaultdict(Counter)
    wrong = []
    for key, case in cases.items():
        result, kind = results[key], case.fault if isinstance(case, Chunk) else case.kind
        injected[kind] += result["injected"]
        lost[kind] += len(result["wrong"])
        wrong += [f"- {key}, {at}: {'; '.join(told)}" for at, told in result["wrong"].items()]
        if "skipped" in result:
            skipped[kind] = result["skipped"]
        if isinstance(case, Chunk):
            by_writer[case.writer.name][kind] += result["injected"]
    total, survived = injected.total(), injected.total() - lost.total()
    kinds = [
        (title, str(injected[kind]), str(injected[kind] - lost[kind]) if injected[kind] else skipped.get(kind, "none"))
        for kind, title in TITLES.items()
    ]
    writers = [(name, str(counts["kill"]), str(counts["full"])) for name, counts in by_writer.items()]
    tables = {
        "Faults": table(("fault", "injected", "survived"), kinds),
        "Commands": table(("command", "killed", "disk full"), writers),
    }
    line = Line("faults of the machine: survived", f"{survived} of {total}", "all", survived == total)
    return part_found((line,), tables, ["Not survived:\n\n" + "\n".join(wrong)] if wrong else [])
