"""Appearance of people, from a re-identification network or from colour histograms of horizontal stripes.

Hair, jacket, trousers and shoes are one above the other, in whichever direction a person turns. So each of six stripes has its
own histograms: one of the colours as they are (best within a camera), and one of the colours after each channel was equalised
over the crop. Cameras differ in exposure and white balance, but seldom in what is brighter or redder than what. The measure is
rank-1 (the most similar is the same person), with similarity by the dot product. The first value is for PETS 2009 V1, 4 to 9
seconds apart among those seen at one instant; the second for people of one camera searched for in another (62 people, 16 crops
each; chance 0.016):

- colours as they are alone: 0.83 and 0.19; equalised alone: 0.74 and 0.29; both, as here: 0.81 and 0.31;
- colours as they are, without weighting the middle columns: 0.76 and 0.13;
- a small re-identification network (256 values, OpenVINO's retail-0248): 0.94 and 0.81.

The histograms are square-rooted, so that the dot product of two is their Bhattacharyya coefficient (Hellinger's distance;
Arandjelović and Zisserman, "Three things everyone should know to improve object retrieval", CVPR 2012).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.observations import Vectors
from passerby.perception.crop_network import CropNetwork, crop_rows, is_recognisable, stretch_crop
from passerby.perception.networks import Network
from passerby.perception.pictures import Identity, Picture

# Input size of nearly all re-identification networks; used only where the file leaves its size open.
USUAL_SIZE = (128, 256)
# A crop of 128x256 in float32 takes 0.4 MB, its activations some 50 times that. On one core larger batches are not faster.
BATCH = 16
STRIPES = 6
# People far away are 30 to 100 px tall: more pixels would add no information, and cost time in proportion.
SIZE = (32, 96)
# Width of the weight of the middle columns, as a share of the box's: rank-1 within a camera is 0.82 at 0.18 and at 0.09, and
# 0.76 with all columns alike, because the background beside a person then counts as much as the person.
MIDDLE = 0.12
# Bins of hue, saturation and value; 8, 4 and 4 bins gain 0.004 and need 444 more numbers per box.
PLAIN_BINS = (6, 3, 3)
# Bins of hue, and of value; there is one more bin of hue for pixels without colour, whose hue is noise.
EQUAL_BINS = (8, 4)
# From this chroma (saturation times value) on, a pixel's hue counts in full.
COLOURFUL = 0.2
# Share of the similarity that the equalised colours contribute.
EQUAL_SHARE = 2.0 / 3.0
# Number of crops at once; it bounds the memory (25 MB).
STRIPES_BATCH = 32
Values = NDArray[np.float32]
Soft = list[tuple[NDArray[np.int64], Values]]
"""Values shared between neighbouring bins: a pair of arrays, the bins' numbers and the weights, for each neighbour."""


class ReidEmbedder:
    """An embedder from an ONNX file: crops are stretched to its input, its output is flattened and scaled to length one."""

    def __init__(self, network: Network, *, batch: int = BATCH) -> None:
        """Open the network; `batch` is the number of crops at once where the file takes any number of them.

        Raises `InputError` for a file that does not open, does not take crops of people, or does not give one vector each.
        """
        self._crops = CropNetwork(network, batch=batch, open_size=USUAL_SIZE)
        if len(self._crops.outputs) != 1:
            found = "; ".join(map(str, self._crops.outputs))
            raise InputError(
                f"{network.path}: gives {found}: one output, the embedding, is needed; export it without the others"
            )
        shape = self._crops.probed()[0].shape
        self._dimensions = int(np.prod(shape[1:]))
        if self._dimensions < 2:
            raise InputError(
                f"{network.path}: gives the shape {list(shape)} for one crop: a vector of 2 numbers or more is needed"
            )

    @property
    def identity(self) -> Identity:
        """Settings that determine its results: the network, its conventions, and how crops are cut."""
        return {"embedder": "reid", "version": 1, **self._crops.network.identity}

    @property
    def dimensions(self) -> int:
        """Length of a vector."""
        return self._dimensions

    def __call__(self, picture: Picture, ltwh: Floats) -> Vectors:
        """Compute unit vectors (N, D) of the boxes (N, 4); a row of zeros for a box that is too small, or for the most part
        outside of the picture.
        """
        boxes = crop_rows(ltwh)
        vectors = np.zeros((len(boxes), self._dimensions), dtype=np.float32)
        rows = np.flatnonzero(is_recognisable(picture, boxes))
        if not len(rows):
            return vectors
        answers = self._crops([stretch_crop(picture, boxes[row], self._crops.size) for row in rows])[0]
        raw = answers.reshape(len(rows), -1).astype(np.float64)
        length = np.linalg.norm(raw, axis=1, keepdims=True)
        # A vector that is zero (as black within float16), infinite or not a number has no information.
        sound = np.isfinite(length) & (length > 0)
        vectors[rows] = np.where(sound, raw / np.where(sound, length, 1.0), 0.0)
        return vectors


