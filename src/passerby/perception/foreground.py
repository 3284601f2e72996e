"""Foreground of a picture: the pixels that are not background.

The background is what a static camera sees without people: the usual colour of every pixel, and how much it varies.

Cast shadows are background in less light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.pictures import Picture

LEAST = 5.0
"""Least tolerance, grey levels: compression changes flat areas by as much where people have passed."""
SIGMAS = 3.0
RELATIVE = 0.03
"""Tolerance as a share of the level: cameras and encoders are not linear, and bright areas do not follow the light's gain."""
SHAKE_PX = 0.1
"""Possible motion of the picture, pixels: sharp edges of the background need this tolerance."""
CERTAIN = 2.0
"""A region must differ somewhere by this multiple of the tolerance."""
SUBSAMPLING = 4
"""The light is measured on every fourth pixel in both directions."""
Levels = NDArray[np.uint8]
ROUNDS = 2
"""Number of times that the samples are halved. A colour seen for more than half of the time is found. Where there is none, the
result is a colour that is seen for a quarter of the time and varies least."""
ROWS = 32
"""Number of rows that are processed at once: the memory stays small."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The background at one time, prepared for comparison."""

    colour: Picture
    """(H, W, 3) BGR."""
    tolerance: Levels
    """(H, W, 3) grey levels by which a pixel may differ."""
    certain: Levels
    """(H, W, 3) grey levels by more than which a region must differ somewhere."""


def prepare_reference(colour: Picture, noise: Levels) -> Reference:
    """Prepare a background for comparison; `noise` as from `find_usual_colours`."""
    sigma = noise.astype(np.float32) / 8.0
    contrast = measure_local_contrast(colour).astype(np.float32)
    tolerance = LEAST + RELATIVE * colour.astype(np.float32) + SIGMAS * sigma + SHAKE_PX * contrast
    low, high = (np.minimum(tolerance * times, 255.0).astype(np.uint8) for times in (1.0, CERTAIN))
    return Reference(colour, low, high)


def light_gain(picture: Picture, colour: Picture) -> Floats:
    """Return each channel's brightness over the background's, (3,): median ratio of pixels neither dark nor saturated."""
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
class Shadows:
    """The shadows in a picture."""

    mask: Levels
    """(H, W) 255 for shadow."""
    core: Levels
    """(H, W) the same without the borders of the shadows."""
    ratio: Levels
    """(H, W, 3) ratio of the picture to its background, 128 for 1."""


@dataclass(frozen=True, eq=False)
class Foreground:
    """Foreground of a picture, in front of its background."""

    body: Levels
    """(H, W) 255 for people and things, shadows left out."""
    shadows: Shadows


def foreground(picture: Picture, reference: Reference, options: ShadowOptions, tone: Floats | None) -> Foreground:
    """Compare a picture with its background; `tone` as in `find_shadows`."""
    gain = light_gain(picture, reference.colour)
    usual = _brightened(reference.colour, gain)
    difference = cv2.absdiff(picture, usual)
    low = cast(Levels, cv2.medianBlur(_merge_channels(cv2.subtract(difference, reference.tolerance)), 3))
    high = cast(Levels, cv2.medianBlur(_merge_channels(cv2.subtract(difference, reference.certain)), 3))
    shadows = find_shadows(picture, usual, low, high, options, tone)
    body = _keep_seeded(low & ~shadows.mask, high)
    return Foreground(recover_foreground(remove_slivers(body, shadows.mask), shadows.mask), shadows)


def _brightened(colour: Picture, gain: Floats) -> Picture:
    """Return the background in the light of a picture."""
    if np.abs(gain - 1.0).max() < 1e-3:
        return colour
    levels = np.arange(256, dtype=np.float64)[:, None] * gain
    table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)[None]
    return cast(Picture, cv2.LUT(colour, table))


def _merge_channels(excess: Any) -> Levels:
    """Return 255 where any of three channels is above 0."""
    blue, green, red = cv2.split(excess)
    most = cv2.max(cv2.max(blue, green), red)
    return cast(Levels, cv2.threshold(most, 0, 255, cv2.THRESH_BINARY)[1])


def _keep_seeded(mask: Levels, seed: Levels) -> Levels:
    """Keep the connected regions of a mask that contain a pixel of the seed."""
    count, label = cv2.connectedComponents(mask, connectivity=8, ltype=cv2.CV_32S)
    keep = np.zeros(count, np.uint8)
    keep[label[seed > 0]] = 255
    keep[0] = 0
    return cast(Levels, keep[label])


