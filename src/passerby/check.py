"""`passerby check`: what a scene holds, camera by camera, and all that is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passerby.errors import EvidenceError, InputError
from passerby.inputs import CameraReading, read_camera, scene_faults, scene_findings
from passerby.interchange.faults import faults_of
from passerby.observations import UNKNOWN, Observations
from passerby.scene import Scene
from passerby.sharing import Shared, missing_overlap, shared_people


@dataclass(frozen=True)
class CameraCheck:
    """What one camera's files hold."""

    name: str
    size: tuple[int, int] | None
    """(width, height) in pixels; None where the intrinsics cannot be read."""
    frames: int
    """Frames with at least one person."""
    first_frame: int | None
    last_frame: int | None
    boxes: int
    identities: int
    """Different identities in boxes and joints."""
    keypoints: int
    """People with joints."""
    joints: int
    """Joints a person."""
    shared: dict[str, Shared]
    """What it shares with every other camera."""
    faults: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As plain values for JSON."""
        return {
            "name": self.name,
            "size": None if self.size is None else list(self.size),
            "frames": self.frames,
            "first_frame": self.first_frame,
            "last_frame": self.last_frame,
            "boxes": self.boxes,
            "identities": self.identities,
            "keypoints": self.keypoints,
            "joints": self.joints,
            "shared": {name: {"people": shared.people, "sightings": shared.sightings} for name, shared in self.shared.items()},
            "faults": list(self.faults),
        }


@dataclass(frozen=True)
class SceneCheck:
    """What a scene holds and what is wrong with it."""

    name: str
    cameras: tuple[CameraCheck, ...]
    faults: tuple[str, ...]
    """What makes the input unusable, of all cameras and of the scene."""
    lacks: tuple[str, ...]
    """What a calibration will want: the input is sound, but ties not all cameras together."""
    findings: tuple[str, ...]
    """What is odd, but stops nothing."""

    @property
    def exit_status(self) -> int:
        """0 all well, 2 bad input, 3 too little evidence."""
        if self.faults:
            return InputError.exit_status
        return EvidenceError.exit_status if self.lacks else 0

    def to_dict(self) -> dict[str, Any]:
        """As plain values for JSON."""
        return {
            "scene": self.name,
            "ok": self.exit_status == 0,
            "cameras": [camera.to_dict() for camera in self.cameras],
            "faults": list(self.faults),
            "lacks": list(self.lacks),
            "findings": list(self.findings),
        }


def check_scene(path: str | Path) -> SceneCheck:
    """Read a scene file and all that it names; nothing is raised for what is wrong, all of it is gathered."""
    try:
        scene = Scene.load(path)
    except InputError as error:
        return SceneCheck(Path(path).stem, (), faults_of(error), (), ())
    readings = [read_camera(scene, name) for name in scene.cameras]
    shared = shared_people(Observations({reading.name: reading.seen for reading in readings}))
    faults = [fault for reading in readings for fault in reading.faults] + scene_faults(scene, readings)
    findings = [finding for reading in readings for finding in reading.findings] + scene_findings(scene, readings)
    return SceneCheck(
        name=scene.name,
        cameras=tuple(_camera_check(reading, shared[reading.name]) for reading in readings),
        faults=tuple(dict.fromkeys(faults)),
        lacks=() if faults else tuple(missing_overlap(shared)),
        findings=tuple(findings),
    )


def _camera_check(reading: CameraReading, shared: dict[str, Shared]) -> CameraCheck:
    frames = np.unique(np.concatenate([reading.boxes.frame, reading.keypoints.frame]))
    identities = np.unique(np.concatenate([reading.boxes.identity, reading.keypoints.identity]))
    return CameraCheck(
        name=reading.name,
        size=None if reading.lens is None else reading.lens.size,
        frames=len(frames),
        first_frame=int(frames[0]) if len(frames) else None,
        last_frame=int(frames[-1]) if len(frames) else None,
        boxes=len(reading.boxes),
        identities=int((identities > UNKNOWN).sum()),
        keypoints=len(reading.keypoints),
        joints=len(reading.keypoints.joints) if len(reading.keypoints) else 0,
        shared=shared,
        faults=tuple(reading.faults),
    )
