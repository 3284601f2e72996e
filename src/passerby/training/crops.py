"""Pictures of one person each, listed from folders, with the known identities and cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Ints
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.perception.crop_network import MIN_HEIGHT_PX, MIN_WIDTH_PX
from passerby.perception.pictures import Picture

JUNK = -1
"""A picture that counts neither as right nor as wrong in the result of a search (Market-1501's identity -1)."""
DISTRACTOR = -2
"""A picture of no person of the query; always wrong in the result of a search (Market-1501's identity 0000)."""
UNKNOWN_CAMERA = "unknown-camera"
"""Name of the camera if the file names state none; no two of these pictures are known to be by the same camera."""
PICTURE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
NAMED = 5
"""Maximum number of faulty files that are named."""
THREADS = 8
AT_ONCE = 1000
"""Number of pictures between two reports of progress."""


@dataclass(frozen=True, eq=False)
class CropSet:
    """N pictures of P people by C cameras."""

    paths: tuple[Path, ...] = ()
    """The N picture files."""
    person: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) rows of `people`; or `JUNK`, or `DISTRACTOR`."""
    camera: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) rows of `cameras`."""
    people: tuple[str, ...] = ()
    """Names, each of one person, such as `market1501/0002`: the data set's name comes first."""
    cameras: tuple[str, ...] = ()
    """Names of cameras, such as `market1501/c1`."""
    apart: NDArray[np.bool_] | None = None
    """(P, P) whether two people are known to be different; None: all are. Two tracks may be one person at two times."""

    def __post_init__(self) -> None:
        if not len(self.paths) == len(self.person) == len(self.camera):
            raise InputError(f"{len(self.paths)} images, {len(self.person)} people, {len(self.camera)} cameras: one each")
        if len(set(self.people)) != len(self.people):
            twice = next(name for name in self.people if self.people.count(name) > 1)
            raise InputError(f"two people are called {twice}: give the data sets names that differ")

    def __len__(self) -> int:
        return len(self.paths)

    def take(self, rows: NDArray[np.generic]) -> CropSet:
        """Return the pictures of the given rows (indices or a mask), with all people and cameras."""
        index = np.arange(len(self))[rows]
        paths = tuple(self.paths[row] for row in index.tolist())
        return CropSet(paths, self.person[index], self.camera[index], self.people, self.cameras, self.apart)

    def of_people(self, rows: NDArray[np.generic]) -> CropSet:
        """Return only the given people (indices or a mask) and their pictures; people get new row numbers."""
        chosen = np.arange(len(self.people))[rows]
        number = np.full(len(self.people), -1)
        number[chosen] = np.arange(len(chosen))
        known = self.person >= 0
        kept = np.flatnonzero(known & (number[np.where(known, self.person, 0)] >= 0)) if len(chosen) else np.zeros(0, int)
        return CropSet(
            tuple(self.paths[row] for row in kept.tolist()),
            number[self.person[kept]],
            self.camera[kept],
            tuple(self.people[row] for row in chosen.tolist()),
            self.cameras,
            None if self.apart is None else self.apart[np.ix_(chosen, chosen)],
        )


@dataclass(frozen=True, eq=False)
class DataSet:
    """One source of pictures: people for the training, and people for a search."""

    name: str
    train: CropSet = field(default_factory=CropSet)
    query: CropSet = field(default_factory=CropSet)
    """People to search for; people and cameras have the same names in `gallery`."""
    gallery: CropSet = field(default_factory=CropSet)
    """Pictures that are searched."""
    notes: tuple[str, ...] = ()
    """Omitted parts and the reasons, one line each."""


