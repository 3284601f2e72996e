"""Reading of one camera's files: they are read, compared with each other, and reported.

*Faults* make an input unusable. *Findings* are unusual facts that do not stop a calibration. With *doubts*, no rig is accepted.
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
"""Maximum relative difference of equal frame rates. 30 and 29.97 frames per second differ by a thousandth: half a second in
eight minutes."""
SHORTEST, FRAMES_TO_TRACK = 3, 6
"""Tracklets with fewer rows show no trajectory. If most rows have such ids, and there are at least this many frames, the ids
are not those of tracklets."""


def read_camera(scene: Scene, name: str, model: CameraInput | None = None, span: WallSpan | None = None) -> CameraInput:
    """Read one camera's files; faults are collected, not raised.

    Args:
        scene: the scene.
        name: the camera.
        model: the camera that has the same lens, if the scene names one; None: it is read here.
        span: the used part of recordings with wall times; None: all.
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
    """Read the keypoints of a file, or of a folder with one file per frame. Raises `InputError`."""
    if not path.is_dir():
        return read_keypoints(path, doubles=True)
    people = read_people_as("openpose", path)
    reading.findings += [notice("keypoints_folder", reading.name, place=str(path), why=why) for why in people.notes]
    return people.keypoints


def _read_intrinsics(scene: Scene, reading: CameraInput, path: Path | None, focal_sd_percent: float | None) -> None:
    """Read the lens from a file of intrinsics, if there is one, and convert it to the turned images."""
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
    """Convert boxes and keypoints from the images as filmed, to which files refer, to the turned images."""
    size = reading.filmed_size
    if size is not None and reading.rotate:
        reading.boxes = turn_boxes(reading.boxes, size, reading.rotate)
        reading.keypoints = turn_keypoints(reading.keypoints, size, reading.rotate)
        reading.wands = turn_keypoints(reading.wands, size, reading.rotate)


def input_from_memory(scene: Scene, name: str, lens: Lens, boxes: Boxes, keypoints: Keypoints) -> CameraInput:
    """Make the input of a camera from values in memory, and check it as files are checked.

    Faults are collected, not raised, except `InputError` for a lens that cannot be turned.
    """
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
    """Return whether a camera's video must still be processed: for people, for their appearance, or for their joints."""
    if reading.video is None or reading.faults:
        return False
    return reading.awaiting or needs_embeddings(scene, reading) or needs_keypoints(scene, reading)


def needs_embeddings(scene: Scene, reading: CameraInput) -> bool:
    """Return whether a camera's boxes lack embeddings that the mode uses and its video can give."""
    useful = scene.association.mode in ("combined", "appearance") and scene.perception.embedder != "none"
    return useful and reading.boxes.embedding is None and (reading.awaiting or len(reading.boxes) > 0)


def needs_keypoints(scene: Scene, reading: CameraInput) -> bool:
    """Return whether a camera lacks keypoints that are requested, or that its video can give when it is processed anyway."""
    wanted = scene.perception.keypoints
    if wanted == "none" or reading.keypoints_path is not None:
        return False
    # With boxes from a file, the video is not processed only for keypoints that were not requested.
    return wanted != "auto" or reading.awaiting or needs_embeddings(scene, reading)


def add_video_results(scene: Scene, reading: CameraInput, boxes: Boxes, keypoints: Keypoints) -> None:
    """Complete a reading by the results from its video; the boxes are those that were read, if there were any."""
    reading.boxes, path = boxes, reading.video.path if reading.video else None
    if len(keypoints):
        reading.keypoints, reading.keypoints_path = keypoints, path
    if reading.awaiting:
        reading.boxes_path, reading.awaiting = path, False
        keep_used(scene, reading)
        _check_people(scene, reading)


def _settle_doubles(reading: CameraInput) -> None:
    """Keep each person only once per frame, in boxes and in joints."""
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
    """Check the people of a camera, by the mode of the association."""
    (_check_identities if reading.given else _check_sources)(scene, reading)


def _check_video(scene: Scene, reading: CameraInput, video: VideoInfo) -> None:
    """Compare a video's size with that of the lens, and its frame rate with that of the scene file."""
    place, lens = str(video.path), reading.filmed_lens
    if lens is not None:
        try:
            filmed = turn_size(video.size, reading.rotate)
            if fit_of_size(filmed, lens.size, (video.rotation + reading.rotate) % 360) == "cropped":
                sizes = {"video_size": list(filmed), "size": list(lens.size)}
                # The missing part is at the right and bottom of the images as filmed; after a turn it may be at the origin.
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
    """Return the result of `read` for a file; None for no file, and None with its faults added if it fails."""
    if path is None:
        return None
    try:
        return read(path)
    except InputError as error:
        faults += faults_of(error)
        return None


def _open_video(scene: Scene, reading: CameraInput, span: WallSpan | None) -> None:
    """Read the metadata of a camera's video, if it has one; a fault names the camera."""
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
    """Read the times of the frames; give them to the video, and renumber the frames of boxes and keypoints by them."""
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
    """Return an error about a video that also names its camera."""
    return InputError(f"{error} (the video of camera {name})")


def _add_embeddings(path: Path, boxes_path: Path, boxes: Boxes) -> Boxes:
    """Add the embeddings of a file to boxes, row by row. Raises `InputError` if the rows do not correspond."""
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
    """Add notices about a camera's files for all modes except "given", which accept any rows, even none.

    Ids of tracklets that are too short are removed.
    """
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
    """Count the rows whose id occurs in fewer than `SHORTEST` rows."""
    known = part.identity[part.identity > UNKNOWN]
    _, count = np.unique(known, return_counts=True)
    return int(count[count < SHORTEST].sum())


def _check_identities(scene: Scene, reading: CameraInput) -> None:
    """Check that people have identities, as mode "given" needs."""
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
