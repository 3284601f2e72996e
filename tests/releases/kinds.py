"""Kinds of files that Passerby writes and reads again: how each is read, and how one of a later version ends."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passerby.core.cameras import Rig
from passerby.interchange.calibration_json import read_document
from passerby.interchange.monitor_json import read_monitor
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.archives import open_archive
from passerby.interchange.storage.text_formats import plain
from passerby.interchange.trajectories_csv import read_trajectories
from passerby.perception.kept import StageCache
from passerby.recording.scene_streams import _find_recorded_cameras
from passerby.scene.scene import Scene
from passerby.scene.world_tables import read_plan

DIGITS = 9
"""Of the numbers behind a digest: libraries may differ in the last ones."""


@dataclass(frozen=True)
class Kind:
    """One kind of file."""

    patterns: tuple[str, ...]
    """Where it lies in the folder of a release."""
    read: Callable[[Path], Any]
    """What is in such a file, as plain values, of which later releases read the same or more."""
    version: str = ""
    """The line that states its version, with `{}` for the number; empty where it states none."""
    command: Callable[[Path, Path], list[str]] | None = None
    """Of the command line, that reads a file; the folder of the release comes first."""
    documented: str = ""
    """Name in the table of docs/output.md."""

    def files(self, release: Path) -> list[str]:
        """Those of a release, from its folder."""
        found = {path.relative_to(release).as_posix() for pattern in self.patterns for path in release.glob(pattern)}
        return sorted(found)


def digest(*arrays: Any) -> str:
    """Of numbers, rounded."""
    known = hashlib.blake2b(digest_size=8)
    for array in arrays:
        rounded = [f"{float(value) + 0.0:.{DIGITS}g}" for value in np.asarray(array, dtype=float).ravel()]
        known.update(" ".join(rounded).encode())
    return known.hexdigest()


def rig_values(rig: Rig) -> dict[str, Any]:
    """A rig as plain values."""
    return {"verdict": rig.verdict} | {
        camera.name: {
            "size": list(camera.lens.size),
            "fisheye": camera.lens.fisheye,
            "uncalibrated": camera.lens.uncalibrated,
            "focal_sd": camera.lens.focal_sd,
            "coefficients": len(camera.lens.distortions),
            "posed": camera.pose is not None,
            "lens": digest(camera.lens.matrix, camera.lens.distortions),
            "pose": None if camera.pose is None else digest(camera.pose.R_cw.round(7), camera.pose.t_cw.round(7)),
            "sigma": None if camera.sigma is None else [camera.sigma.position_m, camera.sigma.orientation_deg],
            "covariance": camera.sigma is not None and camera.sigma.covariance is not None,
        }
        for camera in rig
    }


def _scene(path: Path) -> Any:
    return Scene.load(path).model_dump(mode="json", exclude_unset=True)


def _calibration(path: Path) -> Any:
    held = plain(read_document(path.parent))
    return {key: held[key] for key in ("name", "verdict", "reasons", "findings", "files", "cameras")} | {
        "mode": held["association"]["mode"]
    }


def _monitor(path: Path) -> Any:
    found = plain(read_monitor(path.parent))
    return {key: found[key] for key in ("from_s", "until_s", "window_s", "threshold", "cameras", "moves", "judged_by")} | {
        "windows": len(found["windows"])
    }


def _tracks(path: Path) -> Any:
    boxes = read_boxes(path)
    return {"rows": len(boxes), "digest": digest(boxes.frame, boxes.identity, boxes.ltwh)}


def _trajectories(path: Path) -> Any:
    found = read_trajectories(path)
    return {"rows": len(found.frame), "digest": digest(found.identity, found.frame, found.time_s, found.xyz, found.cameras)}


def _plan(path: Path) -> Any:
    table = read_plan(path).model_dump(mode="json", exclude_unset=True)
    return {**table, "image": path.parent.joinpath(table["image"]).name}


def _tracklets(path: Path) -> Any:
    with open_archive(path, "kept tracklets") as archive:
        return {name: digest(archive.array(name)) for name in ("boxes", "joints", "ends", "begins")}


def _stage(path: Path) -> Any:
    stage = StageCache(path.parent, "")
    parts = [stage.load(int(part.stem)) for part in sorted(path.parent.glob("*.npz"))]
    assert stage.summary() is not None
    return [sorted(part) for part in parts if part is not None]


KINDS = {
    "scene": Kind(
        ("scene/scene.toml", "handwritten/scene.toml", "filmed/scene.toml"), _scene, "[scene]\nformat_version = {}",
        lambda _, path: ["check", str(path)], "scene file",
    ),
    "rig": Kind(
        ("*/rig.toml", "scene/truth.toml", "scene/intrinsics.toml"), lambda path: rig_values(read_rig(path)),
        "[metadata]\nformat_version = {}",
        lambda _, path: ["export", str(path), "--format", "opencv", "-o", str(path.parent / "opencv")], "`rig.toml`",
    ),
    "calibration": Kind(
        ("out/calibration.json",), _calibration, '"schema_version": {}', lambda _, path: ["report", str(path.parent)],
        "`calibration.json`",
    ),
    "monitor": Kind(
        ("monitored/monitor.json",), _monitor, '"schema_version": {}',
        lambda release, path: ["monitor", str(release / "out"), str(release / "scene/scene.toml"), "-o", str(path.parent)],
        "`monitor.json`",
    ),
    "recording": Kind(
        ("recorded/recording/recording.json",), lambda path: _find_recorded_cameras(path.parent), '"schema_version": {}',
        lambda release, path: ["calibrate", str(release / "recorded/scene.toml"), "-o", str(release / "recorded/out")],
        "`recording.json`",
    ),
    "plan": Kind(
        ("plan/plan.toml",), _plan, "format_version = {}",
        lambda release, path: ["align", str(release / "out"), "--plan", str(path), "-o", str(release / "aligned.toml")],
        "plan file",
    ),
    "tracks": Kind(("scene/tracks/*.txt", "out/tracks/*.txt"), _tracks, documented="`tracks/NAME.txt`"),
    "trajectories": Kind(("out/trajectories/trajectories.csv",), _trajectories, documented="`trajectories/trajectories.csv`"),
    "tracklets": Kind(("kept/association/*.npz",), _tracklets, documented="`association/`"),
    "stages": Kind(("filmed/out/perception/*/*/summary.txt",), _stage, documented="`perception/`"),
}  # fmt: skip


def set_version(path: Path, kind: Kind, number: int) -> None:
    """Let a file state another version than the one that it states, or that it lacks."""
    text = path.read_text(encoding="utf-8")
    key = re.escape(kind.version.split("\n")[-1]).replace(re.escape("{}"), r"\d+")
    head, _, line = kind.version.format(number).rpartition("\n")
    if re.search(key, text):
        text = re.sub(key, line, text, count=1)
    elif not head:
        text = f"{line}\n{text}"
    else:
        text = text.replace(head, f"{head}\n{line}", 1) if head in text else f"{text}\n{head}\n{line}\n"
    path.write_text(text, encoding="utf-8")
