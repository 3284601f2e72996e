"""Pictures of people, one person each, and what is known of who they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Ints
from passerby.common.errors import InputError

JUNK = -1
"""A picture that counts neither as right nor as wrong where it is found (Market-1501's identity -1)."""
DISTRACTOR = -2
"""A picture of no person who is searched for; wrong wherever it is found (Market-1501's identity 0000)."""


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
    """Names, each of one person, as `market1501/0002`: the data set's name comes first."""
    cameras: tuple[str, ...] = ()
    """Names, as `market1501/c1`."""
    apart: NDArray[np.bool_] | None = None
    """(P, P) who are known to be two; None: all of them are. Known of tracks, of which two may be one person at two times."""

    def __post_init__(self) -> None:
        if not len(self.paths) == len(self.person) == len(self.camera):
            raise InputError(f"{len(self.paths)} images, {len(self.person)} people, {len(self.camera)} cameras: one each")
        if len(set(self.people)) != len(self.people):
            twice = next(name for name in self.people if self.people.count(name) > 1)
            raise InputError(f"two people are called {twice}: give the data sets names that differ")

    def __len__(self) -> int:
        return len(self.paths)

    def take(self, rows: NDArray[np.generic]) -> CropSet:
        """The pictures of the given rows (indices or a mask), with all people and cameras."""
        index = np.arange(len(self))[rows]
        paths = tuple(self.paths[row] for row in index.tolist())
        return CropSet(paths, self.person[index], self.camera[index], self.people, self.cameras, self.apart)

    def of_people(self, rows: NDArray[np.generic]) -> CropSet:
        """Only the given people (indices or a mask) and their pictures; people are counted anew."""
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
    """One source of pictures: people to learn from, and people to be searched for."""

    name: str
    train: CropSet = field(default_factory=CropSet)
    query: CropSet = field(default_factory=CropSet)
    """Whom to search for; its people and cameras are named alike in `gallery`."""
    gallery: CropSet = field(default_factory=CropSet)
    """Among whom."""
    notes: tuple[str, ...] = ()
    """What was left out, and why: one line each."""


def mix_sets(sets: Sequence[CropSet]) -> CropSet:
    """All pictures as one set. People and cameras of the same name are the same; names begin with the data set's.

    People of two sets are different.
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
        persons.append(rows[crops.person])  # -1 and -2 stay what they are
        seen_by.append(np.array([camera_of[name] for name in crops.cameras], dtype=np.int64)[crops.camera])
        if apart is not None and crops.apart is not None:
            apart[np.ix_(rows[:-2], rows[:-2])] = crops.apart
    paths = tuple(path for crops in sets for path in crops.paths)
    return CropSet(paths, np.concatenate(persons), np.concatenate(seen_by), tuple(people), tuple(cameras), apart)
