"""Crops of people, cut out of videos once and stored as PNG files, and the choice of the boxes to cut.

The files are CACHE/NAME/CAMERA/KEY/PERSON_FRAME.png. KEY is a digest of the video and of the requested boxes, so that earlier
crops are found again. A camera's crops are written as a whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress, silent
from passerby.interchange.storage.atomic import PART, cannot_write, write_text
from passerby.perception.crop_network import is_recognisable
from passerby.perception.kept import cache_lock, fingerprint, hash_of_arrays, key_of
from passerby.perception.pictures import Frame, Picture
from passerby.perception.sources.files import is_pattern
from passerby.perception.video import VideoReader, probe
from passerby.training.crops import CropSet, decode_pictures, picture_files

REVISION = 1
"""Increased with each change of the cutting, so that crops of an older version are not used."""
INDEX = "crops.json"
STAGE = "cutting crops"
TOLD_EVERY = 50
"""Number of pictures between two reports of progress."""
PER_PERSON = 24
"""Maximum number of crops of one person by one camera: 24 show front, side and back; more would be nearly equal pictures."""
COVERED_IOU = 0.3
"""Minimum overlap with a nearer person at which a crop shows two people."""


@dataclass(frozen=True, eq=False)
class WantedCrops:
    """N boxes of one camera to cut."""

    camera: str
    source: Path
    """The video; or a folder of pictures whose names are their frame numbers (MOTChallenge's img1/000001.jpg)."""
    frame: Ints
    """(N,) frame numbers of the video reader, from 1; see `VideoInfo.clock_fps`."""
    ltwh: Floats
    """(N, 4) left, top, width, height, pixels; (0, 0) is the centre of the first pixel."""
    person: Ints
    """(N,) rows of the people; each at most once in a frame."""


@dataclass(frozen=True, eq=False)
class CutCrops:
    """The crops that were cut."""

    crops: CropSet
    """Sorted by camera, then by requested row; `apart` is None."""
    notes: tuple[str, ...] = ()
    """Boxes that could not be cut, one line each."""


def cut_crops(
    wanted: Sequence[WantedCrops],
    people: Sequence[str],
    cache: Path,
    *,
    name: str,
    executor: Executor | None = None,
    tell: Progress = silent,
) -> CutCrops:
    """Cut boxes out of videos, at the videos' own resolution; each video is read once, with one picture at a time in memory.

    A crop is the visible part of its box, rounded to whole pixels, as in `perception.crop_network.stretch_crop`.
    Boxes of pictures that a video does not have are left out, with a note.

    Args:
        wanted: the boxes of each camera; `find_clear_boxes` and `spread_rows` help to choose them.
        people: the people's names; `CropSet.people` become NAME/PERSON, and `CropSet.cameras` NAME/CAMERA.
        cache: folder of the crops, which are stored in its folder `name`.
        name: name of the data set.
        executor: cuts the cameras in parallel; None: one after the other. The result does not depend on it.
        tell: called for each camera and, without an executor, for the pictures.

    Raises `InputError` for a video that cannot be read, a person twice in one frame, and a cache that cannot be written.
    """
    jobs = [_Job(one, tuple(people), cache / name / _make_file_name(one.camera)) for one in wanted]
    for one in wanted:
        _check(one, people)
    if executor is None:
        cut = [_cut_camera(job, partial(tell, STAGE, part=job.wanted.camera)) for job in jobs]
    else:
        cut = side_by_side(_cut_camera, jobs, executor, tell, STAGE)
    rows = [np.flatnonzero([path is not None for path in paths]) for paths, _ in cut]
    crops = CropSet(
        tuple(path for paths, _ in cut for path in paths if path is not None),
        _join_frames([one.person[kept] for one, kept in zip(wanted, rows, strict=True)]),
        _join_frames([np.full(len(kept), number) for number, kept in enumerate(rows)]),
        tuple(f"{name}/{person}" for person in people),
        tuple(f"{name}/{one.camera}" for one in wanted),
    )
    return CutCrops(crops, tuple(note for _, notes in cut for note in notes))


def source_size(source: Path) -> tuple[int, int]:
    """Return width and height of the pictures of a video or of a folder of pictures. Raises `InputError` if there is none."""
    if not source.is_dir():
        return probe(source).size
    for path in picture_files(source):
        picture = decode_pictures(path)
        if picture is not None:
            return picture.shape[1], picture.shape[0]
    raise InputError(f"{source}: holds no frame that can be read: the video's frames are needed there")


@dataclass(frozen=True, eq=False)
class _Job:
    """One camera's work; picklable."""

    wanted: WantedCrops
    people: tuple[str, ...]
    shelf: Path

    @property
    def key(self) -> str:
        """Digest of the settings and inputs that determine the crops."""
        wanted = self.wanted
        rows = hash_of_arrays(np.asarray(wanted.frame), np.asarray(wanted.ltwh), np.asarray(wanted.person))
        versions = {"av": av.__version__, "opencv": cv2.__version__}
        names = list(self.names)
        return key_of({"source": _content(wanted), "rows": rows, "names": names, "revision": REVISION, "versions": versions})

    @property
    def names(self) -> tuple[str, ...]:
        """File names of the crops."""
        pairs = zip(self.wanted.person.tolist(), self.wanted.frame.tolist(), strict=True)
        names = tuple(f"{_make_file_name(self.people[person])}_{frame:06d}.png" for person, frame in pairs)
        if len({name.casefold() for name in names}) == len(names):
            return names
        return tuple(f"{row:06d}.png" for row in range(len(names)))  # two people have the same name in file names


def _cut_camera(job: _Job, tell: Callable[[int, int], None] | None = None) -> tuple[list[Path | None], list[str]]:
    """Return the files of a camera's crops, None if the video lacks the picture; and notes."""
    if not len(job.wanted.frame):
        return [], []
    folder = job.shelf / job.key
    with cache_lock(job.shelf):
        index = _find_kept_crops(folder)
        if index is None:
            index = _cut_into_folder(job, folder, tell)
    missing = len(job.names) - len(index)
    notes = []
    if missing:
        lost = np.unique(job.wanted.frame[[name not in index for name in job.names]])
        notes.append(
            f"{job.wanted.source}: camera {job.wanted.camera}: {missing} of {len(job.names)} boxes are of frames that it "
            f"does not have or that cannot be decoded (frames {lost[0]} to {lost[-1]}; its first frame is number 1): left out"
        )
    return [folder / name if name in index else None for name in job.names], notes


def _find_kept_crops(folder: Path) -> dict[str, int] | None:
    """Return the earlier files and their sizes, bytes; None if a file is missing or has another size."""
    try:
        index: dict[str, int] = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        whole = all((folder / name).stat().st_size == size for name, size in index.items())
    except (OSError, ValueError):
        return None
    return index if whole else None


def _cut_into_folder(job: _Job, folder: Path, tell: Callable[[int, int], None] | None) -> dict[str, int]:
    """Cut a camera's crops into a folder of this name; return the files and their sizes, bytes."""
    for half in job.shelf.glob(f".*{PART}"):  # from a run that was killed
        shutil.rmtree(half, ignore_errors=True)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # cameras are cut in parallel
    try:
        new = Path(tempfile.mkdtemp(dir=job.shelf, prefix=".", suffix=PART))
        try:
            index = _write(job, new, tell)
            write_text(new / INDEX, json.dumps(index))
            new.chmod(0o755)
            shutil.rmtree(folder, ignore_errors=True)
            new.rename(folder)
        finally:
            shutil.rmtree(new, ignore_errors=True)
    except OSError as error:
        raise cannot_write(job.shelf, error) from error
    finally:
        cv2.setNumThreads(threads)
    return index


def _write(job: _Job, folder: Path, tell: Callable[[int, int], None] | None) -> dict[str, int]:
    """Write the crops picture by picture; return the files and their sizes, bytes."""
    wanted, names, index = job.wanted, job.names, {}
    order = np.argsort(wanted.frame, kind="stable")
    frames = wanted.frame[order]
    total = int(frames[-1])
    for count, frame in enumerate(_pictures(wanted), start=1):
        if tell is not None and count % TOLD_EVERY == 0:
            tell(frame.number, total)
        low, high = np.searchsorted(frames, (frame.number, frame.number + 1))
        for row in order[low:high].tolist():
            # The lowest compression is twice as fast as the usual one, and files are a tenth larger.
            _, png = cv2.imencode(".png", _crop_box(frame.picture, wanted.ltwh[row]), [cv2.IMWRITE_PNG_COMPRESSION, 1])
            (folder / names[row]).write_bytes(png.tobytes())
            index[names[row]] = len(png)
    if tell is not None:
        tell(total, total)
    return index


def _pictures(wanted: WantedCrops) -> Iterator[Frame]:
    """Read the pictures of a video from the first to the last wanted one, or of a folder only the wanted, readable ones."""
    first, last = int(wanted.frame.min()), int(wanted.frame.max())
    if wanted.source.is_dir():
        for number, path in _index_frames(wanted).items():
            picture = decode_pictures(path)
            if picture is not None:
                yield Frame(number, 0.0, picture)
        return
    for frame in VideoReader(wanted.source, after=max(first - 1, 0)):
        if frame.number > last:
            return
        yield frame


def _index_frames(wanted: WantedCrops) -> dict[int, Path]:
    """Return frame number -> file, ascending, for the wanted pictures of a folder."""
    numbers = {int(path.stem): path for path in picture_files(wanted.source) if re.fullmatch("[0-9]+", path.stem)}
    return {number: numbers[number] for number in np.unique(wanted.frame).tolist() if number in numbers}


def _content(wanted: WantedCrops) -> Mapping[str, Any]:
    """Return values that identify the pictures of a source."""
    if not wanted.source.is_dir():
        if not wanted.source.is_file():
            raise InputError(f"{wanted.source}: no such file: the video of camera {wanted.camera} is needed here")
        return fingerprint(wanted.source)
    # By content, not by times: a file that replaces another one may have the same size and time.
    return {"pictures": [(path.name, _digest(path)) for path in _index_frames(wanted).values()]}


def _digest(path: Path) -> str:
    """Return the digest of a picture's content."""
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()


def _crop_box(picture: Picture, box: Floats) -> Picture:
    """Cut the visible part of a box (4,), rounded to whole pixels as in `perception.crop_network.stretch_crop`."""
    height, width = picture.shape[:2]
    left, top, right, bottom = box[0], box[1], box[0] + box[2], box[1] + box[3]
    x0, y0 = min(max(round(left), 0), width - 1), min(max(round(top), 0), height - 1)
    x1, y1 = max(min(round(right), width), x0 + 1), max(min(round(bottom), height), y0 + 1)
    return picture[y0:y1, x0:x1]


def _check(wanted: WantedCrops, people: Sequence[str]) -> None:
    """Raise `InputError` if the columns do not fit together, or a person is in a frame twice."""
    n, place = len(wanted.frame), f"camera {wanted.camera}"
    if np.shape(wanted.ltwh) != (n, 4) or len(wanted.person) != n:
        raise InputError(f"{place}: {n} frames, boxes {np.shape(wanted.ltwh)}, {len(wanted.person)} people: a row each")
    if n and not (wanted.person.min() >= 0 and wanted.person.max() < len(people)):
        raise InputError(f"{place}: rows {wanted.person.min()} to {wanted.person.max()} are not of {len(people)} people")
    pairs, count = np.unique(np.stack([wanted.frame, wanted.person], axis=1), axis=0, return_counts=True)
    if (count > 1).any():
        frame, person = pairs[count.argmax()].tolist()
        raise InputError(f"{place}: {people[person]} is in frame {frame} twice: give one box for a person in a frame")


def _make_file_name(text: str) -> str:
    """Convert a text to a part of a file name."""
    return re.sub(r"[^\w.+@-]", "-", text).lstrip(".") or "-"


def _join_frames(parts: Sequence[NDArray[np.int64]]) -> Ints:
    return np.concatenate([np.zeros(0, np.int64), *parts])


def find_clear_boxes(frame: Ints, ltwh: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return whether boxes of one camera show a person well (N,): large enough, at least half in the picture, not hidden.

    Args:
        frame: (N,) frame numbers.
        ltwh: (N, 4) all boxes of the camera, pixels, including those of unknown people, who hide others too.
        size: width and height of the pictures.

    If two boxes overlap by `COVERED_IOU` or more (intersection over union), the box whose foot is lower in the picture is
    nearer to the camera.
    """
    shown: Picture = np.broadcast_to(np.uint8(0), (size[1], size[0], 3))
    order = np.argsort(frame, kind="stable")
    frames, boxes = frame[order], ltwh[order]
    covered = np.zeros(len(order), dtype=np.bool_)
    for step in range(1, len(order)):
        first = np.flatnonzero(frames[:-step] == frames[step:])
        if not len(first):
            break  # no frame has more than `step` boxes
        second = first + step
        near = _iou(boxes[first], boxes[second]) >= COVERED_IOU
        lower = _foot(boxes[first]) > _foot(boxes[second])
        covered[second[near & lower]] = True
        covered[first[near & ~lower]] = True
    clear = np.zeros(len(order), dtype=np.bool_)
    clear[order] = ~covered
    return np.asarray(clear & is_recognisable(shown, ltwh))


def spread_rows(frame: Ints, person: Ints, usable: NDArray[np.bool_], at_most: int = PER_PERSON) -> Ints:
    """Choose at most `at_most` usable boxes per person (N,), evenly spread in the order of frames; return ascending rows.

    People below 0 are unknown and are not used.
    """
    rows = np.flatnonzero(usable & (person >= 0))
    rows = rows[np.lexsort((frame[rows], person[rows]))]
    _, first, count = np.unique(person[rows], return_index=True, return_counts=True)
    chosen = [
        rows[start + (2 * np.arange(min(n, at_most)) + 1) * n // (2 * min(n, at_most))]
        for start, n in zip(first.tolist(), count.tolist(), strict=True)
    ]
    return np.sort(np.concatenate([np.zeros(0, np.int64), *chosen]))


def _iou(a: Floats, b: Floats) -> Floats:
    """Compute the intersection over union (N,) of boxes (N, 4), pair by pair."""
    low = np.maximum(a[:, :2], b[:, :2])
    both = np.maximum(np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - low, 0.0).prod(axis=1)
    return np.asarray(both / (a[:, 2:].prod(axis=1) + b[:, 2:].prod(axis=1) - both))


def _foot(boxes: Floats) -> Floats:
    """Return the lower edges (N,) of boxes, pixels."""
    return np.asarray(boxes[:, 1] + boxes[:, 3])


def one_file(videos: Sequence[Path], name: str, folders: bool = False) -> Path:
    """Return the path of camera `name`'s video.

    Raises `InputError` for several files, for patterns and, unless `folders` of images are allowed, for a folder.
    """
    (path, *more) = videos
    if more or (path.is_dir() and not folders) or (is_pattern(path) and not path.is_file()):
        raise InputError(
            f"{path}: camera {name}: crops of people are cut out of one video file so far: join the pieces or images, for "
            "example with `ffmpeg -f concat -safe 0 -i list.txt -c copy camera.mp4`, and calibrate with that file"
        )
    return path
