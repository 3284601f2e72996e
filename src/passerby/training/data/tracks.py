"""People cut out of videos by their tracks: scene files, folders of videos and text, and MOTChallenge's sequences."""

from __future__ import annotations

import configparser
import io
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from passerby.common.arrays import Ints
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.common.text import shortened_text
from passerby.core.observations import LTWH, UNKNOWN, Boxes
from passerby.findings.texts import text_of
from passerby.interchange.motchallenge import LARGEST_WHOLE, read_boxes
from passerby.interchange.storage.safe_parsing import read_text
from passerby.perception.pieces import VIDEO_ENDINGS
from passerby.scene.scene import Scene
from passerby.scene.start.folders import visible_files, visible_folders
from passerby.scene.start.recordings_found import VIDEO_FOLDERS
from passerby.scene.used_rows import remove_duplicates
from passerby.training.crops import DataSet, describe_faults
from passerby.training.data.cutting import (
    PER_PERSON,
    WantedCrops,
    cut_crops,
    find_clear_boxes,
    one_file,
    source_size,
    spread_rows,
)

TEXT_FOLDERS = ("truth", "identities", "tracks")
"""Folders that are searched for the text of videos, if it is not in the folder of the videos."""
SEQUENCE = "seqinfo.ini"
MOT_PEDESTRIAN = 1
MOT_COLUMNS = 6
MOT_VISIBLE = 0.5
"""Minimum visible share of a box, by MOTChallenge's annotators; `is_recognisable` also requires half of a box."""
MOT_DETECTORS = ("-DPM", "-FRCNN", "-SDP")
"""Endings of names: MOT17 has each sequence three times, with the same pictures and the same truth."""


@dataclass(frozen=True, eq=False)
class TrackedCamera:
    """A camera with its boxes."""

    name: str
    source: Path
    """A video, or a folder of pictures; see `WantedCrops`."""
    boxes: Boxes
    hidden: NDArray[np.bool_] | None = None
    """(N,) whether more than half of a box is known to be hidden; None: unknown."""


def tracked_people(
    name: str,
    cameras: Sequence[TrackedCamera],
    cache: Path,
    *,
    given: bool,
    notes: Sequence[str] = (),
    per_person: int = PER_PERSON,
    executor: Executor | None = None,
    tell: Progress = silent,
) -> DataSet:
    """Make a data set for training from the people of tracks, without query and gallery.

    Args:
        name: name of the data set.
        cameras: cameras with their boxes; identity -1 is unknown.
        cache: folder of the crops; see `cut_crops`.
        given: the identities are the same in all cameras, and two of them are two people. Otherwise each camera has its own
            identities, and only those seen in one frame are known to be different: see `CropSet.apart`.
        notes: earlier notes to report.
        per_person: maximum number of crops of a person by a camera.
        executor: cuts the cameras in parallel.
        tell: called with the cutting.

    Raises `InputError` if a video cannot be read, or no person has two crops.
    """
    own = [np.unique(camera.boxes.identity[camera.boxes.identity > UNKNOWN]) for camera in cameras]
    if given:
        every = np.unique(np.concatenate([np.zeros(0, np.int64), *own]))
        people = [str(identity) for identity in every.tolist()]
        firsts, tables = [0] * len(cameras), [every] * len(cameras)
    else:
        people = [f"{camera.name}-{one}" for camera, table in zip(cameras, own, strict=True) for one in table.tolist()]
        firsts, tables = np.cumsum([0, *map(len, own)])[:-1].tolist(), own
    persons = [_rows(camera.boxes.identity, *at) for camera, at in zip(cameras, zip(tables, firsts, strict=True), strict=True)]
    wanted = [_choose_boxes(camera, person, per_person) for camera, person in zip(cameras, persons, strict=True)]
    cut = cut_crops(wanted, people, cache, name=name, executor=executor, tell=tell)
    crops = cut.crops
    if not given:
        crops = replace(crops, apart=_find_seen_together(cameras, persons, len(people)))
    count = np.bincount(crops.person, minlength=len(people))
    few = [person for person, n in zip(crops.people, count.tolist(), strict=True) if n < 2]
    told_of = [
        *notes,
        *cut.notes,
        *describe_faults(few, f"{len(few)} people without two clear frames, kept out of the training"),
    ]
    if not (count >= 2).any():
        places = ", ".join(str(camera.source) for camera in cameras)
        raise InputError(
            f"{places}: {'; '.join(told_of) or 'their tracks hold no people'}: none is left to learn from: give tracks whose "
            "frame numbers and pixels are the video's"
        )
    return DataSet(name, train=crops.of_people(count >= 2), notes=tuple(told_of))