class StripesEmbedder:
    """Stripes of colour histograms as an embedder; see the module."""

    @property
    def identity(self) -> Identity:
        """Settings that determine its results; the version changes with any of the constants."""
        return {"embedder": "stripes", "version": 1}

    @property
    def dimensions(self) -> int:
        """Length of a vector: 540."""
        return STRIPES * (int(np.prod(PLAIN_BINS)) + (EQUAL_BINS[0] + 1) * EQUAL_BINS[1])

    def __call__(self, picture: Picture, ltwh: Floats) -> Vectors:
        """Compute unit vectors (N, D) of the boxes (N, 4); a row of zeros for a box that is too small, or for the most part
        outside of the picture.

        Raises `InputError` for boxes of another shape.
        """
        boxes = crop_rows(ltwh)
        vectors = np.zeros((len(boxes), self.dimensions), dtype=np.float32)
        rows = np.flatnonzero(is_recognisable(picture, boxes))
        for start in range(0, len(rows), STRIPES_BATCH):
            part = rows[start : start + STRIPES_BATCH]
            vectors[part] = _embed_stripes(np.stack([stretch_crop(picture, boxes[row], SIZE) for row in part]))
        return vectors


def _embed_stripes(crops: NDArray[np.uint8]) -> Vectors:
    """Compute unit vectors (N, D) of crops (N, H, W, 3), BGR."""
    equal = np.stack([np.stack([cv2.equalizeHist(crop[..., k]) for k in range(3)], axis=-1) for crop in crops])
    plain_root = np.sqrt((1.0 - EQUAL_SHARE) * _count_colours(crops))
    equal_root = np.sqrt(EQUAL_SHARE * _count_equalised(equal))
    return np.hstack([plain_root, equal_root]).astype(np.float32)


def _count_colours(crops: NDArray[np.uint8]) -> Floats:
    """Compute joint histograms (N, stripes * bins) of hue, saturation and value; those of a crop sum to one."""
    hue, saturation, value = _hsv(crops)
    hues, saturations, values = PLAIN_BINS
    shares = [_share_circular(hue, hues), _share_linear(saturation, saturations), _share_linear(value, values)]
    return _histograms(shares, PLAIN_BINS, len(crops))


def _count_equalised(crops: NDArray[np.uint8]) -> Floats:
    """Compute joint histograms (N, stripes * bins) of hue, where there is colour, and value; those of a crop sum to one."""
    hue, saturation, value = _hsv(crops)
    colour = np.minimum(saturation * value / np.float32(COLOURFUL), np.float32(1.0))
    hues, values = EQUAL_BINS
    grey = np.full(hue.shape, hues, dtype=np.int64)
    coloured = [(number, weight * colour) for number, weight in _share_circular(hue, hues)]
    return _histograms([[*coloured, (grey, 1.0 - colour)], _share_linear(value, values)], (hues + 1, values), len(crops))


def _hsv(crops: NDArray[np.uint8]) -> tuple[Values, Values, Values]:
    """Convert crops to hue, saturation and value, 0 to 1, each (N, H, W)."""
    n, height, width, _ = crops.shape
    wide = np.asarray(crops.reshape(n * height, width, 3), dtype=np.float32) / np.float32(255.0)
    hsv = cv2.cvtColor(wide, cv2.COLOR_BGR2HSV).reshape(n, height, width, 3)
    return (
        np.asarray(hsv[..., 0] / np.float32(360.0), dtype=np.float32),
        np.asarray(hsv[..., 1], dtype=np.float32),
        np.asarray(hsv[..., 2], dtype=np.float32),
    )


def _share_circular(share: Values, bins: int) -> Soft:
    """Share a circular value, 0 to 1, between the two nearest bins, whose middles are at 0, 1 / bins and so on."""
    place = share * np.float32(bins)
    low = np.floor(place)
    weight = place - low
    number = low.astype(np.int64)
    return [(number % bins, 1.0 - weight), ((number + 1) % bins, weight)]


def _share_linear(share: Values, bins: int) -> Soft:
    """Share a value, 0 to 1, between the two bins with the nearest middles; beyond the last middle all goes to that bin."""
    place = np.clip(share * np.float32(bins) - np.float32(0.5), 0.0, bins - 1.0).astype(np.float32)
    low = np.minimum(np.floor(place), np.float32(bins - 2))
    weight = place - low
    number = low.astype(np.int64)
    return [(number, 1.0 - weight), (number + 1, weight)]


def _histograms(shares: list[Soft], bins: tuple[int, ...], n: int) -> Floats:
    """Compute joint histograms (N, stripes * bins) of pixels (N, H, W), the middle columns weighted; a crop sums to one."""
    width, height = SIZE
    per_stripe = int(np.prod(bins))
    length = STRIPES * per_stripe
    columns = (np.arange(width) + 0.5) / width - 0.5
    weight = np.exp(-0.5 * (columns / MIDDLE) ** 2).astype(np.float32)
    weight /= weight.sum() * np.float32(height)
    stripe = np.arange(height) * STRIPES // height
    corners: Soft = [
        ((np.arange(n)[:, None, None] * length + stripe[None, :, None] * per_stripe), np.broadcast_to(weight, (1, 1, width)))
    ]
    stride = per_stripe
    for share, count in zip(shares, bins, strict=True):
        stride //= count
        corners = [(place + number * stride, held * part) for place, held in corners for number, part in share]
    place = np.stack([place for place, _ in corners])
    held = np.stack([held for _, held in corners])
    counted: Floats = np.bincount(place.ravel(), held.ravel(), minlength=n * length).astype(np.float64)
    return counted.reshape(n, length)
