"""One camera's files: read, checked against each other, and reported.

*Faults* make an input unusable; *findings* are odd, but do not stop a calibration; *doubts* let no rig be accepted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.observations import UNKNOWN, Boxes, Keypoints
from passerby.core.quarter_turns import turn_boxes, turn_keypoints, turn_lens, turn_size
from passerby.findings.finding import notice
from passerby.findings.texts import text_of
from passerby.interchange.coco import read_keypoints
from passerby.interchange.formats import read_people_as
from passerby.interchange.formats.skeletons import standard_names
from passerby.interchange.motchallenge import read_boxes, read_embeddings
from passerby.interchange.rig_toml import read_lens
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.perception.pictures import VideoError
from passerby.perception.sources.files import WallSpan
from passerby.perception.sources.frame_times import TYPICAL_STEP_S, apply_times, read_frame_times
from passerby.perception.sources.recording import open_source
from passerby.perception.video import VideoInfo, fit_of_size
from passerby.scene.camera_input import CameraInput, KnownLens
from passerby.scene.joint_layouts import take_wands
from passerby.scene.lens_sources import check_principal_point, find_lens, source_of_size
from passerby.scene.scene import Scene
from passerby.scene.used_rows import keep_used, remove_duplicates
from passerby.scene.wall_clock import source_of

T = TypeVar("T")

SAME_RATE = 0.005
"""30 and 29.97 frames per second differ by a thousandth: half a second in eight minutes."""
SHORTEST, FRAMES_TO_TRACK = 3, 6
"""Tracklets of fewer rows show no trajectory. Where most ids are such, and there are so many frames, they were no tracklets."""


def read_camera(scene: Scene, name: str, model: CameraInput | None = None, span: WallSpan | None = None) -> CameraInput:
    """Read one camera's files; faults are gathered, not raised.

    Args:
        scene: the scene.
        name: the camera.
        model: the camera whose lens is the same, where the scene names one; read here where it is not given.
        span: what is used of recordings with wall times.
    """
    if model is None and scene.models[name][0] != name:
        model = read_camera(scene, scene.models[name][0])
    table, given = scene.cameras[name], scene.association.given
    reading = CameraInput(name, given, fps=scene.fps_of(name), rotate=table.rotate)

    def path_of(path: Path | None) -> Path | None:
        return None if path is None else scene.resolve(path)

    _read_intrinsics(scene, reading, path_of(table.intrinsics), table.focal_sd_percent)
    rows_of = partial(read_boxes, doubles=True, box_format=scene.box_format(name))
    joints_of = partial(_read_joints, reading)
    tracks = _attempt(rows_of, path_of(table.tracks), reading.faults)
    detections = _attempt(rows_of, path_of(table.detections), reading.faults)
    own, own_path = (tracks, table.tracks) if table.tracks is not None else (detections, table.detections)
    appearance = path_of(table.embeddings)
    if appearance is not None and own is not None and own_path is not None:
        boxes, boxes_path = own, scene.resolve(own_path)
        own = _attempt(lambda path: _add_embeddings(path, boxes_path, boxes), appearance, reading.faults) or boxes
    if own_path is not None and (table.tracks is not None or not given):
        reading.boxes, reading.boxes_path = own or reading.boxes, scene.resolve(own_path)
    reading.keypoints_path = path_of(table.keypoints)
    reading.keypoints = _attempt(joints_of, reading.keypoints_path, reading.faults) or reading.keypoints
    unrecorded = name in scene.unrecorded
    if not unrecorded:
        _open_video(scene, reading, span)
    _read_times(reading, path_of(table.times))
    if table.intrinsics is None and not unrecorded:
        find_lens(scene, reading, model)
    elif reading.lens is not None and reading.lens.uncalibrated and len(scene.models[name]) > 1:
        reading.lens = replace(reading.lens, group=name)
    if scene.box_format(name).normalised and reading.filmed_size is not None:
        reading.boxes = replace(reading.boxes, ltwh=reading.boxes.ltwh * np.tile(reading.filmed_size, 2))
    take_wands(scene, reading)
    _name_joints(reading)
    _settle_doubles(reading)
    if reading.video is not None:
        _check_video(scene, reading, reading.video)
    reading.awaiting = table.watched
    if reading.filmed_lens is not None:
        check_principal_point(scene, reading, reading.filmed_lens)
    _turn_people(reading)
    keep_used(scene, reading)
    if not reading.awaiting:
        _check_people(scene, reading)
    return reading


def _read_joints(reading: CameraInput, path: Path) -> Keypoints:
    """The keypoints of a file, or of a folder with a file a frame. Raises `InputError`."""
    if not path.is_dir():
        return read_keypoints(path, doubles=True)
    people = read_people_as("openpose", path)
    reading.findings += [notice("keypoints_folder", reading.name, place=str(path), why=why) for why in people.notes]
    return people.keypoints


def _read_intrinsics(scene: Scene, reading: CameraInput, path: Path | None, focal_sd_percent: float | None) -> None:
    """The lens in a file of intrinsics, if there is one, of the turned images."""
    filmed = _attempt(lambda path: read_lens(path, reading.name), path, reading.faults)
    if filmed is None:
        return
    if filmed.rotate not in (0, reading.rotate):
        reading.faults.append(
            f"{path}: [{reading.name}] has rotate = {filmed.rotate}, but [cameras.{reading.name}] in {scene.place} "
            f"{f'rotate = {reading.rotate}' if reading.rotate else 'has no rotate'}: give both the same"
        )
        return
    try:
        reading.lens = turn_lens(replace(filmed, rotate=reading.rotate), reading.rotate)
    except InputError as error:
        reading.faults.append(f"{path}: [{reading.name}]: {error}: turn its video instead, and delete rotate")
        return
    if focal_sd_percent is not None:
        reading.lens = replace(reading.lens, focal_sd=focal_sd_percent / 100)
    unknown = reading.lens.uncalibrated and reading.lens.focal_sd == LARGEST_FOCAL_SD
    reading.lens_source = KnownLens("people" if unknown else "file", str(path))


def _turn_people(reading: CameraInput) -> None:
    """Boxes and keypoints that files have of the images as filmed, in the turned images."""
    size = reading.filmed_size
    if size is not None and reading.rotate:
        reading.boxes = turn_boxes(reading.boxes, size, reading.rotate)
        reading.keypoints = turn_keypoints(reading.keypoints, size, reading.rotate)
        reading.wands = turn_keypoints(reading.wands, size, reading.rotate)


def input_from_memory(scene: Scene, name: str, lens: Lens, boxes: Boxes, keypoints: Keypoints) -> CameraInput:
    """What is reported of a camera without any file, checked as files are; faults are gathered, not raised."""
    try:
        upright = turn_lens(lens, lens.rotate)
    except InputError as error:
        raise InputError(f"camera {name}: {error}") from None
    reading = CameraInput(
        name, scene.association.given, lens.rotate, upright, boxes=boxes, boxes_path=Path("boxes"), keypoints=keypoints,
        fps=scene.fps_of(name),
    )  # fmt: skip
    _turn_people(reading)
    reading.keypoints_path = Path("keypoints") if len(keypoints) else None
    take_wands(scene, reading)
    _name_joints(reading)
    _settle_doubles(reading)
    keep_used(scene, reading)
    check_principal_point(scene, reading, lens)
    _check_people(scene, reading)
    return reading


def _name_joints(reading: CameraInput) -> None:
    """Give the joints the names that the person model knows."""
    reading.keypoints = replace(reading.keypoints, joints=standard_names(reading.keypoints.joints))


def needs_video(scene: Scene, reading: CameraInput) -> bool:
    """Whether something of a camera is still to be got from its video: its people, how they look, or their joints."""
    if reading.video is None or reading.faults:
        return False
    return reading.awaiting or needs_embeddings(scene, reading) or needs_keypoints(scene, reading)


def needs_embeddings(scene: Scene, reading: CameraInput) -> bool:
    """Whether a camera's boxes lack embeddings that its video could give and the mode would use."""
    useful = scene.association.mode in ("combined", "appearance") and scene.perception.embedder != "none"
    return useful and reading.boxes.embedding is None and (reading.awaiting or len(reading.boxes) > 0)


