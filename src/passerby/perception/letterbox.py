"""Windows of a picture as a network takes them: fitted to its input, in its colours, layout and type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.networks import InputConvention
from passerby.perception.pictures import Picture

Window = tuple[int, int, int, int]
"""Left, top, width, height of a part of a picture, pixels."""


@dataclass(frozen=True)
class Fitting:
    """Where a window lies in the network's input: an input coordinate is a window coordinate times `scale`, from 0 on."""

    window: Window
    scale: tuple[float, float]
    """Along x and y; they differ by the rounding to whole pixels, or freely where the picture is stretched."""

    def to_picture(self, ltrb: Floats) -> Floats:
        """Boxes (N, 4) left, top, right, bottom in the network's input, in pixels of the whole picture."""
        left, top, _, _ = self.window
        return np.asarray(ltrb / np.array(self.scale * 2) + np.array([left, top, left, top]))


def fit_window(
    picture: Picture, window: Window, size: tuple[int, int], convention: InputConvention, kind: np.dtype[Any]
) -> tuple[NDArray[Any], Fitting]:
    """A window of a picture as a network's input.

    Args:
        picture: (H, W, 3) uint8 BGR.
        window: which part of it.
        size: height and width of the network's input.
        convention: colours, values and padding; a letterbox lies at the top left, as YOLOX was trained.
        kind: type of the network's input.

    Returns:
        (1, 3, height, width) of `kind`, and where the window lies in it.
    """
    left, top, width, height = window
    scales = size[1] / width, size[0] / height
    if convention.fit == "letterbox":
        scales = (min(scales), min(scales))
    inner = max(1, min(size[1], round(width * scales[0]))), max(1, min(size[0], round(height * scales[1])))
    part: Any = picture[top : top + height, left : left + width]
    # Picking four pixels of many would turn fine detail into patterns. Halving is a tenth of the cost of averaging to any size.
    while part.shape[1] >= 2 * inner[0] and part.shape[0] >= 2 * inner[1]:
        part = cv2.resize(part, (part.shape[1] // 2, part.shape[0] // 2), interpolation=cv2.INTER_AREA)
    if part.shape[1::-1] != inner:
        part = cv2.resize(part, inner, interpolation=cv2.INTER_LINEAR)
    planes = cv2.split(part)
    if convention.colour == "rgb":
        planes = planes[::-1]
    gain = [convention.scale / std for std in convention.std]
    shift = [-mean / std for mean, std in zip(convention.mean, convention.std, strict=True)]
    values = np.empty((1, 3, *size), dtype=kind)
    for channel in range(3):
        values[0, channel, inner[1] :] = values[0, channel, :, inner[0] :] = convention.padding * gain[channel] + shift[channel]
        plane: Any = planes[channel]
        if (gain[channel], shift[channel]) != (1.0, 0.0):
            plane = plane * np.float32(gain[channel]) + np.float32(shift[channel])
        values[0, channel, : inner[1], : inner[0]] = plane
    return values, Fitting(window, (inner[0] / width, inner[1] / height))
