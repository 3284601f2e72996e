"""A network of the user's own that estimates a camera's field of view from one picture.

The ONNX file has one input, float, [1, 3, height, width]: a picture in RGB with values from 0 to 1, scaled to that height and
width. Where the file leaves them open, the aspect ratio is kept, the longer side is 640 pixels at most, and both are multiples
of 32. The first output is one number: the vertical field of view of the whole picture in radians, for a pinhole camera with its
principal point in the middle. Other outputs, such as gravity, are ignored. Exports of GeoCalib or AnyCalib give fields or rays;
they need a last layer that converts them to this number.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.perception.pictures import Picture
from passerby.perception.sessions import inputs_of, open_session, outputs_of, runtime_errors
from passerby.perception.video import VideoReader
from passerby.perception.video_probe import VideoInfo

FOCAL_SD = 0.07
"""Standard deviation of a focal length from one picture, as a share: the error of such networks is 6 to 10 % at best."""
PICTURES, EVERY_S = 5, 2.0
"""Number of pictures from the start of a video whose median is used, and the seconds between them."""
OPEN_SIDE_PX, MULTIPLE = 640, 32
FIELDS_OF_VIEW = math.radians(1.0), math.radians(175.0)
CONTRACT = "[1, 3, height, width] of float"


class LensNetwork:
    """An opened network.

    Args:
        path: the ONNX file.

    Raises:
        InputError: no such file, no ONNX file, or inputs or outputs that differ from the description in the module.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._session = open_session(path)
        ports = inputs_of(self._session)
        shape = ports[0].shape if len(ports) == 1 else ()
        if len(shape) != 4 or shape[0] not in (1, None) or shape[1] not in (3, None) or ports[0].kind != "tensor(float)":
            told = "; ".join(map(str, ports)) or "none"
            raise InputError(f"{path}: its inputs are {told}: a network that sees the field of view takes one {CONTRACT}")
        self._input, self._height, self._width = ports[0].name, shape[2], shape[3]
        output = outputs_of(self._session)[0]
        if any(size not in (1, None) for size in output.shape):
            raise InputError(f"{path}: its first output is {output}: {_WANTED}")
        self._output = output.name

    def vertical_fov(self, picture: Picture) -> float:
        """Estimate the vertical field of view of a picture, radians. Raises `InputError` where the network gives none."""
        height, width = self._size_for(picture)
        rgb = cv2.cvtColor(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)
        pixels = np.ascontiguousarray(rgb.transpose(2, 0, 1)[None], dtype=np.float32) / np.float32(255.0)
        try:
            (found,) = self._session.run([self._output], {self._input: pixels})
        except runtime_errors() as error:
            raise InputError(f"{self._path}: fails on a picture: {' '.join(str(error).split())[:160]}") from None
        values = np.asarray(found)
        if values.size != 1:
            raise InputError(f"{self._path}: its first output has the shape {list(values.shape)}: {_WANTED}")
        fov = float(values.reshape(-1)[0])
        if not FIELDS_OF_VIEW[0] <= fov <= FIELDS_OF_VIEW[1]:
            raise InputError(f"{self._path}: gives a vertical field of view of {fov:g} radians: {_WANTED}")
        return fov

    def _size_for(self, picture: Picture) -> tuple[int, int]:
        """Return height and width of the input for a picture."""
        height, width = picture.shape[:2]
        scale = min(1.0, OPEN_SIDE_PX / max(height, width))
        free = [max(MULTIPLE, round(side * scale / MULTIPLE) * MULTIPLE) for side in (height, width)]
        return self._height or free[0], self._width or free[1]


_WANTED = "the first output has to be one number, the vertical field of view in radians"


def median_vertical_fov(network: LensNetwork, pictures: Iterable[Picture]) -> float:
    """Return the median over pictures of one camera, radians. Raises `InputError` where there are none."""
    found = [network.vertical_fov(picture) for picture in pictures]
    if not found:
        raise InputError("a video without pictures shows no field of view")
    return float(np.median(found))


def lens_from_video(network: LensNetwork, info: VideoInfo, lens: Lens) -> Lens:
    """Return an uncalibrated pinhole lens with the focal length that a network finds in the video, known to `FOCAL_SD`."""
    frames = islice(VideoReader(info, rate=1.0 / EVERY_S), PICTURES)
    fov = median_vertical_fov(network, (frame.picture for frame in frames))
    return lens.with_focal(0.5 * lens.size[1] / math.tan(fov / 2) / lens.focal, FOCAL_SD)
