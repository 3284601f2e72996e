"""From a scene file to observations: all files that it names are read, and the cameras are compared with each other.

*Faults* make an input unusable. *Findings* are unusual facts that do not stop a calibration. With *doubts*, no rig is accepted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Protocol

import numpy as np

from passerby.association.clocks.starts import WALL_CLOCK, MeasuredStart
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Clock, Observations
from passerby.core.pointing import PointedPerson, StatedIdentities
from passerby.core.quarter_turns import turn_boxes
from passerby.findings.finding import Finding, notice
from passerby.interchange.storage.safe_parsing import FileFaults, faults_of
from passerby.perception.sources.recording import count_recorded_s, gaps_of
from passerby.scene.box_interpretations import notice_of_coarse_boxes
from passerby.scene.camera_input import CameraInput
from passerby.scene.exchanged_streams import findings_of_exchanged_streams
from passerby.scene.joint_layouts import correct_layouts, wand_faults
from passerby.scene.lens_sources import add_seen_lenses, group_faults
from passerby.scene.people_in_images import doubts_of_people, faults_of_people, findings_of_people
from passerby.scene.pointing import find_stated_identities, overlapped_people, pointed_people, pointing_faults
from passerby.scene.reading import needs_video, read_camera
from passerby.scene.same_content import doubts_of_same_content, faults_of_same_file, faults_of_same_video
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import (
    WallClock,
    align_wall_clocks,
    choose_span,
    file_clock_findings,
    measure_by_file_clocks,
    wall_clock_of,
)
from passerby.scene.world_files import world_faults

IN_MEMORY = Path("(in memory)")
"""Replaces the name of a file if people come from arrays."""
SPAN_RATIO = 1.5
"""Recordings whose lengths in seconds differ by a larger ratio are reported: a wrong frame rate is usually half or twice the
true one (25 and 50, 30 and 60). It is no fault, because a recording also appears short if people are there only for a part of
the time."""
WALL_SIGMA_S = 1.7
"""Standard deviation of the difference of two recorders' clocks; three of them are the 5 s that are searched by default."""
SHORT_VIDEO = 0.2
"""A video shorter than this share of the longest one is incomplete, usually because of an interrupted copy or a full disk. A
smaller difference is only reported, and the common time is used."""


@dataclass(frozen=True, eq=False)
class SceneInputs:
    """All inputs of a calibration."""

    rig: Rig
    """The cameras, without poses."""
    observations: Observations
    """In mode "given": only people with a known identity. Else all rows, with each camera's own tracklet numbers or -1."""
    findings: tuple[Finding, ...]
    """Notices of unusual facts."""
    doubts: tuple[Finding, ...] = ()
    """Evidence against any rig from this input."""
    pointed: tuple[PointedPerson, ...] = ()
    """People of known height at whom the scene file points."""
    wall_clock: WallClock | None = None
    """Wall time of frame numbers; None if unknown."""
    measured: tuple[MeasuredStart, ...] = ()
    """Differences of two cameras' clocks from sources other than people."""
    gaps: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """By camera with gaps in its recording, the spans of its own frame numbers in which it recorded nothing."""
    stated: StatedIdentities = field(default_factory=StatedIdentities)
    """Identities that the scene file corrects."""
    elsewhere: tuple[Camera, ...] = ()
    """Cameras of the scene that are not in these inputs, because they belong to other groups."""


class VideoProcessor(Protocol):
    """A function that completes the readings of cameras by the detections in their videos."""

    def __call__(self, scene: Scene, readings: Sequence[CameraInput]) -> None:
        """Process the videos, and add observations, faults and findings to the readings."""


class ClockMeasurement(Protocol):
    """A function that measures the differences of the cameras' clocks from sources other than people."""

    def __call__(
        self, scene: Scene, readings: Sequence[CameraInput], /
    ) -> tuple[tuple[MeasuredStart, ...], tuple[Finding, ...]]:
        """Return the measured differences, and notices about them."""


def read_inputs(
    scene: Scene, watch: VideoProcessor | None = None, measure_clocks: ClockMeasurement | None = None, *,
    compare_contents: bool = True,
) -> SceneInputs:  # fmt: skip
    """Read the files that a scene names, and process the videos of the cameras that need it.

    Without `watch`, no video is processed. `measure_clocks` is needed if time offsets are estimated: without it, only wall
    times are known. Without `compare_contents`, there is no test whether two cameras show the same images, which takes time for
    each pair. Raises `FileFaults` (an `InputError`) with all faults, each with its file, place, value and remedy.
    """
    return complete_inputs(scene, open_inputs(scene), watch, measure_clocks, compare_contents=compare_contents)