def mix_sets(sets: Sequence[CropSet]) -> CropSet:
    """Join all pictures to one set. People and cameras of the same name are the same; names begin with the data set's.

    Therefore people of two data sets are different.
    """
    people = list(dict.fromkeys(name for crops in sets for name in crops.people))
    cameras = list(dict.fromkeys(name for crops in sets for name in crops.cameras))
    row_of = {name: row for row, name in enumerate(people)}
    camera_of = {name: row for row, name in enumerate(cameras)}
    persons, seen_by = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    apart = None
    if any(crops.apart is not None for crops in sets):
        apart = ~np.eye(len(people), dtype=np.bool_)
    for crops in sets:
        rows = np.array([*(row_of[name] for name in crops.people), DISTRACTOR, JUNK], dtype=np.int64)
        persons.append(rows[crops.person])  # -1 and -2 do not change
        seen_by.append(np.array([camera_of[name] for name in crops.cameras], dtype=np.int64)[crops.camera])
        if apart is not None and crops.apart is not None:
            apart[np.ix_(rows[:-2], rows[:-2])] = crops.apart
    paths = tuple(path for crops in sets for path in crops.paths)
    return CropSet(paths, np.concatenate(persons), np.concatenate(seen_by), tuple(people), tuple(cameras), apart)


@dataclass(frozen=True)
class Listed:
    """A picture file, with the person and the camera by its folder or name."""

    path: Path
    person: str | int
    """Name of the person; or `JUNK`, or `DISTRACTOR`."""
    camera: str


@dataclass(eq=False)
class Listing:
    """The picture files of a data set."""

    train: list[Listed] = field(default_factory=list)
    query: list[Listed] = field(default_factory=list)
    gallery: list[Listed] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def data_set(name: str, path: Path, listing: Listing, tell: Progress) -> DataSet:
    """Make the data set of a listing.

    Pictures that cannot be read, and people with only one training picture, are left out and reported.

    Args:
        name: name of the data set; names of people and cameras begin with it.
        path: path of the set, for messages.
        listing: files of the set.
        tell: called with the number of tested pictures.

    Raises `InputError` if neither training pictures nor people to search for remain, or no query has a right picture.
    """
    notes = list(listing.notes)
    parts = _keep_readable([listing.train, listing.query, listing.gallery], notes, tell)
    parts[0] = drop_single(parts[0], notes)
    _note_overlap(parts, notes)
    train, query, gallery = (_crops(name, part) for part in _number_people(parts))
    if not len(train) and not len(query):
        raise InputError(f"{path}: {'; '.join(notes) or 'holds no images of people'}: nothing is left to learn from")
    if len(query):
        _check_answers(path, query, gallery)
    return DataSet(name, train, query, gallery, tuple(notes))


def _keep_readable(parts: list[list[Listed]], notes: list[str], tell: Progress) -> list[list[Listed]]:
    """Return the pictures that can be used, and add notes about the others."""
    rows = [row for part in parts for row in part]
    faults = faults_of_pictures([row.path for row in rows], tell)
    for fault in sorted(set(faults.values())):
        bad = [rows[number].path for number in sorted(faults) if faults[number] == fault]
        notes += describe_faults(
            bad, f"{len(bad)} image{'s' * (len(bad) > 1)} that {_PLURAL[fault] if len(bad) > 1 else fault}"
        )
    kept, start = [], 0
    for part in parts:
        kept.append([row for number, row in enumerate(part, start) if number not in faults])
        start += len(part)
    return kept


_PLURAL = {"cannot be read": "cannot be read", "is too small": "are too small"}


def drop_single(rows: list[Listed], notes: list[str]) -> list[Listed]:
    """Drop people with only one picture, from which a person cannot be learnt, and add a note."""
    count = Counter(row.person for row in rows)
    single = sorted(str(person) for person, n in count.items() if n < 2)
    if not single:
        return rows
    notes += describe_faults(single, f"{len(single)} people with one image each, kept out of the training")
    return [row for row in rows if count[row.person] > 1]


def _note_overlap(parts: list[list[Listed]], notes: list[str]) -> None:
    """Add a note about people of the query who are in the training too."""
    train, query = ({row.person for row in part} for part in parts[:2])
    both = sorted(str(person) for person in train & query)
    notes += describe_faults(both, f"{len(both)} people are in both train and query, so the scores are too good")


def _number_people(parts: list[list[Listed]]) -> list[tuple[list[Listed], list[str], list[str]]]:
    """Return each part with the names of its people and cameras; query and gallery have the same names."""
    named = []
    for group in (parts[:1], parts[1:]):
        people = sorted({row.person for part in group for row in part if isinstance(row.person, str)})
        cameras = sorted({row.camera for part in group for row in part})
        named += [(part, people, cameras) for part in group]
    return named


