"""Starts one engine in a fresh process, in its own environment, on one thread, for a limited time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from datasets import ROOT

from passerby.cameras import Pose

HERE = Path(__file__).resolve().parent
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")}


@dataclass(frozen=True)
class Engine:
    """A program that finds camera poses."""

    name: str
    script: str
    """Runner beside this module."""
    environment: str | None = None
    """Folder `.venv-peer-NAME` of its interpreter; None: the one that runs this."""
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
    CALISCOPE,
    Engine("COLMAP", "colmap_runner.py", "colmap"),
    Engine("GLOMAP", "colmap_runner.py", "colmap", option="global"),
    Engine("humancalib BA", "humancalib_runner.py", "humancalib", one_person_only=True),
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one run came to."""

    poses: dict[str, Pose] = field(default_factory=dict)
    failure: str | None = None
    """Why there is no result: timed out, or what the engine said."""
    solve_seconds: float = float("nan")
    whole_seconds: float = float("nan")
    """The whole process, start of Python and imports included."""
    peak_mb: float = float("nan")
    version: str = ""


def run_engine(engine: Engine, source: Path, target: Path, limit_s: float) -> Outcome:
    """Run an engine on a file. The result is a failure where it breaks, writes nothing or needs longer than `limit_s`.

    Raises `FileNotFoundError` where the engine's environment was not made.
    """
    python = engine.interpreter()
    if python is None:
        raise FileNotFoundError(f".venv-peer-{engine.environment}")
    command = [str(python), str(HERE / engine.script), str(source), str(target), *([engine.option] if engine.option else [])]
    began = time.perf_counter()
    child = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **ONE_THREAD},
        start_new_session=True,
        text=True,
    )
    try:
        _, said = child.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        return Outcome(failure=f"timed out ({limit_s:g} s)", whole_seconds=limit_s)
    seconds = time.perf_counter() - began
    if child.returncode != 0 or not target.is_file():
        last = (said.strip().splitlines() or ["no word"])[-1]
        return Outcome(failure=f"broke: exit status {child.returncode}: {last[:200]}", whole_seconds=seconds)
    return _outcome(target, seconds)


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
