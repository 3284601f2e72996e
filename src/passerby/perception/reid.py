"""Appearance by a re-identification network: any ONNX file that turns a person's crop into a vector."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.observations import Vectors
from passerby.perception.crop_network import CropNetwork, crop_rows
from passerby.perception.crops import is_recognisable, stretch_crop
from passerby.perception.networks import Network
from passerby.perception.pictures import Identity, Picture

# What nearly all re-identification networks take; used only where the file leaves its size open.
USUAL_SIZE = (128, 256)
# A crop of 128x256 in float32 takes 0.4 MB, its activations some 50 times that. On one core larger batches bring nothing.
BATCH = 16


class ReidEmbedder:
    """An embedder from an ONNX file: crops stretched to its input, its output flattened and brought to length one."""

    def __init__(self, network: Network, *, batch: int = BATCH) -> None:
        """Open the network; `batch`: crops at once where the file takes any number of them.

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
        """What decides its results: the network, its conventions, and how crops are cut."""
        return {"embedder": "reid", "version": 1, **self._crops.network.identity}

    @property
    def dimensions(self) -> int:
        """Length of a vector."""
        return self._dimensions

    def __call__(self, picture: Picture, ltwh: Floats) -> Vectors:
        """(N, D) unit vectors of the boxes (N, 4); a row of zeros for a box too small or for the most part outside of
        the picture.
        """
        boxes = crop_rows(ltwh)
        vectors = np.zeros((len(boxes), self._dimensions), dtype=np.float32)
        rows = np.flatnonzero(is_recognisable(picture, boxes))
        if not len(rows):
            return vectors
        answers = self._crops([stretch_crop(picture, boxes[row], self._crops.size) for row in rows])[0]
        raw = answers.reshape(len(rows), -1).astype(np.float64)
        length = np.linalg.norm(raw, axis=1, keepdims=True)
        # Black within float16, infinite or not a number: it says nothing.
        sound = np.isfinite(length) & (length > 0)
        vectors[rows] = np.where(sound, raw / np.where(sound, length, 1.0), 0.0)
        return vectors