def _crops(name: str, numbered: tuple[list[Listed], list[str], list[str]]) -> CropSet:
    rows, people, cameras = numbered
    if not rows:
        return CropSet()
    number = {person: row for row, person in enumerate(people)}
    camera = {one: row for row, one in enumerate(cameras)}
    return CropSet(
        tuple(row.path for row in rows),
        _ints([number[row.person] if isinstance(row.person, str) else row.person for row in rows]),
        _ints([camera[row.camera] for row in rows]),
        tuple(f"{name}/{person}" for person in people),
        tuple(f"{name}/{one}" for one in cameras),
    )


def _check_answers(path: Path, query: CropSet, gallery: CropSet) -> None:
    """Raise `InputError` if no query has a right picture in the gallery."""
    unknown = any(name.endswith(f"/{UNKNOWN_CAMERA}") for name in query.cameras)
    found = {(person, camera) for person, camera in zip(gallery.person.tolist(), gallery.camera.tolist(), strict=True)}
    cameras = set(range(len(query.cameras)))
    for person, camera in set(zip(query.person.tolist(), query.camera.tolist(), strict=True)):
        if any((person, other) in found for other in (cameras if unknown else cameras - {camera})):
            return
    raise InputError(
        f"{path}: no person of the query is in the gallery, seen by another camera: the same names of people are needed in both"
    )


def _ints(values: Sequence[int]) -> Ints:
    return np.array(values, dtype=np.int64)


def picture_files(folder: Path) -> list[Path]:
    """Return the picture files in a folder, by name, without hidden ones. Raises `InputError` if it cannot be listed."""
    try:
        found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURE_ENDINGS and not path.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error}): give a folder that you may read") from None
    return sorted(found, key=lambda path: path.name)


def read_picture(path: Path) -> Picture:
    """Read a picture (H, W, 3), BGR. Raises `InputError` for a file that is not a whole picture."""
    picture = decode_pictures(path)
    if picture is None:
        raise InputError(f"{path}: is not an image that can be read: copy it again, or delete it")
    return picture


def decode_pictures(path: Path) -> Picture | None:
    """Read a picture (H, W, 3), BGR; None for a file that cannot be read, is empty, truncated, or not a picture."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if not content or _is_cut_off(content):
        return None
    try:
        picture = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # for example a size beyond OpenCV's limits
        return None
    return None if picture is None or picture.size == 0 else np.asarray(picture, dtype=np.uint8)


def faults_of_pictures(paths: Sequence[Path], tell: Progress = silent) -> dict[int, str]:
    """Return row -> fault, for the pictures that cannot be used; all pictures are decoded, in threads."""
    faults: dict[int, str] = {}
    with ThreadPoolExecutor(THREADS) as pool:
        for start in range(0, len(paths), AT_ONCE):
            tell("checking images", start, len(paths))
            found = pool.map(_fault, paths[start : start + AT_ONCE])
            faults |= {start + row: fault for row, fault in enumerate(found) if fault is not None}
    tell("checking images", len(paths), len(paths))
    return faults


def describe_faults(files: Sequence[Path | str], what: str) -> list[str]:
    """Return a note about faulty files, with the names of the first `NAMED` and the number of others; empty without files."""
    if not files:
        return []
    more = f" and {len(files) - NAMED} more" if len(files) > NAMED else ""
    return [f"{what}: {', '.join(str(file) for file in files[:NAMED])}{more}"]


def _fault(path: Path) -> str | None:
    """Return the fault of a picture; None if it can be used."""
    picture = decode_pictures(path)
    if picture is None:
        return "cannot be read"
    # A smaller picture does not show the appearance (`perception.crop_network.is_recognisable`).
    return "is too small" if picture.shape[1] < MIN_WIDTH_PX or picture.shape[0] < MIN_HEIGHT_PX else None


def _is_cut_off(content: bytes) -> bool:
    """Return whether a JPEG or PNG lacks its end mark; decoders fill the rest grey. Some cameras write more behind the mark."""
    if content.startswith(b"\xff\xd8"):
        return b"\xff\xd9" not in content[-65536:]
    return content.startswith(b"\x89PNG") and b"IEND" not in content[-65536:]
