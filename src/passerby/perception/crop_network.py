"""Crops of people: cut from pictures at the input size of a network, and passed through it in batches.

Positions are continuous and as in OpenCV, for boxes and joints alike: the middle of a picture's first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.perception.networks import Network
from passerby.perception.pictures import Picture
from passerby.perception.sessions import Port, inputs_of, open_session, outputs_of

_NUMBER_TYPES: dict[str, type[np.generic]] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
}
# Below this size a person is a blur of a few pixels (a torso 3 px wide) without information on the clothes.
MIN_WIDTH_PX, MIN_HEIGHT_PX = 8.0, 16.0
# If less than half of a box is in the picture, the visible part would be stretched into another person's shape.
MIN_VISIBLE = 0.5


@dataclass(frozen=True)
class CropInput:
    """Format in which a network takes its crops, read from the file."""

    name: str
    kind: type[np.generic]
    channels_first: bool
    """True for (N, 3, H, W), False for (N, H, W, 3)."""
    size: tuple[int, int]
    """Width and height, pixels."""
    batch: int | None
    """Number of crops that it takes at once; None for any."""


class CropNetwork:
    """An ONNX file whose input is crops of one size."""

    def __init__(self, network: Network, *, batch: int, open_size: tuple[int, int] | None = None) -> None:
        """Open the file.

        Args:
            network: the file and its conventions.
            batch: number of crops at once, where the file takes any number.
            open_size: width and height to use where the file leaves them open. None: the file must state them.

        Raises `InputError` for a file that does not open or takes no crops.
        """
        self.network = network
        self._session = open_session(network.path)
        self.input = _crop_input(network, inputs_of(self._session), open_size)
        self.outputs: tuple[Port, ...] = outputs_of(self._session)
        self._batch = self.input.batch or batch

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a crop, pixels."""
        return self.input.size

    def probed(self) -> list[NDArray[Any]]:
        """Return the outputs for one black crop, to know their shapes. Raises `InputError` where the network does not run."""
        width, height = self.size
        try:
            return self([np.zeros((height, width, 3), dtype=np.uint8)])
        except InputError:
            raise
        except Exception as error:  # ONNX Runtime's errors have no common base.
            said = " ".join(str(error).split())[:200]
            raise InputError(
                f"{self.network.path}: does not run on a crop of {width}x{height} pixels ({said}): give another network"
            ) from error

    def __call__(self, crops: list[Picture]) -> list[NDArray[Any]]:
        """Return the outputs for N crops of the right size, BGR: arrays (N, ...) in the file's order; N at least 1."""
        parts = [self._run(crops[start : start + self._batch]) for start in range(0, len(crops), self._batch)]
        return [np.concatenate([part[k] for part in parts]) for k in range(len(parts[0]))]

    def _run(self, crops: list[Picture]) -> list[NDArray[Any]]:
        """Return the outputs for at most one batch; unused places in a batch of fixed size are black."""
        given = np.stack(crops)
        if self.input.batch is not None and len(crops) < self.input.batch:
            given = np.concatenate([given, np.zeros((self.input.batch - len(crops), *given.shape[1:]), dtype=np.uint8)])
        answers = [np.asarray(answer) for answer in self._session.run(None, {self.input.name: self._convert_layout(given)})]
        for answer, port in zip(answers, self.outputs, strict=True):
            if answer.ndim < 1 or len(answer) != len(given):
                raise InputError(
                    f"{self.network.path}: the output {port.name} has the shape {list(answer.shape)} for {len(given)} crops: "
                    "one row per crop is needed; export it with a batch of 1 or an open batch"
                )
        return [answer[: len(crops)] for answer in answers]

    def _convert_layout(self, crops: NDArray[np.uint8]) -> NDArray[np.generic]:
        """Convert crops (N, H, W, 3) BGR to the network's colours and layout: (N, 3, H, W) or (N, H, W, 3)."""
        convention = self.network.input
        values: NDArray[Any] = crops[..., ::-1] if convention.colour == "rgb" else crops
        if convention.scale != 1.0 or any(convention.mean) or set(convention.std) != {1.0}:
            mean, std = np.array(convention.mean, dtype=np.float32), np.array(convention.std, dtype=np.float32)
            values = (values * np.float32(convention.scale) - mean) / std
            if np.issubdtype(self.input.kind, np.integer):
                values = np.round(values)
        if self.input.channels_first:
            values = values.transpose(0, 3, 1, 2)
        return np.ascontiguousarray(values, dtype=self.input.kind)


