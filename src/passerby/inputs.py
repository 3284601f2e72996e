"""From a scene file to observations: everything that it names is read, checked against each other, and told about.

*Faults* make an input unusable; *findings* are odd, but do not stop a calibration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera, Lens, Rig
from passerby.errors import InputError
from passerby.interchange.coco import read_keypoints
from passerby.interchange.faults import FileFaults, faults_of
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_lens
from passerby.observations import UNKNOWN, Boxes, CameraObservations, Keypoints, Observations
from passerby.scene import Scene

OUTSIDE_SHARE = 0.01
"""A tracker may predict a box or two past the border; where more than this share of the boxes does not touch the picture (grown
by 2 %), the boxes were made on a picture of another size."""
BORDER_SHARE = 0.02
FILLED_SHARE = 0.6
"""People who all stay within this share of the width and the height hint at a size that is too large."""
FILLED_ROWS = 100
PRINCIPAL_SHARE = 0.25
"""A cropped picture can have its principal point outside; further out than this share of the size, matrix and size disagree."""


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class SceneInputs:
    """All that a calibration starts from."""

    rig: Rig
    """The cameras, without poses."""
    observations: Observations
    """In mode "given": people with a known identity only."""
    findings: tuple[str, ...]
    """What is odd, one sentence each."""


@dataclass(eq=False)
class CameraReading:
    """What was read of one camera, as far as it could be."""

    name: str
    lens: Lens | None = None
    boxes: Boxes = field(default_factory=Boxes.empty)
    keypoints: Keypoints = field(default_factory=Keypoints.empty)
    faults: list[str] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)

    @property
    def seen(self) -> CameraObservations:
        """The observations with a known identity."""
        return CameraObservations(
            self.boxes.take(self.boxes.identity > UNKNOWN), self.keypoints.take(self.keypoints.identity > UNKNOWN)
        )


def read_inputs(scene: Scene) -> SceneInputs:
    """Read what a scene names.

    Raises `FileFaults` (an `InputError`) with everything that is wrong, each with its file, place, value and mend.
    """
    readings = [read_camera(scene, name) for name in scene.cameras]
    faults = [fault for reading in readings for fault in reading.faults] + scene_faults(scene, readings)
    if faults:
        raise FileFaults(list(dict.fromkeys(faults)))
    rig = Rig(tuple(Camera(reading.name, reading.lens) for reading in readings if reading.lens is not None))
    observations = Observations({reading.name: reading.seen for reading in readings}, scene.scene.fps)
    findings = [finding for reading in readings for finding in reading.findings] + scene_findings(scene, readings)
    return SceneInputs(rig, observations, tuple(findings))


def read_camera(scene: Scene, name: str) -> CameraReading:
    """Read one camera's files; faults are gathered, not raised."""
    table = scene.cameras[name]
    reading = CameraReading(name)

    def path_of(path: Path | None) -> Path | None:
        return None if path is None else scene.resolve(path)

    reading.lens = _attempt(lambda path: read_lens(path, name), path_of(table.intrinsics), reading.faults)
    reading.boxes = _attempt(read_boxes, path_of(table.tracks), reading.faults) or reading.boxes
    reading.keypoints = _attempt(read_keypoints, path_of(table.keypoints), reading.faults) or reading.keypoints
    _attempt(read_boxes, path_of(table.detections), reading.faults)
    _attempt(_existing, path_of(table.video), reading.faults)
    _check_identities(scene, reading)
    if reading.lens is not None:
        _check_principal_point(scene, reading, reading.lens)
        _check_extents(scene, reading, reading.lens)
    return reading


def scene_faults(scene: Scene, readings: list[CameraReading]) -> list[str]:
    """Faults between cameras, and of what the scene file says about them."""
    faults = []
    lenses = {reading.name: reading.lens for reading in readings}
    for number, length in enumerate(scene.scale.lengths, start=1):
        for name, ends in length.points.items():
            lens = lenses[name]
            if lens is not None and not all(0 <= u <= lens.size[0] and 0 <= v <= lens.size[1] for u, v in ends):
                faults.append(
                    f"{scene.place}: [[scale.lengths]] {number} points: {[list(end) for end in ends]} lies outside the "
                    f"{lens.size[0]} x {lens.size[1]} picture of camera {name}: give pixels of that picture"
                )
    with_joints = [reading for reading in readings if len(reading.keypoints)]
    for reading in with_joints[1:]:
        if not set(reading.keypoints.joints) & set(with_joints[0].keypoints.joints):
            first = ", ".join(reading.keypoints.joints[:3])
            faults.append(
                f"{scene.place}: [cameras.{reading.name}] keypoints: none of its joints ({first}, ...) is one of camera "
                f"{with_joints[0].name}'s: use the same names for the same joints"
            )
    return faults