def _rows(identity: Ints, table: Ints, first: int) -> Ints:
    """Return the rows (N,) of the people by their identity; -1 if unknown."""
    if not len(table):
        return np.full(len(identity), -1)
    return np.where(identity > UNKNOWN, first + np.searchsorted(table, identity), -1)


def _choose_boxes(camera: TrackedCamera, person: Ints, per_person: int) -> WantedCrops:
    """Choose the boxes of a camera to cut: clear, and spread over time."""
    boxes = camera.boxes
    rows: Ints = np.zeros(0, dtype=np.int64)
    if len(boxes):
        clear = find_clear_boxes(boxes.frame, boxes.ltwh, source_size(camera.source))
        rows = spread_rows(boxes.frame, person, clear if camera.hidden is None else clear & ~camera.hidden, per_person)
    return WantedCrops(camera.name, camera.source, boxes.frame[rows], boxes.ltwh[rows], person[rows])


def _find_seen_together(cameras: Sequence[TrackedCamera], persons: Sequence[Ints], n_people: int) -> NDArray[np.bool_]:
    """Return whether one camera saw two people in one frame, (P, P)."""
    apart = np.zeros((n_people, n_people), dtype=np.bool_)
    for camera, person in zip(cameras, persons, strict=True):
        known = person >= 0
        frames, frame = np.unique(camera.boxes.frame[known], return_inverse=True)
        ones = np.ones(int(known.sum()), dtype=np.int32)
        seen = csr_array((ones, (person[known], frame)), shape=(n_people, len(frames)))
        together = (seen @ seen.T).tocoo()
        apart[together.row, together.col] = True
    np.fill_diagonal(apart, False)
    return apart


def cameras_of_scene(path: Path) -> tuple[list[TrackedCamera], bool, list[str]]:
    """Read the cameras of a scene file that have a video and tracks; also return whether the identities are global, and notes.

    Raises `InputError` for a scene file that cannot be read, and if no camera has both.
    """
    scene = Scene.load(path)
    cameras, notes = [], []
    for name, table in scene.cameras.items():
        if not table.videos or table.tracks is None:
            missing = "video" if not table.videos else "tracks"
            notes.append(f"{path}: camera {name} has no {missing}: left out")
            continue
        if scene.box_format(name) != LTWH:
            raise InputError(
                f'{path}: [cameras.{name}] its boxes are {scene.box_format(name)}: training reads boxes = "ltwh" only'
            )
        source = one_file([scene.resolve(video) for video in table.videos], name, folders=True)
        cameras.append(TrackedCamera(name, source, _boxes_of(scene.resolve(table.tracks), notes)))
    if not cameras:
        raise InputError(f"{path}: no camera has both `video` and `tracks`: crops are cut out of a video by its tracks")
    return cameras, scene.association.given, notes


def videos_of(path: Path) -> list[Path]:
    """Find the videos of a folder: in it, or otherwise in its folder called `video` or `videos`."""
    places = [path, *(inner for inner in visible_folders(path) if inner.name.lower() in VIDEO_FOLDERS)]
    return next((found for place in places if (found := visible_files(place, VIDEO_ENDINGS))), [])


def cameras_of_folder(path: Path) -> tuple[list[TrackedCamera], list[str]]:
    """Read the videos of a folder with MOTChallenge text of the same stem in their folder or one of `TEXT_FOLDERS`; and notes.

    All text is taken from the first of these folders that has any, because identities of two folders may differ. Raises
    `InputError` if none has any.
    """
    videos = videos_of(path)
    texts: dict[Path, Path] = {}
    for place in (None, *(path / name for name in TEXT_FOLDERS)):
        beside = {video: (video.parent if place is None else place) / f"{video.stem}.txt" for video in videos}
        texts = {video: text for video, text in beside.items() if text.is_file()}
        if texts:
            break
    if not texts:
        raise InputError(
            f"{path}: holds videos, but no tracks of people: put MOTChallenge text beside them ({videos[0].stem}.txt beside "
            f"{videos[0].name}), or into {path / 'tracks'}"
        )
    without = [video for video in videos if video not in texts]
    notes = [*describe_faults(without, f"{len(without)} videos without tracks, left out")]
    return [TrackedCamera(video.stem, video, _boxes_of(text, notes)) for video, text in texts.items()], notes


