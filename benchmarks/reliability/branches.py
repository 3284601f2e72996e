"""Which branches of the code that judges, tells and writes run in the tests: the tests under coverage, and what they miss."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from pages.kept import code_digest
from pages.records import Found
from pages.tables import table
from reliability.fuzz import counted
from reliability.page import Line, part_found
from reliability.runs import ROOT, Wanted, kept, percent

GOAL_PERCENT = 95.0
LONGEST_S = 4 * 3600
PACKAGE = "src/passerby"
GROUPS: Mapping[str, Sequence[str]] = MappingProxyType({
    "verdict": (
        "association/registration_failures.py", "calibration/calibration.py", "calibration/diagnostics/*.py",
        "calibration/held_out.py", "calibration/prediction.py", "calibration/rig_comparison.py",
        "hypotheses/*.py", "solver/cue_agreement.py", "solver/findings.py", "core/solution.py",
    ),
    "findings": ("findings/**/*.py",),
    "writers": (
        "calibration/alignment/folder.py", "calibration/kept_tracklets.py", "calibration/writing.py",
        "datasets/scene_folder.py", "interchange/**/*.py", "monitoring/result.py", "page/plan_pictures.py",
        "page/scene_edits.py",
        "perception/fetching.py", "perception/kept.py", "perception/model_files.py", "recording/pieces.py",
        "recording/scene_streams.py", "report/page.py", "report/parts.py",
        "scene/start/*.py", "simulation/sites/site.py", "simulation/write.py",
    ),
})  # fmt: skip
"""Group -> its files, as patterns below the package."""
FOLDERS = (
    "api", "association", "calibration", "cli", "common", "core", "datasets", "evaluation", "findings", "interchange",
    "monitoring", "page", "perception", "recording", "report", "scene", "simulation", "solver",
)  # fmt: skip
"""Of the tests that are run; the others are of mathematics, of trainings and of the benchmarks."""
SETTINGS = """\
[run]
branch = true
source = passerby
parallel = true
concurrency = multiprocessing,thread
data_file = {folder}/data
"""


@dataclass(frozen=True)
class Job:
    """Tests that run in one process."""

    folder: str
    """Below `tests`."""
    slow: bool


@dataclass(frozen=True)
class Covered:
    """What of a file, or of several, ran."""

    n: int
    """Lines and branches that there are."""
    n_covered: int
    missed: str = ""
    """Lines that did not run, and branches that were not taken, as text."""

    @property
    def is_enough(self) -> bool:
        """Whether the goal is reached."""
        return 100 * self.n_covered >= GOAL_PERCENT * self.n

    @classmethod
    def together(cls, parts: Iterable[Covered]) -> Covered:
        """Of several files."""
        listed = list(parts)
        return cls(sum(part.n for part in listed), sum(part.n_covered for part in listed))


def run(wanted: Wanted, folders: Sequence[str] = FOLDERS) -> Found:
    """Run the tests of some folders under coverage, the slow ones too unless the run is a quick one."""
    jobs = [Job(folder, slow) for slow in (False, True)[: 1 if wanted.quick else 2] for folder in folders]
    tests = code_digest("../tests")[:16]  # other tests cover other branches
    cases = {f"{job.folder} {'slow' if job.slow else 'quick'} {tests}": job for job in jobs}
    return _part(list(kept(wanted, "branches", cases, work).values()), folders)


def work(job: Job) -> Mapping[str, Any]:
    """The tests of one folder in a process of their own: how many ran and failed, and what ran of each group's files."""
    with TemporaryDirectory() as made:
        settings, report, out = (Path(made) / name for name in ("settings", "tests.xml", "coverage.json"))
        settings.write_text(SETTINGS.format(folder=made), encoding="utf-8")
        chosen = ["-m", "slow" if job.slow else "not slow", "-p", "no:cacheprovider", f"--junitxml={report}"]
        _coverage(settings, "run", "-m", "pytest", *chosen, f"tests/{job.folder}")
        _coverage(settings, "combine", "--quiet")
        _coverage(settings, "json", "--quiet", "-o", str(out), f"--include={','.join(_files())}")
        tests, failed = counted(report)
        found = json.loads(out.read_text(encoding="utf-8"))["files"] if out.is_file() else {}
    keys = ("executed_lines", "missing_lines", "executed_branches", "missing_branches")
    files = {path: {key: counts[key] for key in keys} for path, counts in sorted(found.items())}
    return {"tests": tests, "failed": failed, "files": files}