def scene_findings(scene: Scene, readings: list[CameraReading]) -> list[str]:
    """Oddities between cameras."""
    known = {
        int(who) for reading in readings for part in (reading.boxes, reading.keypoints) for who in np.unique(part.identity)
    }
    return [
        f"{scene.place}: [[scale.people]]: identity {cue.identity} is seen by no camera; its height says nothing"
        for cue in scene.scale.people
        if cue.identity not in known
    ]


def _attempt(read: Callable[[Path], T], path: Path | None, faults: list[str]) -> T | None:
    """What `read` makes of the file, or None with its faults added."""
    if path is None:
        return None
    try:
        return read(path)
    except InputError as error:
        faults += faults_of(error)
        return None


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file: a video is needed here; check the path and its spelling")
    return path


def _check_identities(scene: Scene, reading: CameraReading) -> None:
    """Mode "given": people need identities."""
    table = scene.cameras[reading.name]
    if table.tracks is None and table.keypoints is None:
        reading.faults.append(
            f"{scene.place}: [cameras.{reading.name}] has only detections, which carry no identities: "
            'mode "given" needs `tracks` or `keypoints` with identities that are the same in all cameras'
        )
        return
    if table.detections is not None:
        reading.findings.append(f'{scene.place}: [cameras.{reading.name}] detections are not used in mode "given"')
    for path, part, key in ((table.tracks, reading.boxes, "id"), (table.keypoints, reading.keypoints, "track_id")):
        if path is None:
            continue
        unknown = int((part.identity == UNKNOWN).sum())
        if len(part) and unknown == len(part):
            reading.faults.append(
                f'{scene.resolve(path)}: camera {reading.name}: no row has an identity ({key}): mode "given" needs them, '
                "the same number for the same person in all cameras"
            )
        elif unknown:
            reading.findings.append(
                f"{scene.resolve(path)}: camera {reading.name}: {unknown} of {len(part)} rows have no identity and are not used"
            )
        elif not len(part) and not reading.faults:
            reading.findings.append(f"{scene.resolve(path)}: camera {reading.name} saw nobody: the file has no rows")


def _check_principal_point(scene: Scene, reading: CameraReading, lens: Lens) -> None:
    """Matrix against picture size."""
    beyond = float((np.abs(lens.matrix[:2, 2] / lens.size - 0.5) - 0.5).max())
    if beyond > 0:
        text = (
            f"{scene.resolve(scene.cameras[reading.name].intrinsics)}: [{reading.name}] the principal point "
            f"{lens.matrix[:2, 2].round(1).tolist()} lies outside the {lens.size[0]} x {lens.size[1]} picture: "
            "wrong image size? Matrix and size must be of one picture"
        )
        (reading.faults if beyond > PRINCIPAL_SHARE else reading.findings).append(text)


def _check_extents(scene: Scene, reading: CameraReading, lens: Lens) -> None:
    """Picture size against where the people are."""
    table = scene.cameras[reading.name]
    width, height = lens.size
    mend = f"the size {width} x {height} in {scene.resolve(table.intrinsics)} is not that of the picture"
    for path, extent, rows in (
        (table.tracks, _box_extents(reading.boxes), reading.boxes),
        (table.keypoints, _joint_extents(reading.keypoints), reading.keypoints),
    ):
        if path is None or not len(extent):
            continue
        margin = BORDER_SHARE * np.array([width, height])
        outside = ((extent[:, :2] > np.array([width, height]) + margin) | (extent[:, 2:] < -margin)).any(axis=1)
        count, place = int(outside.sum()), f"{scene.resolve(path)}: camera {reading.name}"
        if count:
            first = int(np.flatnonzero(outside)[0])
            text = (
                f"{place}: {count} of {len(extent)} people lie outside the {width} x {height} picture (first: frame "
                f"{rows.frame[first]}, from {extent[first, :2].round(1).tolist()} to {extent[first, 2:].round(1).tolist()})"
            )
            if count > OUTSIDE_SHARE * len(extent):
                reading.faults.append(f"{text}: wrong image size? {mend} in which the people were found")
            else:
                reading.findings.append(text)
        filled = (extent[:, 2:] / lens.size).max(axis=0)
        if len(extent) >= FILLED_ROWS and filled.max() < FILLED_SHARE:
            reading.findings.append(
                f"{place}: all people lie within {filled[0]:.0%} of the width and {filled[1]:.0%} of the height: "
                f"wrong image size? perhaps {mend} in which they were found"
            )


def _box_extents(boxes: Boxes) -> NDArray[np.float64]:
    """(N, 4) left, top, right, bottom in pixels."""
    return np.column_stack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])


def _joint_extents(keypoints: Keypoints) -> NDArray[np.float64]:
    """(N, 4) left, top, right, bottom of the joints found in each person, pixels; (0, 0, 0, 0) where there is none."""
    found = keypoints.score[..., None] > 0
    some = found.any(axis=1)
    low = np.where(some, np.where(found, keypoints.xy, np.inf).min(axis=1, initial=np.inf), 0.0)
    high = np.where(some, np.where(found, keypoints.xy, -np.inf).max(axis=1, initial=-np.inf), 0.0)
    return np.column_stack([low, high])