def needs_keypoints(scene: Scene, reading: CameraInput) -> bool:
    """Whether a camera's boxes lack joints that are asked for, or that its video may give, too."""
    wanted = scene.perception.keypoints
    if wanted == "none" or reading.keypoints_path is not None:
        return False
    # A user who gave boxes has no video read for keypoints that were not asked for.
    return wanted != "auto" or reading.awaiting or needs_embeddings(scene, reading)


def add_video_results(scene: Scene, reading: CameraInput, boxes: Boxes, keypoints: Keypoints) -> None:
    """Complete a reading by what was seen in its video; the boxes are those that were read where there were any."""
    reading.boxes, path = boxes, reading.video.path if reading.video else None
    if len(keypoints):
        reading.keypoints, reading.keypoints_path = keypoints, path
    if reading.awaiting:
        reading.boxes_path, reading.awaiting = path, False
        keep_used(scene, reading)
        _check_people(scene, reading)


def _settle_doubles(reading: CameraInput) -> None:
    """Each person once in a frame, in boxes and in joints."""
    reading.boxes, boxes = remove_duplicates(reading.boxes)
    reading.keypoints, joints = remove_duplicates(reading.keypoints)
    for path, doubled in ((reading.boxes_path, boxes), (reading.keypoints_path, joints)):
        if doubled is not None:
            finding = doubled.finding(str(path), reading.name)
            if doubled.is_rule:
                reading.faults.append(text_of(finding))
            else:
                reading.findings.append(finding)


