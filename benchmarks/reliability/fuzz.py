"""Damaged, lying and malicious files for every reader: the marked tests, run and counted."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from pages.kept import code_behind, code_digest
from pages.page import table
from pages.sections import Found
from reliability.page import Line, part_found
from reliability.runs import ROOT, Wanted

CASES, QUICK_CASES = 10_000, 60
LONGEST_S = 3600
COUNTS = ("cases", "read", "refused", "faults")

TEXT = """\
Every file reader was tested with valid files that were damaged in one to three ways: bytes flipped or set to the
largest number; ends cut off; spans removed, duplicated or moved; numbers and words replaced (by NaN,
infinities, 1e308, -1, numbers of thirty to five thousand digits, nothing, thousands of brackets, control characters,
text of HTML and shells); values of JSON, TOML and YAML moved or replaced by others of every type; lines duplicated and
removed; other encodings and line endings; or the whole file replaced by noise. *Read*: the file gave a valid value of
its type. *Refused*: an error that names the file, in one line that shows little of its content.
Anything else is a fault: another exception, a crash of the process, a case that does not end. The cases are the same
in every run.

{readers}

In addition, {bombs} checks of untrusted files passed and {failed} failed. Files of some kilobytes that declare 10⁹ rows,
pixels or tables, or expand to gigabytes, are read in a process limited to 768 MB. Pickled objects, YAML tags, XML
entities, networks with tables in other files, and playlists run nothing and open no other file. Pipes, devices, folders
and loops of links are refused wherever a scene file names a file. Names of cameras remain text, and stay
inside the folder, in every format that is written.

Which files may be read: a scene file may name any file that the user may read, with an absolute path or
above its own folder, because recordings are stored where there is space. The file is opened only for its purpose, with
the user's own rights, and its content is not shown. Nothing is written outside the output folder. An ONNX network
remains a program of arithmetic: one that is built to take much time or memory does so.
"""


def run(wanted: Wanted) -> Found:
    """Run the marked tests, and those of untrusted files."""
    cases = QUICK_CASES if wanted.quick else int(os.environ.get("PASSERBY_FUZZ_CASES", CASES))
    kept = _records(wanted, cases)
    status = _tests(wanted, "tests/interchange/untrusted/test_readers.py", ["-m", "fuzz"], cases, kept)
    records = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(kept.glob("*.json"))]
    with TemporaryDirectory() as folder:
        report = Path(folder) / "untrusted.xml"
        _tests(wanted, "tests/interchange/untrusted/test_untrusted.py", [f"--junitxml={report}"], cases, Path(folder))
        checks, failed = counted(report)
    faults = sum(record.get("faults", 0) for record in records)
    whole = [record for record in records if record["share"] == 1.0]
    least = min((record.get("cases", 0) for record in whole), default=0)
    sound = status == 0 and faults == 0
    lines = [
        Line(
            "damaged files, readers without a fault",
            f"{sum(not record.get('faults') for record in records)} of {len(records)}",
            "all",
            sound and bool(records),
        ),
        Line(f"cases for each of {len(whole)} readers, fewest", f"{least:,}", f"{CASES:,}", least >= CASES),
        Line("checks of untrusted files", f"{checks - failed} of {checks}", "all", failed == 0 and checks > 0),
    ]
    rows = [(record["reader"], *(f"{record.get(key, 0):,}" for key in COUNTS)) for record in records]
    rows.append(("**all**", *(f"{sum(record.get(key, 0) for record in records):,}" for key in COUNTS)))
    readers = table(("reader", *COUNTS), rows)
    return part_found(lines, TEXT.format(readers=readers, bombs=checks - failed, failed=failed), quick=wanted.quick)


def _records(wanted: Wanted, cases: int) -> Path:
    """The folder in which each reader's count is kept as soon as it is there, of this code, these tests and so many cases."""
    digest = hashlib.sha256(f"{code_digest(*code_behind(__name__))} {cases}".encode())
    for path in sorted((ROOT / "tests/interchange/untrusted").glob("*.py")):
        digest.update(path.read_bytes())
    folder = wanted.kept / f"fuzz-{digest.hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _tests(wanted: Wanted, path: str, options: list[str], cases: int, records: Path) -> int:
    """Run tests in a process of their own, whose crash is not this one's; its exit status."""
    environment = os.environ | {
        "PASSERBY_FUZZ_CASES": str(cases), "PASSERBY_FUZZ_RECORDS": str(records), "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    command = [sys.executable, "-m", "pytest", "-n", str(wanted.workers), "--dist=worksteal", "-p", "no:cacheprovider", path]
    done = subprocess.run([*command, *options], cwd=ROOT, env=environment, stdout=sys.stderr, timeout=LONGEST_S, check=False)
    return done.returncode


def counted(report: Path) -> tuple[int, int]:
    """How many tests ran, and how many of them failed; (0, 0) where the run did not end."""
    from xml.etree import ElementTree

    if not report.is_file():
        return 0, 0
    suites = ElementTree.parse(report).getroot().iter("testsuite")
    counts = [{key: int(suite.get(key, "0")) for key in ("tests", "failures", "errors", "skipped")} for suite in suites]
    failed = sum(count["failures"] + count["errors"] for count in counts)
    return sum(count["tests"] - count["skipped"] for count in counts), failed
