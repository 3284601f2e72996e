"""What the report tells of: a calibration as it was made, or as its output folder keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, adjusted
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.core.solution import Verdict
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.output_folder import RIG_FILE, TRACKS_FOLDER, is_file_name, read_report
from passerby.interchange.rig_toml import read_rig


@dataclass(frozen=True, eq=False)
class Contents:
    """All that the report is made from."""

    document: CalibrationDocument
    """What `calibration.json` holds."""
    rig: Rig
    """All cameras, also those without a pose. Metres, world z up, ground at z = 0."""
    observations: Observations
    """Boxes and joints of all cameras, with identities that hold over the rig, frames as each camera counts them."""
    clocks: Mapping[str, Clock]
    """Each camera's clock; empty where the same frame number is the same instant in all cameras."""
    videos: Mapping[str, Path]
    """The cameras' videos, as far as the files exist."""

    @property
    def verdict(self) -> Verdict:
        """accepted, doubtful or refused."""
        return self.document.verdict

    @property
    def cameras(self) -> dict[str, CameraEntry]:
        """By camera, its entry of `calibration.json`; empty entries for cameras that it does not tell of."""
        return {name: self.document.entry(name) for name in self.rig.names}

    @property
    def figures(self) -> AdjustedFigures:
        """Of the method `people`; empty ones of another method, or where there is no rig."""
        return adjusted(self.document.figures)


def contents_from(out: Path) -> Contents:
    """The contents of an output folder, also of a refused calibration and of one that an older Passerby wrote.

    Raises `InputError` for a folder that no calibration wrote, or a file in it that is broken.
    """
    document = read_report(out)
    rig = read_rig(out / RIG_FILE)
    clocks = _clocks(document.entries, rig)
    seen = {name: CameraObservations(*_seen(out / TRACKS_FOLDER, name)) for name in rig.names}
    return Contents(document, rig, Observations(seen, document.scene.scene.fps, clocks), clocks, _videos(document, rig))


def _seen(folder: Path, name: str) -> tuple[Boxes, Keypoints]:
    """A camera's boxes and joints; none where there is no file of them."""
    if not is_file_name(name):
        return Boxes.empty(), Keypoints.empty()
    boxes, joints = folder / f"{name}.txt", folder / f"{name}.json"
    return (
        read_boxes(boxes) if boxes.is_file() else Boxes.empty(),
        read_keypoints(joints) if joints.is_file() else Keypoints.empty(),
    )


def _clocks(entries: Mapping[str, CameraEntry], rig: Rig) -> dict[str, Clock]:
    """Each camera's clock; none at all where one camera has none, since instants need all."""
    found = {name: Clock(entry.fps, entry.time_offset_s or 0.0) for name, entry in entries.items() if entry.fps is not None}
    return {name: found[name] for name in rig.names} if all(name in found for name in rig.names) else {}


def _videos(document: CalibrationDocument, rig: Rig) -> dict[str, Path]:
    """The videos that the scene names, as far as they lie where they lay."""
    if document.scene_file is None:
        return {}
    found = {}
    for name in rig.names:
        declared = document.scene.cameras.get(name)
        video = None if declared is None else declared.video
        if video and "\0" not in video and (path := Path(document.scene_file).parent / video).is_file():
            found[name] = path
    return found