def covered(outcomes: Sequence[Mapping[str, Any]], path: str) -> Covered:
    """What of a file ran in any of the runs; a file that no run tells of counts as one line that did not run."""
    seen = [outcome["files"][path] for outcome in outcomes if path in outcome["files"]]
    ran = {line for one in seen for line in one["executed_lines"]}
    lines = {line for one in seen for line in one["missing_lines"]} - ran
    taken = {tuple(branch) for one in seen for branch in one["executed_branches"]}
    branches = {tuple(branch) for one in seen for branch in one["missing_branches"]} - taken
    if not seen:
        return Covered(1, 0, "all")
    # A branch to a line that did not run says nothing more.
    left = [f"{start} to {end if end > 0 else 'the end'}" for start, end in sorted(branches) if end not in lines]
    return Covered(len(ran | lines) + len(taken | branches), len(ran) + len(taken), ", ".join([*_spans(lines), *left]))


def _coverage(settings: Path, command: str, *arguments: str) -> None:
    """Run a command of coverage; what it says, and the tests, go to standard error."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    options = [sys.executable, "-m", "coverage", command, f"--rcfile={settings}", *arguments]
    subprocess.run(options, cwd=ROOT, env=environment, stdout=sys.stderr, timeout=LONGEST_S, check=False)


def _files(group: str | None = None) -> list[str]:
    """The files of a group, or of all, as coverage names them."""
    patterns = [pattern for name, listed in GROUPS.items() if group in (None, name) for pattern in listed]
    found = {path for pattern in patterns for path in (ROOT / PACKAGE).glob(pattern)}
    return sorted(path.relative_to(ROOT).as_posix() for path in found)


def _part(outcomes: Sequence[Mapping[str, Any]], folders: Sequence[str]) -> Found:
    """The table of groups, and the files below the goal."""
    by_file = {path: covered(outcomes, path) for path in _files()}
    groups = {group: Covered.together(by_file[path] for path in _files(group)) for group in GROUPS}
    goal = f"{GOAL_PERCENT:g} %"
    lines, rows = [], []
    for group, one in groups.items():
        share = percent(one.n_covered, one.n)
        lines.append(Line(f"branch coverage: {group}", share, goal, one.is_enough))
        rows.append((group, str(len(_files(group))), f"{one.n_covered:,} of {one.n:,}", share, goal))
    below = {path: one for path, one in by_file.items() if not one.is_enough}
    told = [(f"`{path.removeprefix(PACKAGE + '/')}`", percent(one.n_covered, one.n), one.missed) for path, one in below.items()]
    failed, tests = (sum(outcome[key] for outcome in outcomes) for key in ("failed", "tests"))
    tables = {"Groups": table(("group", "files", "lines and branches covered", "percent", "goal"), rows)}
    if below:
        tables["Below the goal"] = table(("file", "covered", "lines and branches that no test runs"), told)
    run = f"{tests:,} tests of {', '.join(folders)}{f'; **{failed} of them failed**' if failed else ''}"
    return part_found(lines, tables, [] if below else [f"No file is below {goal}."], run)


def _spans(lines: Iterable[int]) -> list[str]:
    """Numbers in order, those that follow each other as one."""
    spans: list[list[int]] = []
    for line in sorted(lines):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    return [str(first) if first == last else f"{first}-{last}" for first, last in spans]
