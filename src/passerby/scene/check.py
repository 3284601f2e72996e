"""`passerby check`: the content of a scene, camera by camera, and all of its faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from passerby.association.ground.ground_tracks import MIN_TRACK_S
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Ints
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Lens
from passerby.core.observations import UNKNOWN, CameraObservations, Observations
from passerby.core.overlap import Shared, count_shared_observations, missing_overlap
from passerby.core.usability import doubt_missing_pose
from passerby.findings.finding import Finding, notice
from passerby.findings.texts import diagnostic, texts_of
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.interchange.storage.text_formats import plain
from passerby.perception.plan import foresee
from passerby.perception.video import VideoInfo
from passerby.perception.video_probe import WallTime
from passerby.scene.camera_input import CameraInput, KnownLens
from passerby.scene.inputs import observations_of, read_cameras, scene_doubts, scene_faults, scene_findings
from passerby.scene.reading import needs_embeddings, needs_keypoints
from passerby.scene.scene import Scene
from passerby.scene.sound import sound_to_hear
from passerby.scene.time_needed import foresee_time
from passerby.scene.video_inputs import choose_keypoints, keypoints_for

SHORTEST_S = MIN_TRACK_S + 2 * STEP_S
"""Minimum duration of a recording, seconds, for the registration of cameras by tracks. A tracklet shorter than `MIN_TRACK_S`
has no direction, and up to a grid step at each of its ends has no partner. Of ten simulated scenes of 1.7 and 2.0 s, 6 and 15
people, none is accepted; of 2.4 and 3 s six of ten are."""


@dataclass(frozen=True)
class CameraCheck:
    """The content of one camera's files."""

    name: str
    size: tuple[int, int] | None
    """(width, height) in pixels; None if the intrinsics cannot be read."""
    frames: int
    """Frames with at least one person."""
    first_frame: int | None
    last_frame: int | None
    boxes: int
    identities: int
    """Number of different ids in boxes and joints: people in mode "given", else this camera's tracklets; 0 for detections."""
    keypoints: int
    """Number of rows with joints."""
    joints: int
    """Number of joints of a person."""
    embedding_dimensions: int | None
    """Dimensions of the boxes' embeddings; None if there are none."""
    fps: float | None
    """Frames per second of the frame numbers; None if unknown."""
    shared: dict[str, Shared]
    """Observations that it shares with each other camera; empty if identities are not given."""
    faults: tuple[str, ...]
    video: VideoInfo | None = None
    awaiting: bool = False
    """Whether people must still be detected in the video."""
    lens: Lens | None = None
    """The intrinsics with which a calibration begins; None if they cannot be read."""
    lens_source: KnownLens | None = None
    """Source of the intrinsics."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
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
            "embedding_dimensions": self.embedding_dimensions,
            "fps": self.fps,
            "shared": {name: {"people": shared.people, "sightings": shared.sightings} for name, shared in self.shared.items()},
            "faults": list(self.faults),
            **({} if self.video is None else {"video": self._video(self.video)}),
            "intrinsics": None
            if self.lens is None or self.lens_source is None
            else self._intrinsics(self.lens, self.lens_source),
        }

    def _intrinsics(self, lens: Lens, source: KnownLens) -> dict[str, Any]:
        """Return the known data of the lens and their source; no focal length if none is stated."""
        unknown = source.source == "people"
        return {
            "source": source.source,
            "file": source.place,
            "same_as": source.same_as,
            "model": "fisheye" if lens.fisheye else "pinhole",
            "estimated": lens.uncalibrated,
            "focal_px": None if unknown else lens.focal,
            "focal_sd_percent": None if unknown or lens.focal_sd is None else 100 * lens.focal_sd,
        }

    def _pieces(self, video: VideoInfo) -> dict[str, Any]:
        """Return the number of files of a recording, and its wall times if they are known."""
        wall, end_s = video.wall, video.end_s
        if wall is None or end_s is None:
            return {"pieces": len(video.files)}
        first, last = (WallTime(round(wall.seconds + end), wall.utc).text for end in (video.begin_s, end_s))
        return {"pieces": len(video.files), "from": first, "until": last}

    def _video(self, video: VideoInfo) -> dict[str, Any]:
        """Return the data of the video that are known before it is processed."""
        return {
            "file": str(video.path),
            "size": list(video.size),
            "codec": video.codec,
            "fps": video.average_fps,
            "variable": video.variable,
            "pictures": video.frames,
            "seconds": video.seconds,
            "watched": self.awaiting,
            **(self._pieces(video) if video.pieces else {}),
            **{key: value for key, value in asdict(video.camera).items() if value is not None},
        }


@dataclass(frozen=True)
class SceneCheck:
    """The content of a scene and its faults."""

    name: str
    mode: str | None
    """Mode of the association of identities; None if the scene file cannot be read."""
    cameras: tuple[CameraCheck, ...]
    faults: tuple[str, ...]
    """Faults of all cameras and of the scene that make the input unusable."""
    diagnostics: tuple[Finding, ...]
    """Doubts, which a calibration would have as well, followed by notices."""
    perception: dict[str, Any] = field(default_factory=dict)
    """The models that would process the videos, JSON-ready; empty if no video would be processed."""
    time_s: tuple[float, float] | None = None
    """The shortest and the longest time that a calibration may take on this computer, seconds; None if unknown."""

    @property
    def lacks(self) -> tuple[str, ...]:
        """Reasons why a calibration will fail on valid files: they do not connect all cameras, or no rig can be accepted."""
        return texts_of(finding for finding in self.diagnostics if finding.severity != "notice")

    @property
    def findings(self) -> tuple[str, ...]:
        """Notices: unusual facts that do not stop a calibration."""
        return texts_of(finding for finding in self.diagnostics if finding.severity == "notice")

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 no faults, 2 bad input, 3 insufficient evidence."""
        if self.faults:
            return InputError.exit_status
        return EvidenceError.exit_status if self.lacks else 0

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "scene": self.name,
            "mode": self.mode,
            "ok": self.exit_status == 0,
            "cameras": [camera.to_dict() for camera in self.cameras],
            "faults": list(self.faults),
            "lacks": list(self.lacks),
            "findings": list(self.findings),
            "diagnostics": [plain(diagnostic(finding)) for finding in self.diagnostics],
            **({"perception": self.perception} if self.perception else {}),
            "time_s": None if self.time_s is None else list(self.time_s),
        }


