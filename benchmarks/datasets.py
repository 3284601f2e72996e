"""The real data sets: where they are, the scene files that name them, and what is asked of the result.

The data are not part of the repository: `$PASSERBY_DATA`, then `../shared/data` beside the repository.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w

from paper.goals import Goal
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import read_boxes, write_boxes

ROOT = Path(__file__).resolve().parent.parent
BoxChange = Callable[[Boxes], Boxes]


@dataclass(frozen=True)
class DataSet:
    """One real data set with true cameras and identities."""

    name: str
    source: str
    """Folder of the observations: `identities` (boxes) or `keypoints` (joints)."""
    fps: float | None
    goal: Goal


DATA_SETS = (
    DataSet("pets2009", "identities", 7.0, Goal((260, 0.6), (200, 0.5))),
    DataSet("wildtrack", "identities", 2.0, Goal((22, 0.09), (12, 0.05))),
    DataSet("multiviewx", "identities", None, Goal((12, 0.16), (9, 0.08))),
    DataSet("shelf", "keypoints", None, Goal((38, 0.45), (35, 0.4))),
    DataSet("pose2sim_single", "keypoints", 60.0, Goal((30, 0.7), (24, 0.5))),
)


def data_set(name: str) -> DataSet:
    """The data set of that name."""
    return next(data for data in DATA_SETS if data.name == name)


def folder_of(data: DataSet) -> Path | None:
    """The data set's folder, or None where it is not at hand."""
    root = data_root()
    if root is None or not (root / data.name / "rig.toml").is_file() or not (root / data.name / data.source).is_dir():
        return None
    return (root / data.name).resolve()


def data_root() -> Path | None:
    """The folder of all data sets: `$PASSERBY_DATA`, or `../shared/data` beside the repository; None where it is missing."""
    folder = Path(os.environ.get("PASSERBY_DATA") or ROOT.parent / "shared" / "data")
    return folder if folder.is_dir() else None


def models_folder() -> Path | None:
    """The folder of model files: `$PASSERBY_MODELS`, or `../shared/models` beside the repository; None where it is missing."""
    folder = Path(os.environ.get("PASSERBY_MODELS") or ROOT.parent / "shared" / "models")
    return folder.resolve() if folder.is_dir() else None


def write_scene(data: DataSet, folder: Path, into: Path, change: BoxChange | None = None) -> Path:
    """Write a scene file with absolute paths; with `change`, copies of the boxes changed by it, camera after camera."""
    into.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.toml"
    names = [name for name in tomllib.loads(rig.read_text()) if name != "metadata"]
    cameras: dict[str, dict[str, str]] = {}
    for name in names:
        if data.source == "keypoints":
            seen = {"keypoints": str(folder / "keypoints" / f"{name}.json")}
        else:
            tracks = folder / "identities" / f"{name}.txt"
            if change is not None:
                changed, tracks = change(read_boxes(tracks)), into / f"{name}.txt"
                write_boxes(tracks, changed)
            seen = {"tracks": str(tracks)}
        cameras[name] = {"intrinsics": str(rig), **seen}
    scene = {"name": data.name} | ({} if data.fps is None else {"fps": data.fps})
    path = into / "scene.toml"
    path.write_text(tomli_w.dumps({"scene": scene, "cameras": cameras, "association": {"mode": "given"}}))
    return path


def every_second_frame(boxes: Boxes) -> Boxes:
    """The boxes of the frames with odd numbers."""
    return _take(boxes, boxes.frame % 2 == 1)


def swap_identities(share: float, rng: np.random.Generator) -> BoxChange:
    """Exchange the identities among a random share of the boxes of every frame, so that each of those is wrong.

    Where the share is less than two boxes, two are exchanged, as much more seldom.
    """

    def change(boxes: Boxes) -> Boxes:
        identity = np.array(boxes.identity)
        for frame in np.unique(boxes.frame):
            rows = rng.permutation(np.flatnonzero(boxes.frame == frame))
            wanted, chance = share * len(rows), rng.uniform()
            count = int(wanted) + int(chance < wanted - int(wanted))
            if wanted < 2:
                count = 2 if chance < wanted / 2 else 0
            chosen = rows[:count]
            identity[chosen] = np.roll(boxes.identity[chosen], 1)
        return Boxes(boxes.frame, identity, boxes.ltwh, boxes.score)

    return change


def _take(boxes: Boxes, rows: np.ndarray) -> Boxes:
    return Boxes(boxes.frame[rows], boxes.identity[rows], boxes.ltwh[rows], boxes.score[rows])
