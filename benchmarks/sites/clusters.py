"""The same site calibrated by one process, by a process for each core, and on a cluster whose workers are killed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from sites.cases import SiteCase
from sites.loopback import ENVIRONMENT, contents, killing, scheduler, workers

SECONDS = 300.0
WORKERS, FIRST_KILLED_S, KILLED_EVERY_S = 4, 5.0, 20.0

_ON_CORES = """
import os, runpy, sys
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv.pop(1))])
runpy.run_module("passerby", run_name="__main__", alter_sys=True)
"""


def cases(seeds: int) -> dict[str, SiteCase]:
    """By key."""
    del seeds
    return {f"{count} cameras": SiteCase(count, seconds=SECONDS) for count in (25,)}


def measure(case: SiteCase) -> dict[str, Any]:
    """Seconds of each way, and which files are not the same to the last byte: plain values."""
    with tempfile.TemporaryDirectory(prefix="passerby-cluster-") as scratch:
        folder = Path(scratch)
        _passerby("simulate", "-o", str(folder / "site"), *case.arguments)
        cpu_s = time.process_time() + _children_s()
        scene = str(folder / "site" / "scene.toml")
        took = {
            "one": _passerby("calibrate", scene, "-o", str(folder / "one"), cores=1),
            "pool": _passerby("calibrate", scene, "-o", str(folder / "pool")),
        }
        with (
            scheduler() as (address, _),
            workers(address, folder / "workers", WORKERS) as nannies,
            killing(nannies, FIRST_KILLED_S, KILLED_EVERY_S) as killed,
        ):
            took["cluster"] = _passerby("calibrate", scene, "-o", str(folder / "cluster"), "--scheduler", address)
        by_one = contents(folder / "one")
        others = {name: contents(folder / name) for name in ("pool", "cluster")}
        cpu_s = time.process_time() + _children_s() - cpu_s
    return {
        "cameras": case.cameras, "cpu_s": cpu_s, "took_s": took, "killed": len(killed), "files": len(by_one),
        "differing": sorted({
            path for files in others.values() for path in by_one.keys() | files.keys() if files.get(path) != by_one.get(path)
        }),
    }  # fmt: skip


def _children_s() -> float:
    spent = os.times()
    return spent.children_user + spent.children_system


def _passerby(*arguments: str, cores: int | None = None) -> float:
    """Seconds of a command; on a single core it has no processes beside it."""
    began = time.perf_counter()
    program = ["-m", "passerby"] if cores is None else ["-c", _ON_CORES, str(cores)]
    command = [sys.executable, *program, *arguments]
    done = subprocess.run(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    if done.returncode not in (0, 3):  # 3: written, but not all of it is accepted
        raise RuntimeError(f"{' '.join(command)} ended with status {done.returncode}: {done.stderr.decode()[-1000:]}")
    return time.perf_counter() - began