def open_inputs(scene: Scene) -> list[CameraInput]:
    """Read the files of a scene, before any video is processed.

    Raises `FileFaults` with all faults, so that they are reported before the videos are processed for hours.
    """
    readings = read_cameras(scene)
    _raise_faults(scene, readings)
    add_seen_lenses(scene, readings)
    return readings


def complete_inputs(
    scene: Scene, opened: Sequence[CameraInput], watch: VideoProcessor | None = None,
    measure_clocks: ClockMeasurement | None = None, *, compare_contents: bool = True,
) -> SceneInputs:  # fmt: skip
    """Complete the readings of `open_inputs`, which stay unchanged; arguments and errors are those of `read_inputs`."""
    readings = [reading.copy() for reading in opened]
    if watch is not None and any(needs_video(scene, reading) for reading in readings):
        watch(scene, readings)
        _raise_faults(scene, readings)
    inputs = assemble_inputs(scene, readings, compare_contents=compare_contents)
    measured, odd = ((), ()) if measure_clocks is None else measure_clocks(scene, readings)
    by_clock = (*_measure_starts(inputs.wall_clock), *measure_by_file_clocks(scene, readings))
    return replace(inputs, findings=(*inputs.findings, *odd), measured=(*measured, *by_clock))


def _measure_starts(clock: WallClock | None) -> tuple[MeasuredStart, ...]:
    """Return a start difference of 0 for each pair of cameras with wall times: their frames count from the same second.

    Its standard deviation is that of the recorders' clocks.
    """
    cameras = () if clock is None else clock.cameras
    return tuple(MeasuredStart(pair, 0.0, WALL_SIGMA_S, WALL_CLOCK) for pair in combinations(cameras, 2))


def assemble_inputs(scene: Scene, readings: list[CameraInput], *, compare_contents: bool = True) -> SceneInputs:
    """Combine the readings of all cameras to inputs. Raises `FileFaults` (an `InputError`) with all of their faults."""
    _raise_faults(scene, readings)
    rig = Rig(tuple(Camera(reading.name, reading.lens) for reading in readings if reading.lens is not None))
    findings = [finding for reading in readings for finding in reading.findings] + scene_findings(scene, readings)
    doubts = scene_doubts(scene, readings, compare_contents=compare_contents)
    return SceneInputs(
        rig, observations_of(scene, readings), tuple(findings), tuple(doubts),
        pointed_people(scene, readings), wall_clock_of(scene, readings), gaps=_gaps(readings),
        stated=find_stated_identities(scene, readings),
    )  # fmt: skip


