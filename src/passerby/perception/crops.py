"""Boxes cut out of pictures at the size that a network takes, and the ways back.

Positions are continuous and count as OpenCV's, for boxes and joints alike: the middle of a picture's first pixel is (0, 0).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.pictures import Picture

# Below this size a person is a smear of a few pixels (a torso 3 px wide) that says nothing of the clothes.
MIN_WIDTH_PX, MIN_HEIGHT_PX = 8.0, 16.0
# Of a box with less than half of its area within the picture, the rest would be stretched into another person's shape.
MIN_VISIBLE = 0.5


def is_recognisable(picture: Picture, ltwh: Floats) -> NDArray[np.bool_]:
    """(N,) the boxes (N, 4) that are large enough and far enough inside of the picture to show how a person looks."""
    height, width = picture.shape[:2]
    low = np.maximum(ltwh[:, :2], 0.0)
    visible = np.maximum(np.minimum(ltwh[:, :2] + ltwh[:, 2:], (width, height)) - low, 0.0)
    large = (visible >= (MIN_WIDTH_PX, MIN_HEIGHT_PX)).all(axis=1)
    return np.asarray(large & (visible.prod(axis=1) >= MIN_VISIBLE * ltwh[:, 2:].prod(axis=1)))


def stretch_crop(picture: Picture, box: Floats, size: tuple[int, int]) -> Picture:
    """The visible part of a box (4,), to whole pixels, stretched to `size` (width, height).

    Averaged where the box is the larger (a striped shirt keeps its mean colour), interpolated where it is the smaller.
    """
    height, width = picture.shape[:2]
    left, top, right, bottom = box[0], box[1], box[0] + box[2], box[1] + box[3]
    x0, y0 = min(max(round(left), 0), width - 1), min(max(round(top), 0), height - 1)
    # At least one pixel, also of a box thinner than that.
    x1, y1 = max(min(round(right), width), x0 + 1), max(min(round(bottom), height), y0 + 1)
    shrinking = x1 - x0 >= size[0] and y1 - y0 >= size[1]
    crop = cv2.resize(picture[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR)
    return np.asarray(crop, dtype=np.uint8)


def enlarge_box(box: Floats, margin: float, aspect: float) -> Floats:
    """(4,) the smallest box of the aspect ratio width / height that holds the box (4,) enlarged `margin` times; same centre."""
    left, top, width, height = box
    new_height = margin * max(height, width / aspect)
    new_width = new_height * aspect
    return np.array([left + (width - new_width) / 2, top + (height - new_height) / 2, new_width, new_height])


def sample_crop(picture: Picture, box: Floats, size: tuple[int, int], padding: float = 0.0) -> Picture:
    """A box (4,), wherever it lies, sampled to `size` (width, height); grey of `padding` (0 to 255) outside of the picture.

    The crop's pixel (i, j), counted from 0, shows the picture at `left + (i + 0.5) * width / size[0]`, and so in height. Where
    the box is more than twice as large, several samples are averaged, one for every two pixels of the picture: that is as far
    as one bilinear sample looks.
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
