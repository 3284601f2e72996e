"""From a picture file to what the network sees: the same in training, in evaluation and, after export, in use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from passerby.core.observations import Vectors
from passerby.perception.crops import stretch_crop
from passerby.perception.own_networks import IMAGENET
from passerby.perception.pictures import Picture
from passerby.training.crops import CropSet
from passerby.training.data.pictures import read_picture
from passerby.training.network import ReidNetwork
from passerby.training.options import TrainOptions


def load_picture(path: Path, size: tuple[int, int]) -> Picture:
    """(H, W, 3) BGR, a picture file stretched to `size`, its width and height. Raises `InputError` where it cannot be read."""
    picture = read_picture(path)
    height, width = picture.shape[:2]
    return stretch_crop(picture, np.array([0.0, 0.0, width, height]), size)


def as_batch(pictures: Sequence[Picture]) -> Tensor:
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
            vectors = network.embed(normalise_pictures(as_batch(pictures).to(device)))
            found.append(functional.normalize(vectors.float(), dim=1).cpu().numpy())
    return np.concatenate(found)


def decoded_pictures(crops: CropSet) -> list[Picture]:
    """The pictures of a set as they lie on disk, BGR, of any sizes. Raises `InputError` where one cannot be read."""
    return [read_picture(path) for path in crops.paths]