def find_usual_colours(pictures: Sequence[Picture]) -> tuple[Picture, Levels]:
    """Find the most frequent colour of every pixel, and its noise.

    The colour of a channel is its half-sample mode: the shortest interval that contains half of the samples, then half of those
    (Robertson and Cryer, *An Iterative Procedure for Estimating the Mode*, JASA 1974), and of these the middle one. The noise
    is the median deviation from it, converted to the standard deviation of a normal distribution: it is large for foliage in
    the wind, and people who pass add little.

    Args:
        pictures: n pictures (H, W, 3) of one size.

    Returns:
        (H, W, 3) BGR, and (H, W, 3) standard deviations, grey levels times 8, at most 255.
    """
    height, width = pictures[0].shape[:2]
    colour = np.empty((height, width, 3), np.uint8)
    noise = np.empty((height, width, 3), np.uint8)
    for row in range(0, height, ROWS):
        rows = slice(row, min(row + ROWS, height))
        colour[rows], noise[rows] = _find_usual_colours(np.stack([picture[rows] for picture in pictures]))
    return colour, noise


def _find_usual_colours(samples: Picture) -> tuple[Levels, Levels]:
    """Compute `find_usual_colours` of samples (n, ...), n first."""
    count = len(samples)
    ordered = _sorted(list(samples.copy()))
    start, held = _densest(ordered)
    usual = np.empty_like(ordered[0])
    middle = start + start.dtype.type((held - 1) // 2)
    for position, level in enumerate(ordered):
        np.copyto(usual, level, where=middle == position)
    deviation = _sorted([np.maximum(sample, usual) - np.minimum(sample, usual) for sample in samples])
    half = 0.5 * (deviation[(count - 1) // 2].astype(np.int16) + deviation[count // 2]).astype(np.float32)
    # Values are rounded to whole grey levels: the mean deviation of the nearer half has a finer resolution than its limit.
    near = deviation[: max(count // 2, 1)]
    nearer = np.add.reduce(near, dtype=np.uint32).astype(np.float32) / np.float32(len(near))
    sigma = np.maximum(half / 0.6745, nearer / 0.3247)
    return usual, np.minimum(np.rint(sigma * 8.0), 255).astype(np.uint8)


def _densest(ordered: Sequence[Levels]) -> tuple[NDArray[np.unsignedinteger], int]:
    """Find the samples that are closest together: the half, and of it the half, `ROUNDS` times; of equal ones the nearest to
    the median. Return the index of the first one in the n `ordered` (...) samples, ascending, and their number.
    """
    median, held = ordered[len(ordered) // 2], len(ordered)
    start = np.zeros(median.shape, np.min_scalar_type(len(ordered)))
    for _ in range(ROUNDS):
        half = max((held + 1) // 2, 1)
        last = start + start.dtype.type(held - half)
        best, found = np.full(median.shape, np.iinfo(np.uint16).max, np.uint16), start.copy()
        for position in range(len(ordered) - half + 1):
            middle = ordered[position + (half - 1) // 2]
            badness = (ordered[position + half - 1] - ordered[position]).astype(np.uint16) << 8
            badness |= np.maximum(middle, median) - np.minimum(middle, median)
            better = (badness < best) & (start <= position) & (position <= last)
            np.copyto(best, badness, where=better)
            np.copyto(found, position, where=better)
        start, held = found, half
    return start, held


def _sorted(planes: list[Levels]) -> list[Levels]:
    """Sort the n values of each pixel in ascending order; works in place on the list and the planes.

    A sorting network (Batcher 1968, *Sorting Networks and Their Applications*): each step compares two whole planes, which is
    several times faster than sorting each pixel's few values.
    """
    spare = np.empty_like(planes[0])
    for low, high in _comparators(len(planes)):
        np.minimum(planes[low], planes[high], out=spare)
        np.maximum(planes[low], planes[high], out=planes[high])
        planes[low], spare = spare, planes[low]
    return planes


@cache
def _comparators(n: int) -> tuple[tuple[int, int], ...]:
    """Return the pairs of indices that Batcher's odd-even merge sort of n values compares, in order."""
    out, merged = [], 1
    while merged < n:
        apart = merged
        while apart >= 1:
            for first in range(apart % merged, n - apart, 2 * apart):
                for low in range(first, first + min(apart, n - first - apart)):
                    if low // (2 * merged) == (low + apart) // (2 * merged):
                        out.append((low, low + apart))
            apart //= 2
        merged *= 2
    return tuple(out)


def measure_local_contrast(picture: Picture) -> Levels:
    """Return half the range among a pixel's neighbours (H, W, 3): its change in grey levels for a shift of one pixel."""
    kernel = np.ones((3, 3), np.uint8)
    return cast(Levels, cv2.morphologyEx(picture, cv2.MORPH_GRADIENT, kernel) // 2)


@dataclass(frozen=True)
class ShadowOptions:
    """Criteria for a shadow."""

    darkest: float = 0.4
    """Least ratio of a picture to its background: direct sun is seldom more than 60 % of the light."""
    lightest: float = 0.97
    chroma: float = 0.10
    """Largest difference of the ratio between channels."""
    texture: float = 0.06
    """Largest standard deviation of the ratio among neighbours: the ground's texture is visible through a shadow."""
    deepest: float = 0.75
    """Least ratio as a fraction of that of the recording's shadows, if it is known: at the feet the sky is hidden too."""
    faintest: float = 0.35
    """Largest ratio, if that of the recording's shadows is known: this part of the way to 1. Thin shadows are blurred."""


UNIT = 128
"""Ratio 1 in the 8-bit pictures of ratios."""
RIM = 7
"""Pixels: a shadow is grown by half of this, over its penumbra, where the ratio is not smooth."""
FAINT = 0.8
"""Shadows with a larger ratio have no common tone: they are contact shadows, or change with the clouds."""
LEAST_PIXELS = 2000
"""Least number of shadow pixels from which the tone is computed."""
LEAST_SHARE = 0.5
"""Least share of those pixels that agree on the tone: under an overcast sky there is no tone, because shadows fade out."""


def find_shadows(
    picture: Picture, usual: Picture, mask: Levels, certain: Levels, options: ShadowOptions, tone: Floats | None
) -> Shadows:
    """Find the pixels of `mask` that look like their background `usual` in less light.

    Where the difference is not `certain`, a darker grey is sufficient: at the border of a shadow the ratio is not smooth.

    Args:
        picture: (H, W, 3).
        usual: (H, W, 3) the background in the same light.
        mask: (H, W) 255 for foreground.
        certain: (H, W) 255 where the difference is large.
        options: what counts as a shadow.
        tone: (3,) the ratio in this recording's shadows, by channel: clothes that are grey like the ground have another. None
            where it is not known.
    """
    ratio = cast(Levels, cv2.divide(picture, np.maximum(usual, 1), scale=UNIT))
    blue, green, red = cv2.split(ratio)
    least, most = cv2.min(cv2.min(blue, green), red), cv2.max(cv2.max(blue, green), red)
    darker = cast(Levels, cv2.inRange(most, options.darkest * UNIT, options.lightest * UNIT))
    grey = cast(Levels, cv2.threshold(cv2.subtract(most, least), options.chroma * UNIT, 255, cv2.THRESH_BINARY_INV)[1])
    plausible = darker & grey & mask
    if not plausible.any():
        return Shadows(plausible, plausible, ratio)
    if tone is None:
        plain = green.astype(np.float32)
        mean = cv2.blur(plain, (5, 5))
        variance = cv2.blur(plain * plain, (5, 5)) - mean * mean
        core = plausible & np.where(variance < (options.texture * UNIT) ** 2, np.uint8(255), np.uint8(0))
    else:
        low, high = options.deepest * tone * UNIT, (tone + options.faintest * (1.0 - tone)) * UNIT
        core = plausible & cast(Levels, cv2.inRange(ratio, low, high))
    # Seen at a grazing angle, a shadow is only a few rows high.
    core = cast(Levels, cv2.morphologyEx(core, cv2.MORPH_OPEN, np.ones((2, 4), np.uint8)))
    grown = cast(Levels, cv2.dilate(core, np.ones((RIM, RIM), np.uint8))) & plausible
    return Shadows(grown | (plausible & ~certain), core, ratio)


def shadow_tone(ratios: Sequence[Levels]) -> Floats | None:
    """Return the ratio, by channel (3,), of most of the shadows' pixels (n, 3), 128 for 1; None where they do not agree."""
    pixels = np.concatenate([np.zeros((0, 3), np.uint8), *ratios]).astype(np.float64) / UNIT
    pixels = pixels[pixels[:, 1] < 0.9]
    if len(pixels) < LEAST_PIXELS:
        return None
    count, edges = np.histogram(pixels[:, 1], bins=50, range=(0.0, 1.0))
    peak = edges[np.argmax(np.convolve(count, np.ones(5), mode="same"))] + 0.01
    near = np.abs(pixels[:, 1] - peak) < 0.07
    if near.mean() < LEAST_SHARE or peak > FAINT:
        return None
    return np.asarray(np.median(pixels[near], axis=0))


def recover_foreground(body: Levels, shadow: Levels) -> Levels:
    """Return the body (H, W; 255) with the foreground between two of its parts in a column added: legs as grey as a shadow.

    A shadow has a part of a body above it, if any, or beside it; legs have one above, and shoes below.
    """
    foreground = body | shadow
    rows = np.flatnonzero(shadow.any(axis=1))
    if len(rows) == 0:
        return body
    start, end = max(int(rows[0]) - 1, 0), min(int(rows[-1]) + 2, len(body))
    below_one, above_one = body[start:end].copy(), body[start:end].copy()
    allowed = foreground[start:end]
    for row in range(1, end - start):
        below_one[row] |= below_one[row - 1] & allowed[row]
        above_one[-1 - row] |= above_one[-row] & allowed[-1 - row]
    filled = body.copy()
    filled[start:end] |= below_one & above_one
    return filled


def remove_slivers(body: Levels, shadow: Levels) -> Levels:
    """Return the body (H, W; 255) without rests of shadow borders: less than three pixels thick, and beside a shadow."""
    square = np.ones((3, 3), np.uint8)
    thin = body & ~cast(Levels, cv2.morphologyEx(body, cv2.MORPH_OPEN, square))
    return body & ~(thin & cast(Levels, cv2.dilate(shadow, np.ones((RIM, RIM), np.uint8))))