def check_scene(source: Scene | str | Path, findings: Sequence[Finding] = ()) -> SceneCheck:
    """Read a scene file and all files that it names. Faults are collected in the result; none raises an exception.

    Args:
        source: a scene file, or the scene that was read from it.
        findings: findings about the scene that are known before.
    """
    try:
        scene = source if isinstance(source, Scene) else Scene.load(source)
    except InputError as error:
        assert not isinstance(source, Scene)
        return SceneCheck(Path(source).stem, None, (), faults_of(error), ())
    readings = read_cameras(scene)
    given = scene.association.given
    shared = count_shared_observations(_unify_frames(observations_of(scene, readings))) if given else {}
    faults = [fault for reading in readings for fault in reading.faults] + scene_faults(scene, readings)
    notices = [finding for reading in readings for finding in reading.findings] + scene_findings(scene, readings)
    perception, faults_of_networks, notes = _plan_perception(scene, readings)
    short = find_too_short(scene, readings, with_keypoints=perception.get("keypoints", "none") != "none")
    faults, notices = faults + faults_of_networks, notices + notes
    apart = [doubt_missing_pose(one) if one.severity == "notice" else one for one in missing_overlap(shared)] if given else []
    doubts = () if faults else (*scene_doubts(scene, readings), *apart, *short)
    notices += [] if faults else sound_to_hear(scene, readings)
    return SceneCheck(
        name=scene.name,
        mode=scene.association.mode,
        cameras=tuple(_camera_check(reading, shared.get(reading.name, {})) for reading in readings),
        faults=tuple(dict.fromkeys(faults)),
        diagnostics=(*doubts, *findings, *notices),
        perception=perception,
        time_s=None if faults else foresee_time(scene, readings, perception),
    )


