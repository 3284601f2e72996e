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
from pages.records import Found
from pages.tables import table
from reliability.page import Line, part_found
from reliability.runs import ROOT, Wanted

CASES, QUICK_CASES = 10_000, 60
LONGEST_S = 3600
COUNTS = ("cases", "read", "refused", "faults")


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
    return part_found(lines, {"Readers": readers}, [f"{checks - failed} checks of untrusted files passed and {failed} failed."])


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