def crop_rows(ltwh: Floats) -> Floats:
    """Check the shape of boxes (N, 4) and return them; raises `InputError` for another shape."""
    boxes = np.asarray(ltwh, dtype=np.float64)
    if boxes.size == 0:
        return np.zeros((0, 4))
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise InputError(f"boxes have the shape {boxes.shape}: (boxes, 4) is needed")
    return boxes


def _crop_input(network: Network, ports: tuple[Port, ...], open_size: tuple[int, int] | None) -> CropInput:
    """Return the input of a network that takes crops; otherwise raises `InputError` that states what was found instead."""
    found = "; ".join(map(str, ports)) or "nothing"
    needed = f"{network.path}: takes {found}: one input [N, 3, height, width] or [N, height, width, 3] is needed"
    if len(ports) != 1 or len(ports[0].shape) != 4:
        raise InputError(f"{needed}; is this a network for the role {network.role}?")
    port = ports[0]
    batch, second, third, fourth = port.shape
    if second == 3:
        channels_first, height, width = True, third, fourth
    elif fourth == 3:
        channels_first, height, width = False, second, third
    else:
        raise InputError(f"{needed}; is this a network for the role {network.role}?")
    if port.kind not in _NUMBER_TYPES:
        raise InputError(f"{needed}, of a type among {', '.join(kind[7:-1] for kind in _NUMBER_TYPES)}")
    if height is None or width is None:
        if open_size is None:
            raise InputError(f"{needed} with a stated height and width: export it with a fixed input size")
        width, height = open_size
    return CropInput(port.name, _NUMBER_TYPES[port.kind], channels_first, (width, height), batch)


def is_recognisable(picture: Picture, ltwh: Floats) -> NDArray[np.bool_]:
    """Return whether each box (N, 4) is large enough and far enough inside of the picture to show the appearance, (N,)."""
    height, width = picture.shape[:2]
    low = np.maximum(ltwh[:, :2], 0.0)
    visible = np.maximum(np.minimum(ltwh[:, :2] + ltwh[:, 2:], (width, height)) - low, 0.0)
    large = (visible >= (MIN_WIDTH_PX, MIN_HEIGHT_PX)).all(axis=1)
    return np.asarray(large & (visible.prod(axis=1) >= MIN_VISIBLE * ltwh[:, 2:].prod(axis=1)))


def stretch_crop(picture: Picture, box: Floats, size: tuple[int, int]) -> Picture:
    """Cut the visible part of a box (4,), rounded to whole pixels, and stretch it to `size` (width, height).

    It is averaged if the box is larger (a striped shirt keeps its mean colour), and interpolated if the box is smaller.
    """
    height, width = picture.shape[:2]
    left, top, right, bottom = box[0], box[1], box[0] + box[2], box[1] + box[3]
    x0, y0 = min(max(round(left), 0), width - 1), min(max(round(top), 0), height - 1)
    # At least one pixel, also for a thinner box.
    x1, y1 = max(min(round(right), width), x0 + 1), max(min(round(bottom), height), y0 + 1)
    shrinking = x1 - x0 >= size[0] and y1 - y0 >= size[1]
    crop = cv2.resize(picture[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR)
    return np.asarray(crop, dtype=np.uint8)


def enlarge_box(box: Floats, margin: float, aspect: float) -> Floats:
    """Return the smallest box (4,) of aspect ratio width / height that holds the box enlarged `margin` times; same centre."""
    left, top, width, height = box
    new_height = margin * max(height, width / aspect)
    new_width = new_height * aspect
    return np.array([left + (width - new_width) / 2, top + (height - new_height) / 2, new_width, new_height])


def sample_crop(picture: Picture, box: Floats, size: tuple[int, int], padding: float = 0.0) -> Picture:
    """Sample a box (4,) at any position to `size` (width, height); grey of `padding` (0 to 255) outside of the picture.

    The crop's pixel (i, j), counted from 0, shows the picture at `left + (i + 0.5) * width / size[0]`, and in height likewise.
    If the box is more than twice as large as the crop, several samples are averaged, one for every two pixels of the picture:
    one bilinear sample covers as much.
    """
    left, top, width, height = box
    times = max(1, int(np.ceil(max(width / size[0], height / size[1]) / 2.0)))
    fine = (size[0] * times, size[1] * times)
    step_x, step_y = width / fine[0], height / fine[1]
    to_picture = np.array([[step_x, 0.0, left + step_x / 2], [0.0, step_y, top + step_y / 2]])
    crop = cv2.warpAffine(
        picture,
        to_picture,
        fine,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(padding, padding, padding),
    )
    if times > 1:
        crop = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    return np.asarray(crop, dtype=np.uint8)