def find_too_short(scene: Scene, readings: Sequence[CameraInput], *, with_keypoints: bool = False) -> list[Finding]:
    """Return a doubt if recordings are too short to track people, and no joints are used, for which less time suffices.

    `with_keypoints`: whether there is a network that would measure joints in the videos.
    """
    if scene.association.mode not in ("combined", "trajectory"):
        return []
    with_joints = sum(
        len(reading.keypoints) > 0 or (with_keypoints and reading.awaiting and needs_keypoints(scene, reading))
        for reading in readings
    )
    short = {
        reading.name: seconds
        for reading in readings
        if not reading.faults and (seconds := _seconds(scene, reading)) is not None and seconds <= SHORTEST_S
    }
    if with_joints > 1 or not short:
        return []
    values = {"seconds": short, "shortest_s": SHORTEST_S, "network": keypoints_for(scene)}
    return [doubt_missing_pose(notice("recordings_short", *short, place=str(scene.place), **values))]


def _seconds(scene: Scene, reading: CameraInput) -> float | None:
    """Compute the duration of the used part of a camera's recording, seconds; None if unknown, or if it saw no person."""
    if reading.fps is None:
        return None
    if reading.awaiting:
        video, table = reading.video, scene.cameras[reading.name]
        if video is None or video.end_s is None:
            return None
        begin, end = (second * video.clock_fps / reading.fps for second in (video.begin_s, video.end_s))
        return min(end, np.inf if table.until_s is None else table.until_s) - max(begin, table.from_s or 0.0)
    frames = reading.frames
    return float((frames[-1] - frames[0] + 1) / reading.fps) if len(frames) else None


def _plan_perception(scene: Scene, readings: list[CameraInput]) -> tuple[dict[str, Any], list[str], list[Finding]]:
    """Return the models that would process the videos, the faults of this choice, and notices of models to download."""
    wanted, usable = scene.perception, [reading for reading in readings if reading.video is not None]

    def of(wants: Callable[[Scene, CameraInput], bool], choice: str) -> str:
        return choice if any(wants(scene, reading) for reading in usable) else ""

    models = None if wanted.models is None else scene.resolve(wanted.models)
    detector = of(lambda _, reading: reading.awaiting, wanted.detector)
    appearance, joints = of(needs_embeddings, wanted.embedder), of(needs_keypoints, choose_keypoints(scene, readings))
    try:
        choices, notes = foresee(detector, appearance, joints, models=models, base=scene.resolve(Path()))
    except InputError as error:
        return {}, [f"{scene.place}: {error}"], []
    return choices, [], notes


def _unify_frames(observations: Observations) -> Observations:
    """Convert observations to the frame numbers of the slowest camera, in order to count people seen at the same time."""
    clocks = observations.clocks
    if not clocks:
        return observations
    slowest = min(clock.fps for clock in clocks.values())

    def ticks(name: str, frame: Ints) -> Ints:
        return np.asarray(np.rint(clocks[name].seconds(frame) * slowest), dtype=np.int64)

    return Observations(
        {
            name: CameraObservations(
                replace(seen.boxes, frame=ticks(name, seen.boxes.frame)),
                replace(seen.keypoints, frame=ticks(name, seen.keypoints.frame)),
            )
            for name, seen in observations.cameras.items()
        }
    )


def _camera_check(reading: CameraInput, shared: dict[str, Shared]) -> CameraCheck:
    frames = reading.frames
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
        embedding_dimensions=reading.dimensions,
        fps=reading.fps,
        shared=shared,
        faults=tuple(reading.faults),
        video=reading.video,
        awaiting=reading.awaiting,
        lens=reading.lens,
        lens_source=reading.lens_source,
    )
