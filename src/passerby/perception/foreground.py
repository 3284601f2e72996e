"""Which pixels of a picture are not background."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np

from passerby.common.arrays import Floats
from passerby.perception.background_statistics import Levels, local_contrast
from passerby.perception.pictures import Picture
from passerby.perception.shadows import ShadowOptions, Shadows, find_shadows, recover_foreground, without_slivers

LEAST = 5.0
"""Grey levels: compression changes flat areas by as much in the wake of people."""
SIGMAS = 3.0
RELATIVE = 0.03
"""Part of the level: cameras and encoders are not linear, and bright areas do not follow the light's gain."""
SHAKE_PX = 0.1
"""How far the picture may have moved, pixels: sharp edges of the background need the tolerance."""
CERTAIN = 2.0
"""A region must somewhere differ by so many times the tolerance."""
SUBSAMPLING = 4
"""The light is measured on every fourth pixel both ways."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The background at one time, prepared for comparison."""

    colour: Picture
    """(H, W, 3) BGR."""
    tolerance: Levels
    """(H, W, 3) grey levels."""
    certain: Levels
    """(H, W, 3) grey levels: a region must differ by more somewhere."""


def prepare_reference(colour: Picture, noise: Levels) -> Reference:
    """A background ready for comparison; `noise` as `usual_colours` has it."""
    sigma = noise.astype(np.float32) / 8.0
    contrast = local_contrast(colour).astype(np.float32)
    tolerance = LEAST + RELATIVE * colour.astype(np.float32) + SIGMAS * sigma + SHAKE_PX * contrast
    low, high = (np.minimum(tolerance * times, 255.0).astype(np.uint8) for times in (1.0, CERTAIN))
    return Reference(colour, low, high)


def light_gain(picture: Picture, colour: Picture) -> Floats:
    """(3,) each channel's brightness over the background's: median ratio of pixels neither dark nor burnt out."""
    small = picture[::SUBSAMPLING, ::SUBSAMPLING].reshape(-1, 3).astype(np.float32)
    usual = colour[::SUBSAMPLING, ::SUBSAMPLING].reshape(-1, 3).astype(np.float32)
    gain = np.ones(3)
    for channel in range(3):
        now, before = small[:, channel], usual[:, channel]
        fit = (before > 30) & (before < 245) & (now < 245)
        if fit.sum() >= 100:
            gain[channel] = np.median(now[fit] / before[fit])
    return np.clip(gain, 0.25, 4.0)


@dataclass(frozen=True, eq=False)
class Foreground:
    """What stands before the background of a picture."""

    body: Levels
    """(H, W) 255 for people and things, shadows left out."""
    shadows: Shadows


def foreground(picture: Picture, reference: Reference, options: ShadowOptions, tone: Floats | None) -> Foreground:
    """Compare a picture with its background; `tone` as `find_shadows` has it."""
    gain = light_gain(picture, reference.colour)
    usual = _brightened(reference.colour, gain)
    difference = cv2.absdiff(picture, usual)
    low = cast(Levels, cv2.medianBlur(_any_channel(cv2.subtract(difference, reference.tolerance)), 3))
    high = cast(Levels, cv2.medianBlur(_any_channel(cv2.subtract(difference, reference.certain)), 3))
    shadows = find_shadows(picture, usual, low, high, options, tone)
    body = _with_seed(low & ~shadows.mask, high)
    return Foreground(recover_foreground(without_slivers(body, shadows.mask), shadows.mask), shadows)


def _brightened(colour: Picture, gain: Floats) -> Picture:
    """The background in the light of a picture."""
    if np.abs(gain - 1.0).max() < 1e-3:
        return colour
    levels = np.arange(256, dtype=np.float64)[:, None] * gain
    table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)[None]
    return cast(Picture, cv2.LUT(colour, table))


def _any_channel(excess: Any) -> Levels:
    """255 where any of three channels is above 0."""
    blue, green, red = cv2.split(excess)
    most = cv2.max(cv2.max(blue, green), red)
    return cast(Levels, cv2.threshold(most, 0, 255, cv2.THRESH_BINARY)[1])


def _with_seed(mask: Levels, seed: Levels) -> Levels:
    """The connected regions of a mask that hold a pixel of the seed."""
    count, label = cv2.connectedComponents(mask, connectivity=8, ltype=cv2.CV_32S)
    keep = np.zeros(count, np.uint8)
    keep[label[seed > 0]] = 255
    keep[0] = 0
    return cast(Levels, keep[label])
