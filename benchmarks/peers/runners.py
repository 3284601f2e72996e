"""Starts one engine in a fresh process, in its own environment, on one thread, for a limited time."""

from __future__ import annotations

import contextlib
import json
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from datasets import ROOT
from passerby.core.cameras import Pose

HERE = Path(__file__).resolve().parent
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1")
PATIENCE = 10  # a process that sleeps is stopped after this many times its limit by the clock


@dataclass(frozen=True)
class Engine:
    """A program that finds camera poses."""

    name: str
    script: str  # runner beside this module
    environment: str | None = None  # folder `.venv-peer-NAME` of its interpreter; None: the one that runs this
    option: str = ""
    one_person_only: bool = False

    def interpreter(self) -> Path | None:
        """Its Python; None where the environment was not made."""
        if self.environment is None:
            return Path(sys.executable)
        home = Path(os.environ["PASSERBY_PEERS"]) if os.environ.get("PASSERBY_PEERS") else ROOT
        python = home / f".venv-peer-{self.environment}" / "bin" / "python"
        return python if python.is_file() else None


PASSERBY = Engine("Passerby", "passerby_runner.py")
CALISCOPE = Engine("caliscope", "caliscope_runner.py", "caliscope")
PEERS = (
    CALISCOPE, Engine("COLMAP", "colmap_runner.py", "colmap"), Engine("COLMAP x3", "colmap_runner.py", "colmap", option="wide"),
    Engine("GLOMAP", "colmap_runner.py", "colmap", option="global"),
    Engine("humancalib BA", "humancalib_runner.py", "humancalib", one_person_only=True),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one run came to."""

    poses: dict[str, Pose] = field(default_factory=dict)
    failure: str | None = None  # why there is no result: timed out, or what the engine said
    solve_seconds: float = float("nan")  # processor seconds of the solver, its imports left out
    whole_seconds: float = float("nan")  # processor seconds of the whole process, start of Python and imports included
    peak_mb: float = float("nan")
    version: str = ""


def run_engine(engine: Engine, source: Path, target: Path, limit_s: float) -> Outcome:
    """Run an engine on a file. The result is a failure where it breaks, writes nothing, or needs more than
    `limit_s` seconds of processor time.

    Raises `FileNotFoundError` where the engine's environment was not made.
    """
    python = engine.interpreter()
    if python is None:
        raise FileNotFoundError(f".venv-peer-{engine.environment}")
    target.unlink(missing_ok=True)
    command = [str(python), str(HERE / engine.script), str(source), str(target), *([engine.option] if engine.option else [])]
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=said, stdin=subprocess.DEVNULL, env={**os.environ, **ONE_THREAD},
            start_new_session=True,
        )  # fmt: skip
        seconds = _wait(child, limit_s)
        if seconds is None:
            return Outcome(failure=f"timed out ({limit_s:g} s)", whole_seconds=limit_s)
        if child.returncode != 0 or not target.is_file():
            said.seek(0)
            last = (said.read().strip().splitlines() or ["no word"])[-1]
            return Outcome(failure=f"broke: exit status {child.returncode}: {last[:200]}", whole_seconds=seconds)
    return _outcome(target, seconds)


def _wait(child: subprocess.Popen[bytes], limit_s: float) -> float | None:
    """Processor seconds of a process until its end; None where it had to be stopped."""
    if hasattr(resource, "prlimit"):  # Linux; elsewhere the clock alone stops it
        with contextlib.suppress(ProcessLookupError):
            resource.prlimit(child.pid, resource.RLIMIT_CPU, (math.ceil(limit_s), math.ceil(limit_s)))
    patience = time.monotonic() + PATIENCE * limit_s
    while True:
        ended, status, usage = os.wait4(child.pid, os.WNOHANG)
        if ended:
            break
        if time.monotonic() > patience:
            os.killpg(child.pid, signal.SIGKILL)
            patience = math.inf
        time.sleep(0.02)
    child.returncode = os.waitstatus_to_exitcode(status)
    stopped = child.returncode in (-signal.SIGKILL, -signal.SIGXCPU)
    return None if stopped else usage.ru_utime + usage.ru_stime


def _outcome(target: Path, seconds: float) -> Outcome:
    """What the runner wrote."""
    made = json.loads(target.read_text())
    poses, failure = {}, made["failure"]
    for name, pose in made["poses"].items():
        R, t = np.array(pose["R"], dtype=float), np.array(pose["t"], dtype=float)
        if not (np.isfinite(R).all() and np.isfinite(t).all()):
            failure = failure or f"poses that are no numbers ({name})"
            continue
        poses[name] = Pose(R, t)
    peak = made["peak_mb"]
    return Outcome(
        poses, failure, float(made["seconds"]), seconds, float("nan") if peak is None else float(peak), made["version"]
    )
