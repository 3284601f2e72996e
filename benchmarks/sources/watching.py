"""One large video processed by this version and by an earlier one, with the same detector, one after the other."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from command import ONE_THREAD, run_program
from datasets import ROOT, models_folder
from earlier_version import commit_named, unpack
from perception_scenes import LARGE_SECONDS, large_video, repeated

EARLIER = "35d694e6f9c84c369e077b7f9431eef07b09639e"  # the last commit before recordings in pieces and sparse readings
SECONDS = 600.0  # of the video
KEY_EVERY_S = 2.0  # between two key frames, as network cameras send them
DETECTORS = {"background": 1.0, "yolox-nano": 0.1}
"""Of each the share of the video that is processed: networks take longer, and learn nothing from the whole."""
PROGRAM = Path(__file__).with_name("watch_program.py")


@dataclass(frozen=True)
class WatchingCase:
    """A detector, and a video of so many seconds, of which `film` is repeated."""

    detector: str
    film: Path
    seconds: float
    against: str


def cases(scenes: Path, seconds: float, against: str) -> dict[str, WatchingCase]:
    """By key, for each detector at hand.

    Raises `subprocess.CalledProcessError` for a name that is no commit.
    """
    film = large_video(scenes, KEY_EVERY_S)
    earlier = commit_named(against)
    known = [name for name in DETECTORS if name == "background" or models_folder() is not None]
    made = (WatchingCase(name, film, _whole(DETECTORS[name] * seconds), earlier) for name in known)
    return {f"{case.detector} {case.seconds:g} s against {earlier}": case for case in made}


def work(case: WatchingCase) -> dict[str, Any]:
    """Processor time of both versions: plain values."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        video = repeated(case.film, case.seconds, folder / "video.mp4")
        sources = {"earlier": unpack(case.against, folder / "earlier"), "now": ROOT / "src"}
        found = {name: _watched(case.detector, video, source, folder / name) for name, source in sources.items()}
    about = {"detector": case.detector, "seconds": case.seconds, "against": case.against}
    return {"about": about, "cpu_s": sum(one["cpu_s"] for one in found.values()), **found}


def ratio(case: dict[str, Any]) -> float:
    """Processor time now over that of the earlier version."""
    return float(case["now"]["cpu_s"] / case["earlier"]["cpu_s"])


def _whole(seconds: float) -> float:
    """A length in whole repetitions of the film, one at least."""
    return LARGE_SECONDS * max(1, round(seconds / LARGE_SECONDS))


def _watched(detector: str, video: Path, source: Path, shelf: Path) -> dict[str, Any]:
    """What the program says, run with the package in `source`."""
    models = models_folder()
    arguments = [str(PROGRAM), str(video), "--detector", detector, "--shelf", str(shelf)]
    arguments += ["--models", str(models)] if models else []
    found: dict[str, Any] = json.loads(run_program(arguments, ONE_THREAD | {"PYTHONPATH": str(source)}).output)
    used = Path(found.pop("package"))
    if used.parent.resolve() != source.resolve():
        raise RuntimeError(f"{source} was to be run, and {used} was")
    return found