def _gaps(readings: Sequence[CameraInput]) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return the gaps between pieces of recordings, and the parts of videos that were not processed, in frame numbers."""
    found = {
        reading.name: tuple(
            (first * reading.video.clock_fps + 1, last * reading.video.clock_fps + 1)
            for first, last in sorted((*gaps_of(reading.video), *reading.unprocessed))
        )
        for reading in readings
        if reading.video is not None
    }
    return {name: spans for name, spans in found.items() if spans}


def check_files(scene: Scene) -> None:
    """Raise `FileFaults` (an `InputError`) with all faults of the files that a scene names; no video is processed."""
    _raise_faults(scene, read_cameras(scene))


class NobodySeenError(FileFaults):
    """Fewer than two cameras saw people in the processed part of the videos; there is no other fault."""


def _raise_faults(scene: Scene, readings: list[CameraInput]) -> None:
    faults = [fault for reading in readings for fault in reading.faults] + scene_faults(scene, readings)
    if faults:
        kind = NobodySeenError if faults == _emptiness_faults(scene, readings) else FileFaults
        raise kind(list(dict.fromkeys(faults)))


def read_cameras(scene: Scene) -> list[CameraInput]:
    """Read the files of all cameras, as far as possible; of videos, only the metadata are read."""
    # A camera whose lens other cameras share is read before them.
    span = None
    faults: tuple[str, ...] = ()
    try:
        span = None if scene.unrecorded else choose_span(scene)
    except InputError as error:
        faults = faults_of(error)
    own = {name: read_camera(scene, name, span=span) for name in scene.cameras if scene.models[name][0] == name}
    readings = [own.get(name) or read_camera(scene, name, own[scene.models[name][0]], span) for name in scene.cameras]
    readings[0].faults += faults
    align_wall_clocks(scene, readings)
    correct_layouts(readings)
    if any(reading.fps is None for reading in readings):
        # If a rate is unknown, frame numbers are common to all cameras: the rate of one video does not hold for the others.
        for reading in readings:
            reading.fps = scene.fps_of(reading.name)
    return readings


def observations_of(scene: Scene, readings: list[CameraInput]) -> Observations:
    """Return the observations of the cameras, with their clocks."""
    fps = readings[0].fps if readings else None
    return Observations({reading.name: reading.seen for reading in readings}, fps, clocks_of(scene, readings))


def clocks_of(scene: Scene, readings: list[CameraInput]) -> dict[str, Clock]:
    """Return each camera's clock, with offset 0; empty if the same frame number is the same instant in all cameras.

    This is so if no frame rate is known, or if identities are given, all rates are equal and no offset is searched.
    """
    rates = {reading.name: reading.fps for reading in readings if reading.fps is not None}
    association = scene.association
    if association.given and len(set(rates.values())) == 1 and association.search_s == 0:
        return {}
    return {name: Clock(rate) for name, rate in rates.items()}


def scene_faults(scene: Scene, readings: list[CameraInput]) -> list[str]:
    """Return the faults between cameras, and those of the scene file's statements about them."""
    return [
        *_length_faults(scene, readings),
        *faults_of_people(scene, readings),
        *pointing_faults(scene, readings),
        *_lens_faults(scene, readings),
        *group_faults(scene, readings),
        *_joint_faults(scene, readings),
        *wand_faults(scene, readings),
        *_embedding_faults(scene, readings),
        *faults_of_same_video(scene, readings),
        *faults_of_same_file(scene, readings),
        *_find_short_videos(scene, readings),
        *_emptiness_faults(scene, readings),
        *world_faults(scene, {one.name: one.filmed_size for one in readings if one.filmed_size is not None}),
    ]


def scene_findings(scene: Scene, readings: list[CameraInput]) -> list[Finding]:
    """Return notices of unusual facts between cameras."""
    known = {
        int(who) for reading in readings for part in (reading.boxes, reading.keypoints) for who in np.unique(part.identity)
    }
    found = [
        notice("identity_unseen", place=str(scene.place), identity=cue.identity)
        for cue in scene.scale.people
        if cue.identity is not None and cue.identity not in known
    ]
    found += [*findings_of_people(scene, readings), *overlapped_people(scene, readings)]
    found += [*file_clock_findings(scene, readings), *findings_of_exchanged_streams(readings)]
    return (
        found + _note_guessed_lenses(scene, readings) + _clock_findings(scene, readings) + _embedding_findings(scene, readings)
    )


def _note_guessed_lenses(scene: Scene, readings: list[CameraInput]) -> list[Finding]:
    """Return notices of unknown intrinsics and of guessed focal lengths; guesses of equal sigma share one notice."""
    guessed: dict[float, list[str]] = {}
    for reading in readings:
        if reading.lens is not None and reading.lens.focal_sd is not None and not reading.lens.uncalibrated:
            guessed.setdefault(reading.lens.focal_sd, []).append(reading.name)
    refined = "focal" in scene.solver.refine
    unknown = [reading.name for reading in readings if reading.lens is not None and reading.lens.uncalibrated]
    return [
        *([notice("intrinsics_unknown", *unknown)] if unknown else []),
        *(
            notice("focal_guessed", *names, place=str(scene.place), sd_percent=100 * sd, refined=refined)
            for sd, names in guessed.items()
        ),
    ]


def _lens_faults(scene: Scene, readings: list[CameraInput]) -> list[str]:
    """Return a fault for unknown or guessed focal lengths if the method assumes exact ones."""
    guessed = [reading.name for reading in readings if reading.lens is not None and reading.lens.focal_sd is not None]
    unknown = [reading.name for reading in readings if reading.lens is not None and reading.lens.uncalibrated]
    if scene.solver.method == "geopose" and unknown:
        return [
            f'{scene.place}: [cameras.{unknown[0]}] has no intrinsics, but method "geopose" assumes that they are exact: add '
            'intrinsics, or use method "people"'
        ]
    if scene.solver.method != "geopose" or not guessed:
        return []
    return [
        f'{scene.place}: [cameras.{guessed[0]}] states focal_sd_percent, but method "geopose" assumes that focal lengths are '
        f'exact: delete it there and in the intrinsics, or use method "people"'
    ]