def _check_people(scene: Scene, reading: CameraInput) -> None:
    """What can be said of a camera with known people."""
    (_check_identities if reading.given else _check_sources)(scene, reading)


def _check_video(scene: Scene, reading: CameraInput, video: VideoInfo) -> None:
    """A video against the lens, and its rate against what the scene file says."""
    place, lens = str(video.path), reading.filmed_lens
    if lens is not None:
        try:
            filmed = turn_size(video.size, reading.rotate)
            if fit_of_size(filmed, lens.size, (video.rotation + reading.rotate) % 360) == "cropped":
                sizes = {"video_size": list(filmed), "size": list(lens.size)}
                # What is missing is right and below in the images as filmed; turned, it may be where the origin is.
                reading.lens = turn_lens(replace(lens, size=filmed), reading.rotate) if reading.rotate else reading.lens
                reading.findings.append(notice("video_cropped", reading.name, place=place, **sizes))
        except InputError as error:
            stated = source_of_size(scene, reading.name)
            reading.faults.append(f"{place}: camera {reading.name}: {error} (the lens is in {stated}, [{reading.name}])")
    if reading.fps is None or video.variable:
        if reading.fps is not None and not video.frame_times:
            reading.findings.append(notice("video_rate_variable", reading.name, place=place))
        reading.fps = video.clock_fps
    elif abs(reading.fps / video.clock_fps - 1) > SAME_RATE:
        rates = {"video_fps": video.clock_fps, "fps": reading.fps}
        reading.findings.append(notice("video_rate_differs", reading.name, place=place, **rates))


def _attempt(read: Callable[[Path], T], path: Path | None, faults: list[str]) -> T | None:
    """What `read` makes of the file, or None with its faults added."""
    if path is None:
        return None
    try:
        return read(path)
    except InputError as error:
        faults += faults_of(error)
        return None


def _open_video(scene: Scene, reading: CameraInput, span: WallSpan | None) -> None:
    """What a video tells of itself, where there is one; a fault names its camera."""
    source = source_of(scene, reading.name, span)
    if source is None:
        return
    try:
        found = open_source(source, reading.name)
    except InputError as error:
        reading.faults += faults_of(name_video_error(error, reading.name))
        return
    reading.video = found.info
    reading.findings += found.findings