def _boxes_of(path: Path, notes: list[str]) -> Boxes:
    """Read the boxes of a file, each person once in a frame; duplicates are left out, with a note.

    Raises `InputError` for a file that cannot be read, or that has too many duplicates.
    """
    boxes, doubled = remove_duplicates(read_boxes(path, doubles=True))
    if doubled is not None and doubled.is_rule:
        raise InputError(text_of(doubled.finding(str(path))))
    notes += [] if doubled is None else [text_of(doubled.finding(str(path)))]
    return boxes


def sequences_of(path: Path) -> list[Path]:
    """Find the MOTChallenge sequences of a folder: the folder itself, or those in it, each once."""
    if (path / SEQUENCE).is_file():
        return [path]
    found: dict[str, Path] = {}
    for inner in visible_folders(path):
        if (inner / SEQUENCE).is_file():
            stem = next((inner.name.removesuffix(end) for end in MOT_DETECTORS if inner.name.endswith(end)), inner.name)
            found.setdefault(stem, inner)
    return list(found.values())


def camera_of_sequence(folder: Path) -> TrackedCamera:
    """Read a MOTChallenge sequence: seqinfo.ini, a folder of pictures and gt/gt.txt. Raises `InputError` if one is missing.

    Rows that the evaluation of MOTChallenge ignores (confidence 0, classes other than pedestrian) are left out.
    """
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(folder / SEQUENCE, "the description of a MOTChallenge sequence"))
    except configparser.Error as error:
        why = shortened_text(str(error).splitlines()[0])
        raise InputError(f"{folder / SEQUENCE}: is not a description of a sequence: {why}") from None
    named = parser.get("Sequence", "imDir", fallback="img1")
    pictures = folder / named
    try:
        found = pictures.is_dir()
    except OSError:  # a name that no file can have
        found = False
    if not found:
        raise InputError(
            f"{folder / SEQUENCE}: imDir is {shortened_text(named)}: no such folder: it must hold the frames of the sequence"
        )
    boxes, hidden = _read_truth(folder / "gt" / "gt.txt")
    return TrackedCamera(parser.get("Sequence", "name", fallback=folder.name), pictures, boxes, hidden)


def _read_truth(path: Path) -> tuple[Boxes, NDArray[np.bool_]]:
    """Read the pedestrians of a gt.txt with rows in any order, and whether more than half of each box is hidden, (N,)."""
    text = read_text(path, "the true tracks (gt.txt) of a MOTChallenge sequence")
    try:
        rows = np.loadtxt(io.StringIO(text), delimiter=",", comments=None, ndmin=2) if text.strip() else np.zeros((0, 9))
    except ValueError as error:
        raise InputError(f"{path}: is not MOTChallenge text: {error}") from None
    if rows.shape[1] < MOT_COLUMNS or not (np.abs(rows) <= LARGEST_WHOLE).all():
        raise InputError(
            f"{path}: {rows.shape[1]} columns: frame, id, left, top, width, height as numbers are needed in each row"
        )
    whole = (rows[:, 0] >= 0) & (rows[:, :2] == np.floor(rows[:, :2])).all(axis=1)
    if not whole.all():
        frame, identity = rows[np.flatnonzero(~whole)[0], :2]
        raise InputError(f"{path}: frame {frame:g}, id {identity:g}: whole numbers are needed, of frames from 0 on")
    keep = (rows[:, 1] >= 0) & (rows[:, 4:6] > 0).all(axis=1)
    if rows.shape[1] > 6:
        keep &= rows[:, 6] != 0
    if rows.shape[1] > 7:
        keep &= (rows[:, 7] == MOT_PEDESTRIAN) | (rows[:, 7] < 0)
    rows = rows[keep]
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    pairs = rows[:, :2]
    twice = np.flatnonzero((pairs[1:] == pairs[:-1]).all(axis=1))
    if len(twice):
        frame, identity = pairs[twice[0]]
        raise InputError(f"{path}: identity {identity:.0f} is in frame {frame:.0f} twice: one box per person and frame")
    visible = rows[:, 8] if rows.shape[1] > 8 else np.full(len(rows), -1.0)
    # In MOTChallenge the first pixel is number 1.
    ltwh = rows[:, 2:6] - [1.0, 1.0, 0.0, 0.0]
    boxes = Boxes(rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64), ltwh, np.ones(len(rows)))
    return boxes, (visible >= 0) & (visible < MOT_VISIBLE)