def scene_doubts(scene: Scene, readings: list[CameraInput], *, compare_contents: bool = True) -> list[Finding]:
    """Return the doubts that let no rig from these files be accepted.

    Their causes are images of another size or upside down, boxes in another format or not of bodies, and one camera twice.
    """
    known = [(reading, reading.lens) for reading in readings if reading.lens is not None]
    rig = Rig(tuple(Camera(reading.name, lens) for reading, lens in known))
    boxes = [turn_boxes(reading.seen.boxes, lens.size, -reading.rotate) for reading, lens in known]
    coarse = [notice_of_coarse_boxes(reading.name, own) for (reading, _), own in zip(known, boxes, strict=True)]
    return [
        *(doubt for reading in readings for doubt in reading.doubts),
        *doubts_of_people(scene, readings),
        *(one for one in coarse if one is not None),
        *(doubts_of_same_content(rig, observations_of(scene, readings)) if compare_contents else ()),
    ]


def _length_faults(scene: Scene, readings: list[CameraInput]) -> list[str]:
    sizes = {reading.name: reading.filmed_size for reading in readings}
    faults = []
    marked = [(f"[[scale.lengths]] {number}", one.points) for number, one in enumerate(scene.scale.lengths, start=1)]
    marked += [(f"[[scale.checks]] {number}", one.points or {}) for number, one in enumerate(scene.scale.checks, start=1)]
    for place, points in marked:
        for name, ends in points.items():
            size = sizes[name]
            if size is not None and not all(0 <= u <= size[0] and 0 <= v <= size[1] for u, v in ends):
                faults.append(
                    f"{scene.place}: {place} points: {[list(end) for end in ends]} lies outside the "
                    f"{size[0]} x {size[1]} image of camera {name}: give pixels of that image"
                )
    return faults


def _joint_faults(scene: Scene, readings: list[CameraInput]) -> list[str]:
    faults = []
    with_joints = [reading for reading in readings if len(reading.keypoints)]
    for reading in with_joints[1:]:
        if not set(reading.keypoints.joints) & set(with_joints[0].keypoints.joints):
            first = ", ".join(reading.keypoints.joints[:3])
            faults.append(
                f"{scene.place}: [cameras.{reading.name}] keypoints: none of its keypoints ({first}, ...) is one of the "
                f"keypoints of camera {with_joints[0].name}: use the same names for the same keypoints"
            )
    return faults


def _embedding_faults(scene: Scene, readings: list[CameraInput]) -> list[str]:
    """Return faults of embeddings with different dimensions, and of mode "appearance" without embeddings."""
    with_looks = [reading for reading in readings if reading.dimensions is not None]
    faults = [
        f"{scene.place}: [cameras.{reading.name}] embeddings have {reading.dimensions} dimensions, those of camera "
        f"{with_looks[0].name} {with_looks[0].dimensions}: take them from the same network"
        for reading in with_looks[1:]
        if reading.dimensions != with_looks[0].dimensions
    ]
    if scene.association.mode != "appearance":
        return faults
    remedy = 'give each camera embeddings or a video, or use another mode: under [association] set mode = "combined"'
    without = [reading for reading in readings if scene.cameras[reading.name].embeddings is None and reading.dimensions is None]
    without = [one for one in without if not needs_video(scene, one) and one.name not in scene.unrecorded]
    wanting = [reading.name for reading in without if reading.people]
    if len(without) == len(readings):
        return [*faults, f'{scene.place}: mode "appearance" needs embeddings, and no camera has any: {remedy}']
    return faults + [f'{scene.place}: [cameras.{name}] mode "appearance" needs embeddings: {remedy}' for name in wanting]


def _find_short_videos(scene: Scene, readings: list[CameraInput]) -> list[str]:
    """Return a fault for each video of which most must be missing, because the longest one is far longer."""
    seconds = {
        reading.name: count_recorded_s(reading.video) * reading.video.clock_fps / reading.fps
        for reading in readings
        if reading.video is not None and reading.video.seconds is not None and reading.fps is not None
    }
    if len(seconds) < 2:
        return []
    longest = max(seconds, key=lambda name: seconds[name])
    return [
        f"{reading.video.path}: camera {reading.name}: the video is {seconds[reading.name]:.1f} s long, that of camera "
        f"{longest} {seconds[longest]:.1f} s: was it cut short? Give all of it, cut the others to the same time, or delete "
        f"[cameras.{reading.name}] from {scene.place}"
        for reading in readings
        if reading.video is not None and seconds.get(reading.name, np.inf) < SHORT_VIDEO * seconds[longest]
    ]


