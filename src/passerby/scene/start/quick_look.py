"""How many people a long recording shows when, by a few of its key frames: a span to begin with, no count to rely on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError, InputError
from passerby.perception.background import BackgroundDetector, BackgroundOptions, Sampling, learn_background
from passerby.perception.pictures import Frame
from passerby.perception.video_still import key_picture

MOST_CAMERAS, MOST_MOMENTS = 3, 96
"""That are looked at: a key frame of 1920 x 1080 takes some 50 ms, a day of three cameras a quarter of a minute."""
LEAST_STEP_S = 60.0
"""Between two moments."""
WINDOW = 8
"""Moments that share an empty scene: the light changes over a day, and fewer pictures cannot outvote passers-by."""


@dataclass(frozen=True, eq=False)
class Look:
    """People seen at moments of a recording."""

    seconds: Floats
    """(N,) since 1970, ascending: of the pictures that could be read, of all cameras."""
    people: Floats
    """(N,) counted in each."""

    def mean_in(self, first: float, last: float) -> float:
        """People in a picture on the average, of those within a span; 0 without any."""
        inside = (self.seconds >= first) & (self.seconds <= last)
        return float(self.people[inside].mean()) if inside.any() else 0.0


def look_at(cameras: Sequence[tuple[Sequence[Path], Sequence[float]]], first: float, last: float) -> Look:
    """Count people in key frames all over a span.

    Args:
        cameras: the files of each, and when they begin, seconds since 1970, ascending. The first `MOST_CAMERAS` are looked at.
        first: beginning of the span, seconds since 1970.
        last: its end.
    """
    step = max((last - first) / MOST_MOMENTS, LEAST_STEP_S)
    moments = np.arange(first + step / 2, last, step)
    seconds: list[float] = []
    people: list[float] = []
    for paths, begins in cameras[:MOST_CAMERAS]:
        frames = _key_frames(paths, np.asarray(begins), moments, first)
        try:
            sampling = Sampling(step / 2, WINDOW * step)
            model = learn_background(frames, sampling, BackgroundOptions(window_s=WINDOW * step, windows=MOST_MOMENTS))
            detector = BackgroundDetector(model)
            people += [float(len(detector(frame).score)) for frame in frames]
        except (EvidenceError, InputError):
            continue
        seconds += [first + frame.seconds for frame in frames]
    order = np.argsort(seconds, kind="stable")
    return Look(np.array(seconds)[order], np.array(people)[order])


def _key_frames(paths: Sequence[Path], begins: Floats, moments: Floats, zero: float) -> list[Frame]:
    """A key frame of each moment: of the last file that begins before it, if it can be read and has not been taken yet."""
    frames: list[Frame] = []
    taken: set[tuple[int, float]] = set()
    for moment in moments.tolist():
        number = int(np.searchsorted(begins, moment, side="right")) - 1
        if number < 0:
            continue
        try:
            found = key_picture(paths[number], moment - float(begins[number]))
        except InputError:
            continue
        if found is None or (number, found[0]) in taken:
            continue
        taken.add((number, found[0]))
        picture = found[1]
        if not frames or picture.shape == frames[0].picture.shape:
            frames.append(Frame(len(frames) + 1, moment - zero, picture))
    return frames
