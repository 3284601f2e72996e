"""Pictures as the network sees them: loaded alike everywhere, varied in training, and drawn as batches (P people, K each).

What an epoch draws depends on the seed and the epoch's number alone, so that a training that was stopped between two epochs
goes on as if nothing had happened.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import torch
from pytorch_metric_learning.samplers import MPerClassSampler
from pytorch_metric_learning.utils import common_functions
from torch import Tensor
from torch.nn import functional
from torch.utils.data import Sampler

from passerby.common.arrays import Ints
from passerby.core.observations import Vectors
from passerby.perception.crop_network import stretch_crop
from passerby.perception.networks import IMAGENET, IMAGENET_MEAN
from passerby.perception.pictures import Picture
from passerby.training.crops import CropSet, read_picture
from passerby.training.network import ReidNetwork
from passerby.training.options import TrainOptions

ERASED_AREA = (0.02, 0.4)
"""Share of the picture that is erased, and its proportions: as published (Zhong et al., AAAI 2020)."""
ERASED_ASPECT = (0.3, 3.33)
ERASED_COLOUR = tuple(255.0 * mean for mean in reversed(IMAGENET_MEAN))
"""Blue, green, red: the mean, which the network sees as 0."""
TRIES = 20
Draw = tuple[int, int, int]
"""A picture's row, the epoch, and its place in the epoch: what decides how it is varied."""


def load_picture(path: Path, size: tuple[int, int]) -> Picture:
    """(H, W, 3) BGR, a picture file stretched to `size`, its width and height. Raises `InputError` where it cannot be read."""
    picture = read_picture(path)
    height, width = picture.shape[:2]
    return stretch_crop(picture, np.array([0.0, 0.0, width, height]), size)


def make_batch(pictures: Sequence[Picture]) -> Tensor:
    """(N, H, W, 3) of uint8."""
    return torch.from_numpy(np.stack(pictures))


def normalise_pictures(batch: Tensor) -> Tensor:
    """(N, 3, H, W) of float, RGB, normalised as ImageNet's pictures, from (N, H, W, 3) of uint8, BGR."""
    mean = torch.tensor(IMAGENET.mean, device=batch.device)
    std = torch.tensor(IMAGENET.std, device=batch.device)
    values: Tensor = (batch.flip(-1).float() * IMAGENET.scale - mean) / std
    return values.permute(0, 3, 1, 2).contiguous(memory_format=torch.channels_last)


def embed_all(network: ReidNetwork, crops: CropSet, options: TrainOptions, batch: int = 64) -> Vectors:
    """(N, C) unit vectors of a set's pictures, by the network as it stands."""
    device = next(network.parameters()).device
    network.eval()
    found = [np.zeros((0, network.channels), np.float32)]
    with torch.no_grad():
        for start in range(0, len(crops), batch):
            pictures = [load_picture(path, (options.width, options.height)) for path in crops.paths[start : start + batch]]
            vectors = network.embed(normalise_pictures(make_batch(pictures).to(device)))
            found.append(functional.normalize(vectors.float(), dim=1).cpu().numpy())
    return np.concatenate(found)


def decode_pictures(crops: CropSet) -> list[Picture]:
    """The pictures of a set as they lie on disk, BGR, of any sizes. Raises `InputError` where one cannot be read."""
    return [read_picture(path) for path in crops.paths]


def augment(picture: Picture, options: TrainOptions, rng: np.random.Generator) -> Picture:
    """(H, W, 3) a variation of a picture: colour, place, mirrored, a part erased, as the options say. The draws do not depend
    on the picture.
    """
    if options.colour > 0:
        picture = _recolour(picture, options.colour, rng)
    if options.shift > 0:
        picture = _shift_picture(picture, options.shift, rng)
    if rng.uniform() < options.flip:
        picture = picture[:, ::-1]
    if rng.uniform() < options.erasing:
        picture = _erase_rectangle(picture, rng)
    return np.ascontiguousarray(picture)


def _recolour(picture: Picture, most: float, rng: np.random.Generator) -> Picture:
    """Brightness and contrast of the whole picture, and half as much of each channel's gain: exposure and white balance."""
    brightness, contrast = rng.uniform(-most, most, 2)
    gain = 1.0 + rng.uniform(-most / 2, most / 2, 3)
    middle = float(picture.mean())
    # Straight lines in the pixel's value: contrast about the picture's mean, then brightness, then the channel's gain.
    slope = (1.0 + contrast) * (1.0 + brightness) * gain
    offset = (1.0 - (1.0 + contrast)) * middle * (1.0 + brightness) * gain
    table = np.clip(np.arange(256)[:, None] * slope + offset, 0, 255).round().astype(np.uint8)
    return np.asarray(cv2.LUT(picture, table[:, None, :]), dtype=np.uint8)


def _shift_picture(picture: Picture, most: float, rng: np.random.Generator) -> Picture:
    """The picture within an edge of the mean colour, cut out at another place: detectors' boxes are off by as much."""
    height, width = picture.shape[:2]
    edge = max(1, round(most * height))
    left, top = rng.integers(0, 2 * edge + 1, 2)
    framed = cv2.copyMakeBorder(picture, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=ERASED_COLOUR)
    return np.asarray(framed[top : top + height, left : left + width], dtype=np.uint8)


def _erase_rectangle(picture: Picture, rng: np.random.Generator) -> Picture:
    """A rectangle in the mean colour."""
    height, width = picture.shape[:2]
    for _ in range(TRIES):
        area = rng.uniform(*ERASED_AREA) * height * width
        aspect = np.exp(rng.uniform(*np.log(ERASED_ASPECT)))
        high, wide = round(float(np.sqrt(area * aspect))), round(float(np.sqrt(area / aspect)))
        if high < height and wide < width:
            top, left = int(rng.integers(0, height - high + 1)), int(rng.integers(0, width - wide + 1))
            picture = picture.copy()
            picture[top : top + high, left : left + wide] = ERASED_COLOUR
            break
    return picture


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
        rows = self._draw_batches(rng) if self._crops.apart is None else self._draw_distinct_batches(rng, self._crops.apart)
        place = 0
        for batch in rows:
            yield [(row, self.epoch, place + k) for k, row in enumerate(batch)]
            place += len(batch)

    def _draw_batches(self, rng: np.random.Generator) -> Iterator[list[int]]:
        """All people are known to be different."""
        with _drawing_from(rng):
            sampler = MPerClassSampler(self._crops.person, self._pictures, self.size, len(self) * self.size)
            rows = [int(row) for row in sampler]
        for start in range(0, len(rows), self.size):
            yield rows[start : start + self.size]

    def _draw_distinct_batches(self, rng: np.random.Generator, apart: np.ndarray) -> Iterator[list[int]]:
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
            yield [row for person in chosen for row in self._draw_pictures(by_camera[person], rng)]

    def _rows_by_camera(self, person: int) -> list[Ints]:
        """A person's pictures by the camera."""
        rows = np.flatnonzero(self._crops.person == person)
        return [rows[self._crops.camera[rows] == camera] for camera in np.unique(self._crops.camera[rows])]

    def _draw_pictures(self, by_camera: list[Ints], rng: np.random.Generator) -> list[int]:
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
