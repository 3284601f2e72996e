"""Pictures varied as other cameras, moments and detectors would show them."""

from __future__ import annotations

import cv2
import numpy as np

from passerby.perception.own_networks import IMAGENET_MEAN
from passerby.perception.pictures import Picture
from passerby.training.options import TrainOptions

ERASED_AREA = (0.02, 0.4)
"""Share of the picture that is erased, and its proportions: as published (Zhong et al., AAAI 2020)."""
ERASED_ASPECT = (0.3, 3.33)
ERASED_COLOUR = tuple(255.0 * mean for mean in reversed(IMAGENET_MEAN))
"""Blue, green, red: the mean, which the network sees as 0."""
TRIES = 20


def augment(picture: Picture, options: TrainOptions, rng: np.random.Generator) -> Picture:
    """(H, W, 3) a variation of a picture: colour, place, mirrored, a part erased, as the options say. The draws do not depend
    on the picture.
    """
    if options.colour > 0:
        picture = _recoloured(picture, options.colour, rng)
    if options.shift > 0:
        picture = _shifted(picture, options.shift, rng)
    if rng.uniform() < options.flip:
        picture = picture[:, ::-1]
    if rng.uniform() < options.erasing:
        picture = _erased(picture, rng)
    return np.ascontiguousarray(picture)


def _recoloured(picture: Picture, most: float, rng: np.random.Generator) -> Picture:
    """Brightness and contrast of the whole picture, and half as much of each channel's gain: exposure and white balance."""
    brightness, contrast = rng.uniform(-most, most, 2)
    gain = 1.0 + rng.uniform(-most / 2, most / 2, 3)
    middle = float(picture.mean())
    # Straight lines in the pixel's value: contrast about the picture's mean, then brightness, then the channel's gain.
    slope = (1.0 + contrast) * (1.0 + brightness) * gain
    offset = (1.0 - (1.0 + contrast)) * middle * (1.0 + brightness) * gain
    table = np.clip(np.arange(256)[:, None] * slope + offset, 0, 255).round().astype(np.uint8)
    return np.asarray(cv2.LUT(picture, table[:, None, :]), dtype=np.uint8)


def _shifted(picture: Picture, most: float, rng: np.random.Generator) -> Picture:
    """The picture within an edge of the mean colour, cut out at another place: detectors' boxes are off by as much."""
    height, width = picture.shape[:2]
    edge = max(1, round(most * height))
    left, top = rng.integers(0, 2 * edge + 1, 2)
    framed = cv2.copyMakeBorder(picture, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=ERASED_COLOUR)
    return np.asarray(framed[top : top + height, left : left + width], dtype=np.uint8)


def _erased(picture: Picture, rng: np.random.Generator) -> Picture:
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