def _emptiness_faults(scene: Scene, readings: list[CameraInput]) -> list[str]:
    """Return a fault if fewer than two cameras saw people and identities are not given; cameras without people are left out."""
    awake = [reading.name for reading in readings if reading.people]
    if scene.association.given or len(awake) > 1 or any(reading.faults or reading.awaiting for reading in readings):
        return []
    none = "no camera saw anybody: " + (
        "no person was detected in their videos"
        if any(table.watched for table in scene.cameras.values())
        else "their files have no rows"
    )
    who = f"only camera {awake[0]} saw anybody" if awake else none
    return [f"{scene.place}: {who}: a calibration needs people in two cameras or more"]


def _clock_findings(scene: Scene, readings: list[CameraInput]) -> list[Finding]:
    """Return a notice if frame rates are missing, or contradict the lengths of the recordings."""
    if all(reading.fps is None for reading in readings):
        # A recording that does not exist yet, or cannot be read, may have a rate.
        if scene.association.search_s == 0 or scene.unrecorded or any(reading.faults for reading in readings):
            return []
        return [notice("frame_rate_missing", place=str(scene.place))]
    spans = {
        reading.name: (seen[0], seen[-1], reading.fps)
        for reading in readings
        if reading.fps is not None and len(seen := reading.frames) > 1
    }
    seconds = {name: float((last - first) / fps) for name, (first, last, fps) in spans.items()}
    if not seconds or max(seconds.values()) <= SPAN_RATIO * min(seconds.values()):
        return []
    usual = float(np.exp(np.median(np.log(list(seconds.values())))))
    odd = [name for name in seconds if max(seconds[name] / usual, usual / seconds[name]) >= SPAN_RATIO**0.5]
    told = [
        {"camera": name, "seconds": seconds[name], "frames": [int(first), int(last)], "fps": fps}
        for name, (first, last, fps) in spans.items()
        if name in odd
    ]
    others_s = usual if len(odd) < len(seconds) else None
    return [notice("recordings_differ", *odd, place=str(scene.place), spans=told, usual_s=others_s)]


def _embedding_findings(scene: Scene, readings: list[CameraInput]) -> list[Finding]:
    """Return a notice if, in mode "combined", some cameras have embeddings and others have none."""
    without = [reading.name for reading in readings if reading.people and reading.dimensions is None]
    if scene.association.mode != "combined" or not without or all(reading.dimensions is None for reading in readings):
        return []
    return [notice("embeddings_missing", *without, place=str(scene.place))]


def part_of(inputs: SceneInputs, names: Collection[str]) -> SceneInputs:
    """Return the inputs of some cameras, in the order of the rig.

    Doubts about the whole scene also hold for the part; notices are only those about its cameras.

    Args:
        inputs: the inputs of all cameras.
        names: the cameras of the part.
    """
    inside = [camera for camera in inputs.rig if camera.name in names]
    seen = inputs.observations
    own = [camera.name for camera in inside]
    clocks = {name: seen.clocks[name] for name in own if name in seen.clocks}
    fps = clocks[own[0]].fps if own and own[0] in clocks else seen.fps
    return replace(
        inputs,
        rig=Rig(tuple(inside)),
        observations=Observations({name: seen[name] for name in own}, fps, clocks),
        findings=tuple(finding for finding in inputs.findings if _is_about(finding, own)),
        doubts=tuple(finding for finding in inputs.doubts if not finding.cameras or _is_about(finding, own)),
        pointed=tuple(one for one in inputs.pointed if one.camera in own),
        stated=inputs.stated.within(own),
        measured=tuple(one for one in inputs.measured if set(one.cameras) <= set(own)),
        gaps={name: spans for name, spans in inputs.gaps.items() if name in own},
        elsewhere=(*inputs.elsewhere, *(camera for camera in inputs.rig if camera.name not in names)),
    )


def _is_about(finding: Finding, names: Collection[str]) -> bool:
    """Return whether a finding is about one of the cameras."""
    return any(name in names for name in finding.cameras)
