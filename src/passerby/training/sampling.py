"""Which pictures make up a batch: P people, K pictures of each.

What an epoch draws depends on the seed and the epoch's number alone, so that a training that was stopped between two epochs
goes on as if nothing had happened.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from pytorch_metric_learning.samplers import MPerClassSampler
from pytorch_metric_learning.utils import common_functions
from torch.utils.data import Sampler

from passerby.common.arrays import Ints
from passerby.training.crops import CropSet

Draw = tuple[int, int, int]
"""A picture's row, the epoch, and its place in the epoch: what decides how it is varied."""


class BatchSampler(Sampler[list[Draw]]):
    """The batches of one epoch after the other; `epoch` says which one is next."""

    def __init__(self, crops: CropSet, people: int, pictures: int, seed: int) -> None:
        """Batches of P `people` (all that there are, where they are fewer), K `pictures` of each."""
        self._crops, self._seed = crops, seed
        self._people, self._pictures = min(people, len(np.unique(crops.person))), pictures
        self.epoch = 0

    @property
    def size(self) -> int:
        """Pictures in a batch; the most, where not all people are known to be apart."""
        return self._people * self._pictures

    def __len__(self) -> int:
        """Batches in an epoch: as many as show each picture once on the mean."""
        return max(1, round(len(self._crops) / self.size))

    def __iter__(self) -> Iterator[list[Draw]]:
        """The batches of the epoch."""
        rng = np.random.default_rng((self._seed, self.epoch))
        rows = self._any(rng) if self._crops.apart is None else self._apart(rng, self._crops.apart)
        place = 0
        for batch in rows:
            yield [(row, self.epoch, place + k) for k, row in enumerate(batch)]
            place += len(batch)

    def _any(self, rng: np.random.Generator) -> Iterator[list[int]]:
        """All people are known to be different."""
        with _drawing_from(rng):
            sampler = MPerClassSampler(self._crops.person, self._pictures, self.size, len(self) * self.size)
            rows = [int(row) for row in sampler]
        for start in range(0, len(rows), self.size):
            yield rows[start : start + self.size]

    def _apart(self, rng: np.random.Generator, apart: np.ndarray) -> Iterator[list[int]]:
        """Batches of people in which every two are known to be different: any one, then others who are different from
        all before.

        Pictures are drawn evenly over the cameras, since what has to be learnt is that two cameras show one person.
        """
        with_pictures = np.unique(self._crops.person)
        by_camera = {int(person): self._rows_by_camera(int(person)) for person in with_pictures}
        for _ in range(len(self)):
            chosen: list[int] = []
            free = np.isin(np.arange(len(apart)), with_pictures)
            while free.any() and len(chosen) < self._people:
                chosen.append(int(rng.choice(np.flatnonzero(free))))
                free &= apart[chosen[-1]]
            yield [row for person in chosen for row in self._drawn(by_camera[person], rng)]

    def _rows_by_camera(self, person: int) -> list[Ints]:
        """A person's pictures by the camera."""
        rows = np.flatnonzero(self._crops.person == person)
        return [rows[self._crops.camera[rows] == camera] for camera in np.unique(self._crops.camera[rows])]

    def _drawn(self, by_camera: list[Ints], rng: np.random.Generator) -> list[int]:
        """K pictures of a person, camera by camera in turn; none twice while there are others."""
        decks = [list(rng.permutation(rows)) for rows in by_camera]
        rng.shuffle(decks)
        drawn: list[int] = []
        while len(drawn) < self._pictures:
            if not any(decks):
                decks = [list(rng.permutation(rows)) for rows in by_camera]
            drawn += [int(deck.pop()) for deck in decks if deck]
        return drawn[: self._pictures]


@contextmanager
def _drawing_from(rng: np.random.Generator) -> Iterator[None]:
    """The library draws from a generator of its module; for a while it is ours."""
    before, common_functions.NUMPY_RANDOM = common_functions.NUMPY_RANDOM, rng
    try:
        yield
    finally:
        common_functions.NUMPY_RANDOM = before
