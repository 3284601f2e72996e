"""Pictures as input of the network: loaded in one way everywhere, varied in training, in batches of P people with K pictures.

The random numbers of an epoch depend only on the seed and the epoch's number. Therefore a training that was stopped between two
epochs continues without any difference.
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
"""Share of the picture that is erased; this and the range of the aspect are as published (Zhong et al., AAAI 2020)."""
ERASED_ASPECT = (0.3, 3.33)
ERASED_COLOUR = tuple(255.0 * mean for mean in reversed(IMAGENET_MEAN))
"""Mean colour as blue, green, red; the network's input is then 0."""
TRIES = 20
Draw = tuple[int, int, int]
"""Row of a picture, epoch, and place in the epoch; the last two determine how the picture is varied."""


def load_picture(path: Path, size: tuple[int, int]) -> Picture:
    """Read a picture (H, W, 3), BGR, stretched to `size` (width, height). Raises `InputError` if it cannot be read."""
    picture = read_picture(path)
    height, width = picture.shape[:2]
    return stretch_crop(picture, np.array([0.0, 0.0, width, height]), size)


def make_batch(pictures: Sequence[Picture]) -> Tensor:
    """Stack pictures into a batch (N, H, W, 3) of uint8."""
    return torch.from_numpy(np.stack(pictures))


def normalise_pictures(batch: Tensor) -> Tensor:
    """Convert (N, H, W, 3) of uint8, BGR, to (N, 3, H, W) of float, RGB, normalised as ImageNet's pictures."""
    mean = torch.tensor(IMAGENET.mean, device=batch.device)
    std = torch.tensor(IMAGENET.std, device=batch.device)
    values: Tensor = (batch.flip(-1).float() * IMAGENET.scale - mean) / std
    return values.permute(0, 3, 1, 2).contiguous(memory_format=torch.channels_last)


def embed_all(network: ReidNetwork, crops: CropSet, options: TrainOptions, batch: int = 64) -> Vectors:
    """Compute unit vectors (N, C) of a set's pictures by the network with its present weights."""
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
    """Read the pictures of a set as stored, BGR, of any sizes. Raises `InputError` if one cannot be read."""
    return [read_picture(path) for path in crops.paths]


def augment(picture: Picture, options: TrainOptions, rng: np.random.Generator) -> Picture:
    """Return a variation (H, W, 3) of a picture by the options: other colours, shifted, mirrored, or with a part erased.

    The random numbers do not depend on the picture.
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
    """Change brightness and contrast of the picture, and each channel's gain by half as much (exposure and white balance)."""
    brightness, contrast = rng.uniform(-most, most, 2)
    gain = 1.0 + rng.uniform(-most / 2, most / 2, 3)
    middle = float(picture.mean())
    # All are linear in the pixel's value: contrast about the picture's mean, then brightness, then the channel's gain.
    slope = (1.0 + contrast) * (1.0 + brightness) * gain
    offset = (1.0 - (1.0 + contrast)) * middle * (1.0 + brightness) * gain
    table = np.clip(np.arange(256)[:, None] * slope + offset, 0, 255).round().astype(np.uint8)
    return np.asarray(cv2.LUT(picture, table[:, None, :]), dtype=np.uint8)


def _shift_picture(picture: Picture, most: float, rng: np.random.Generator) -> Picture:
    """Shift the picture, with an edge of the mean colour: detectors' boxes have errors of this size."""
    height, width = picture.shape[:2]
    edge = max(1, round(most * height))
    left, top = rng.integers(0, 2 * edge + 1, 2)
    framed = cv2.copyMakeBorder(picture, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=ERASED_COLOUR)
    return np.asarray(framed[top : top + height, left : left + width], dtype=np.uint8)


def _erase_rectangle(picture: Picture, rng: np.random.Generator) -> Picture:
    """Fill a random rectangle with the mean colour."""
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
    """The batches of the epoch `epoch`."""

    def __init__(self, crops: CropSet, people: int, pictures: int, seed: int) -> None:
        """Set up batches of P `people` (all people if there are fewer), with K `pictures` of each."""
        self._crops, self._seed = crops, seed
        self._people, self._pictures = min(people, len(np.unique(crops.person))), pictures
        self.epoch = 0

    @property
    def size(self) -> int:
        """Number of pictures in a batch; the maximum, if not all people are known to be different."""
        return self._people * self._pictures

    def __len__(self) -> int:
        """Return the number of batches in an epoch: each picture occurs once on average."""
        return max(1, round(len(self._crops) / self.size))

    def __iter__(self) -> Iterator[list[Draw]]:
        """Draw the batches of the epoch."""
        rng = np.random.default_rng((self._seed, self.epoch))
        rows = self._draw_batches(rng) if self._crops.apart is None else self._draw_distinct_batches(rng, self._crops.apart)
        place = 0
        for batch in rows:
            yield [(row, self.epoch, place + k) for k, row in enumerate(batch)]
            place += len(batch)

    def _draw_batches(self, rng: np.random.Generator) -> Iterator[list[int]]:
        """Draw batches for a set in which all people are known to be different."""
        with _drawing_from(rng):
            sampler = MPerClassSampler(self._crops.person, self._pictures, self.size, len(self) * self.size)
            rows = [int(row) for row in sampler]
        for start in range(0, len(rows), self.size):
            yield rows[start : start + self.size]

    def _draw_distinct_batches(self, rng: np.random.Generator, apart: np.ndarray) -> Iterator[list[int]]:
        """Draw batches in which each two people are known to be different: each new person differs from all before.

        Pictures are drawn evenly over the cameras, because the network has to learn that two cameras show one person.
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
        """Return the rows of a person's pictures, camera by camera."""
        rows = np.flatnonzero(self._crops.person == person)
        return [rows[self._crops.camera[rows] == camera] for camera in np.unique(self._crops.camera[rows])]

    def _draw_pictures(self, by_camera: list[Ints], rng: np.random.Generator) -> list[int]:
        """Draw K pictures of a person from the cameras in turn; none a second time before all have been drawn."""
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
    """Replace the random generator of the library's module by `rng` for the context."""
    before, common_functions.NUMPY_RANDOM = common_functions.NUMPY_RANDOM, rng
    try:
        yield
    finally:
        common_functions.NUMPY_RANDOM = before
