"""What a folder says of its pictures, before any is looked at; and from there to a data set whose pictures can all be read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from passerby.common.arrays import Ints
from passerby.common.errors import InputError
from passerby.common.progress import Progress
from passerby.training.crops import DISTRACTOR, JUNK, CropSet, DataSet
from passerby.training.data.pictures import describe_faults, faults_of_pictures

UNKNOWN_CAMERA = "unknown-camera"
"""What the camera of a set is called whose file names tell none; no two of its pictures are known to be by the same one."""


@dataclass(frozen=True)
class Listed:
    """A picture file, and what its place or name says."""

    path: Path
    person: str | int
    """A name; or `JUNK`, or `DISTRACTOR`."""
    camera: str


@dataclass(eq=False)
class Listing:
    """The picture files of a data set."""

    train: list[Listed] = field(default_factory=list)
    query: list[Listed] = field(default_factory=list)
    gallery: list[Listed] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def data_set(name: str, path: Path, listing: Listing, tell: Progress) -> DataSet:
    """The data set of a listing: pictures that cannot be read and people with one picture to learn from are left out and
    reported.

    Args:
        name: of the data set; names of people and cameras begin with it.
        path: what a message calls the set.
        listing: its files.
        tell: called with the number of pictures that were tried.

    Raises `InputError` where nothing to learn from and no person to search for is left, or no query has an answer.
    """
    notes = list(listing.notes)
    parts = _readable([listing.train, listing.query, listing.gallery], notes, tell)
    parts[0] = without_single(parts[0], notes)
    _note_overlap(parts, notes)
    train, query, gallery = (_crops(name, part) for part in _numbered(parts))
    if not len(train) and not len(query):
        raise InputError(f"{path}: {'; '.join(notes) or 'holds no images of people'}: nothing is left to learn from")
    if len(query):
        _check_answers(path, query, gallery)
    return DataSet(name, train, query, gallery, tuple(notes))


def _readable(parts: list[list[Listed]], notes: list[str], tell: Progress) -> list[list[Listed]]:
    """The pictures that can be used."""
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


def without_single(rows: list[Listed], notes: list[str]) -> list[Listed]:
    """Without people with one picture: nothing about a person can be learnt from one."""
    count = Counter(row.person for row in rows)
    single = sorted(str(person) for person, n in count.items() if n < 2)
    if not single:
        return rows
    notes += describe_faults(single, f"{len(single)} people with one image each, kept out of the training")
    return [row for row in rows if count[row.person] > 1]


def _note_overlap(parts: list[list[Listed]], notes: list[str]) -> None:
    """Tell of people to be searched for who are also learnt from."""
    train, query = ({row.person for row in part} for part in parts[:2])
    both = sorted(str(person) for person in train & query)
    notes += describe_faults(both, f"{len(both)} people are in both train and query, so the scores are too good")


def _numbered(parts: list[list[Listed]]) -> list[tuple[list[Listed], list[str], list[str]]]:
    """Each part with the names of its people and cameras; query and gallery have them in common."""
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
    """Raise `InputError` unless some query has a right picture in the gallery."""
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


__all__ = ["DISTRACTOR", "JUNK", "UNKNOWN_CAMERA", "Listed", "Listing", "data_set", "without_single"]
