"""Runs the `passerby` command as a user does, in a process of its own, with its wall time and its peak memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ACCEPTED, DOUBTFUL = 0, 3
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""For runs that share the machine with one another; runs whose time counts get the user's own environment."""


@dataclass(frozen=True)
class Run:
    """One finished process."""

    output: str
    status: int
    """Exit status: `ACCEPTED` or `DOUBTFUL`."""
    seconds: float
    """Wall time of the whole process, start of Python included."""
    cpu_seconds: float
    """Processor time, that of the processes that it started included."""
    peak_mb: float
    """Largest resident memory, 10^6 bytes. No less than this process's own: Linux counts a child from before its `exec`."""


@dataclass(frozen=True)
class Calibrated:
    """One `passerby calibrate` and what `passerby evaluate` says of it."""

    verdict: str
    scale_sigma: float | None
    """The stated sigma of the scale, as a fraction."""
    errors: dict[str, Any] | None
    """`evaluate --json`; None where no camera was registered."""
    cameras: int
    """Cameras of the scene."""
    status: int
    """Exit status of `passerby calibrate`."""
    report: dict[str, Any]
    """`calibration.json`."""
    seconds: float
    peak_mb: float
    cpu_seconds: float = float("nan")


def run_program(arguments: Sequence[str], environment: dict[str, str] | None = None) -> Run:
    """Run a Python program with this interpreter. Raises `RuntimeError` for an exit status other than 0 and 3."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        began = time.perf_counter()
        child = subprocess.Popen(
            [sys.executable, *arguments],
            stdout=out,
            stderr=err,
            stdin=subprocess.DEVNULL,
            env={**os.environ, **(environment or {})},
        )
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - began
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        if child.returncode not in (ACCEPTED, DOUBTFUL):
            raise RuntimeError(f"{' '.join(arguments)}: exit status {child.returncode}: {err.read().strip()[-2000:]}")
        cpu_seconds = usage.ru_utime + usage.ru_stime
        return Run(out.read(), child.returncode, seconds, cpu_seconds, usage.ru_maxrss * 1024 / 1e6)


def passerby(*arguments: str, environment: dict[str, str] | None = None) -> Run:
    """Run one `passerby` command."""
    return run_program(["-m", "passerby", *arguments], environment)


def calibrate(scene: Path, truth: Path, out: Path, environment: dict[str, str] | None = None) -> Calibrated:
    """`passerby calibrate scene -o out`, then `passerby evaluate out/rig.toml truth --json`."""
    # Nobody looks at the pages; peers draw none either.
    told = passerby("calibrate", str(scene), "-o", str(out), "--no-report", environment=environment)
    return judge(out, truth, told, environment)


def judge(out: Path, truth: Path, run: Run, environment: dict[str, str] | None = None) -> Calibrated:
    """What a run has written into `out`, against the truth."""
    result = json.loads((out / "calibration.json").read_text())
    errors = None
    if any(camera["registered"] for camera in result["cameras"]):
        errors = json.loads(passerby("evaluate", str(out / "rig.toml"), str(truth), "--json", environment=environment).output)
    scale = result["figures"].get("scale") or {}
    return Calibrated(
        verdict=result["verdict"],
        scale_sigma=scale.get("relative_sigma"),
        errors=errors,
        cameras=len(result["cameras"]),
        status=run.status,
        report=result,
        seconds=run.seconds,
        peak_mb=run.peak_mb,
        cpu_seconds=run.cpu_seconds,
    )