def _read_times(reading: CameraInput, path: Path | None) -> None:
    """The times of the frames: of the video, and of the boxes and keypoints, which then have frame numbers by them."""
    if path is None:
        return
    try:
        times = read_frame_times(path, TYPICAL_STEP_S if reading.video is None else 1.0 / reading.video.average_fps)
        reading.boxes = replace(reading.boxes, frame=times.renumbered(reading.boxes.frame, reading.name))
        reading.keypoints = replace(reading.keypoints, frame=times.renumbered(reading.keypoints.frame, reading.name))
        if reading.video is not None:
            reading.video = apply_times(reading.video, times)
    except VideoError as error:
        reading.faults += faults_of(name_video_error(error, reading.name))
    except InputError as error:
        reading.faults += faults_of(error)


def name_video_error(error: InputError, name: str) -> InputError:
    """An error with a video, with its camera."""
    return InputError(f"{error} (the video of camera {name})")


def _add_embeddings(path: Path, boxes_path: Path, boxes: Boxes) -> Boxes:
    """The boxes with the embeddings of a file, row by row. Raises `InputError` where the rows do not belong together."""
    found = read_embeddings(path)
    if len(found) != len(boxes):
        raise InputError(
            f"{path}: {len(found)} embeddings for {len(boxes)} boxes: give one row for each row of {boxes_path}, in its order"
        )
    if found.frame is not None and (found.frame != boxes.frame).any():
        row = int(np.flatnonzero(found.frame != boxes.frame)[0])
        raise InputError(
            f"{path}: row {row + 1} is of frame {found.frame[row]}, but that row of {boxes_path} is of frame "
            f"{boxes.frame[row]}: give the rows in the order of that file"
        )
    return replace(boxes, embedding=found.vectors)


def _check_sources(scene: Scene, reading: CameraInput) -> None:
    """All modes but "given": anything will do, even nothing."""
    table, place = scene.cameras[reading.name], str(scene.place)
    if table.tracks is not None and table.detections is not None:
        reading.findings.append(notice("detections_unused", reading.name, place=place))
    if not reading.people and not reading.faults:
        reading.findings.append(notice("camera_saw_nobody", reading.name, place=place, watched=table.watched))
    for path, name in ((reading.boxes_path, "boxes"), (reading.keypoints_path, "keypoints")):
        part: Boxes | Keypoints = getattr(reading, name)
        short = _rows_of_short_tracklets(part)
        if short > 0.5 * len(part) and len(reading.frames) >= FRAMES_TO_TRACK:
            setattr(reading, name, replace(part, identity=np.full(len(part), UNKNOWN)))
            counts = {"short": short, "rows": len(part), "least": SHORTEST}
            reading.findings.append(notice("ids_no_tracklets", reading.name, place=str(path), **counts))


def _rows_of_short_tracklets(part: Boxes | Keypoints) -> int:
    """How many rows have an id that almost no other row has."""
    known = part.identity[part.identity > UNKNOWN]
    _, count = np.unique(known, return_counts=True)
    return int(count[count < SHORTEST].sum())


def _check_identities(scene: Scene, reading: CameraInput) -> None:
    """Mode "given": people need identities."""
    table, place = scene.cameras[reading.name], f"{scene.place}: [cameras.{reading.name}]"
    if table.tracks is None and table.keypoints is None:
        reading.faults.append(
            f'{place} has only detections, which carry no identities: mode "given" needs `tracks` or `keypoints` with '
            'identities that are the same in all cameras; mode "combined" finds them'
        )
        return
    for key, path in (("detections", table.detections), ("embeddings", table.embeddings)):
        if path is not None:
            reading.findings.append(notice("unused_with_identities", reading.name, place=str(scene.place), key=key))
    for path, part, key in (
        (reading.boxes_path, reading.boxes, "id"),
        (reading.keypoints_path, reading.keypoints, "track_id"),
    ):
        if path is None:
            continue
        unknown = int((part.identity == UNKNOWN).sum())
        if len(part) and unknown == len(part):
            reading.faults.append(
                f'{path}: camera {reading.name}: no row has an identity ({key}): mode "given" needs them, '
                'the same number for the same person in all cameras; mode "combined" finds them'
            )
        elif unknown:
            counts = {"unknown": unknown, "rows": len(part)}
            reading.findings.append(notice("rows_without_identity", reading.name, place=str(path), **counts))
        elif not len(part) and not reading.faults:
            reading.findings.append(notice("file_empty", reading.name, place=str(path)))
