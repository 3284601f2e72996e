"""What a runner reads and writes: one file of points in, one of poses out. It needs numpy alone, to run in every environment.

A runner is a script, `python NAME_runner.py INPUT OUTPUT [OPTION]`; it imports its peer, this module, and nothing of Passerby.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Poses = dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Camera -> R (3, 3) and t (3,) of `x_c = R X + t`, OpenCV's axes; any unit of length."""


@dataclass(frozen=True, eq=False)
class Points:
    """C cameras with known lenses and M sightings of points. The same person, instant and part is the same point."""

    names: NDArray[np.str_]  # (C,)
    size: NDArray[np.int64]  # (C, 2) width and height, pixels
    matrix: NDArray[np.float64]  # (C, 3, 3)
    distortions: NDArray[np.float64]  # (C, 5) OpenCV's k1, k2, p1, p2, k3
    camera: NDArray[np.int64]  # (M,) index of the camera
    person: NDArray[np.int64]  # (M,) whose
    instant: NDArray[np.int64]  # (M,) when
    part: NDArray[np.int64]  # (M,) which point of the person, from 0
    pixel: NDArray[np.float64]  # (M, 2) in the picture, distorted
    undistorted: NDArray[np.float64]  # (M, 2) where a lens without distortion and with the same matrix would have it
    score: NDArray[np.float64]  # (M,) confidence; 1 of a box

    def point_numbers(self) -> NDArray[np.int64]:
        """(M,) number of the point that each sighting shows, from 0."""
        key = np.column_stack([self.instant, self.person, self.part])
        return np.asarray(np.unique(key, axis=0, return_inverse=True)[1]).reshape(-1).astype(np.int64)

    def write(self, path: Path) -> None:
        """Write as npz."""
        np.savez(path, **{name: getattr(self, name) for name in self.__dataclass_fields__})

    @classmethod
    def read(cls, path: Path) -> Points:
        """Read what `write` wrote."""
        with np.load(path) as content:
            return cls(**{name: content[name] for name in cls.__dataclass_fields__})


def run(solve: Callable[[Path, str], Poses], package: str) -> None:
    """The main program of a runner: solve what the command line names, and write what came of it.

    `solve(input, option)` gives the poses of the cameras that it registered. An exception is written down as the failure: an
    engine that breaks has an entry in the table as any other.
    """
    source, target, option = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else ""
    poses, failure = {}, None
    began = time.process_time()
    try:
        poses = solve(source, option)
    except Exception as error:
        failure = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    seconds = time.process_time() - began
    write_result(target, poses, seconds, failure, package)


def write_result(target: Path, poses: Poses, seconds: float, failure: str | None, package: str) -> None:
    """Write poses, processor seconds, peak memory and version as JSON."""
    content: dict[str, Any] = {
        "poses": {name: {"R": np.asarray(R).tolist(), "t": np.ravel(t).tolist()} for name, (R, t) in poses.items()},
        "seconds": seconds, "peak_mb": peak_mb(), "failure": failure, "version": f"{package} {metadata.version(package)}",
    }  # fmt: skip
    target.write_text(json.dumps(content))


def peak_mb() -> float | None:
    """Largest resident memory of this process since its program began, 10^6 bytes; None where Linux does not tell it.

    Not `getrusage`: that counts a process from before its `exec`, when it was still a copy of whoever started it.
    """
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next((float(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("VmHWM:")), None)
