"""Stretches of a recording, and their order by usefulness: a rig needs some hundred well-spread people, not every frame.

A quick look decodes key frames all over the recordings and finds the people in them. The value of a stretch is what its people
would add: people that two cameras see at the same time, at places where few people were seen so far.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.perception.pictures import Frame
from passerby.perception.video_probe import Piece, VideoInfo
from passerby.perception.video_still import key_picture

STRETCH_S = 30.0
"""Approximate length of a stretch, seconds."""
MOST_LOOKS = 60
"""Number of key frames of a quick look, evenly spread: its time does not depend on the length of the recording."""
WINDOW_S = 300.0
"""Approximate time for which an empty scene is valid, seconds."""
CELLS = 8, 6
"""Columns and rows of a camera's image in which people's feet are counted."""
INSIDE_S = 1e-6
"""A frame at the border of two stretches belongs to the later one."""


@dataclass(frozen=True)
class Stretch:
    """A part of a recording: seconds of the recording's clock, the end excluded."""

    begin_s: float
    end_s: float

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.end_s - self.begin_s


def cut_into_stretches(begin_s: float, end_s: float) -> tuple[Stretch, ...]:
    """Return stretches of equal length, about `STRETCH_S`, from `begin_s` to `end_s`."""
    count = max(1, round((end_s - begin_s) / STRETCH_S))
    edges = np.linspace(begin_s, end_s, count + 1).tolist()
    return tuple(Stretch(*ends) for ends in pairwise(edges))


def is_divisible(info: VideoInfo) -> bool:
    """Check whether parts of a video can be read separately: its length is known, and its times are those that it states."""
    timed = any(piece.info is not None and piece.info.frame_times for piece in info.pieces) or bool(info.frame_times)
    return info.seconds is not None and info.seconds > 0 and not timed


def part_of_video(info: VideoInfo, stretch: Stretch) -> VideoInfo:
    """Return a stretch of a video, as a recording in pieces that uses only this part; frames keep their numbers."""
    pieces = info.pieces or (Piece(info.path, 0.0, info, info.seconds or math.inf),)
    first, last = max(info.used[0], stretch.begin_s), min(info.used[1], stretch.end_s - INSIDE_S)
    inside = tuple(piece for piece in pieces if piece.begin_s <= last and piece.begin_s + piece.seconds > first)
    share = max(0.0, last - first) / (info.seconds or math.inf)
    frames = None if info.frames is None else math.ceil(info.frames * min(1.0, share))
    return replace(info, pieces=inside, used=(first, last), seconds=max(0.0, last - first), frames=frames)


def find_window(whole: Stretch, part: Stretch) -> Stretch:
    """Return the part of a recording from which the empty scene of a stretch is learnt: light changes in minutes."""
    count = max(1, round(whole.seconds / WINDOW_S))
    length = whole.seconds / count
    number = min(count - 1, max(0, int((0.5 * (part.begin_s + part.end_s) - whole.begin_s) / length)))
    return Stretch(whole.begin_s + number * length, whole.begin_s + (number + 1) * length)


def spread_evenly(stretch: Stretch, count: int) -> Floats:
    """Return the times (count,) in the middles of this number of equal parts of a stretch."""
    return np.asarray(stretch.begin_s + stretch.seconds * (np.arange(count) + 0.5) / count)


def key_frames(info: VideoInfo, seconds: Iterable[float]) -> Iterator[Frame]:
    """Read the key frames at or before some times, ascending, each once; no other frame is decoded."""
    pieces = info.pieces or (Piece(info.path, 0.0, info, info.seconds or math.inf),)
    wanted = np.sort(np.asarray(list(seconds), dtype=np.float64))
    last = 0
    for piece in pieces:
        own = wanted[(wanted >= piece.begin_s) & (wanted < piece.begin_s + piece.seconds)] - piece.begin_s
        if piece.info is None or not len(own):
            continue
        for second in own.tolist():
            found = key_picture(piece.path, second, piece.info.rotation)
            if found is None:
                continue
            shown_s = piece.begin_s + found[0]
            number = round(shown_s * info.clock_fps) + 1
            if number > last:
                last = number
                yield Frame(number, shown_s, found[1])


@dataclass(frozen=True, eq=False)
class Overview:
    """The people that a quick look found in one camera's recording."""

    seconds: Floats
    """(L,) times of the looks, by the scene's clock."""
    count: Ints
    """(L,) number of people in each look."""
    feet: Floats
    """(N, 2) positions of their feet, in parts of the image's width and height, look after look."""


def rank_stretches(stretches: Sequence[Stretch], overviews: Mapping[str, Overview]) -> list[int]:
    """Return the indices of the stretches, the most useful one first; those without a look come last, in order of time.

    The choice is greedy. The value of a stretch is the increase of the sum over cameras and cells of the image of ln(1 + n),
    where n is the number of people seen there in the stretches before it. Only people that at least one other camera may see
    count: in each camera at most as many as the second largest number of people in any camera's looks of that stretch.

    Args:
        stretches: parts of the scene's time.
        overviews: by camera.
    """
    begins = np.array([one.begin_s for one in stretches])
    seen = np.zeros((len(stretches), len(overviews), CELLS[0] * CELLS[1]))
    looks = np.zeros((len(stretches), len(overviews)))
    for c, one in enumerate(overviews.values()):
        of = np.clip(np.searchsorted(begins, one.seconds, side="right") - 1, 0, len(stretches) - 1)
        np.add.at(looks[:, c], of, 1.0)
        column, row = (np.clip((one.feet[:, k] * CELLS[k]).astype(np.int64), 0, CELLS[k] - 1) for k in (0, 1))
        np.add.at(seen[:, c], (np.repeat(of, one.count), row * CELLS[0] + column), 1.0)
    seen /= np.maximum(looks, 1.0)[:, :, None]
    people = seen.sum(axis=2)
    shared = np.sort(people, axis=1)[:, -2] if people.shape[1] > 1 else people[:, 0]
    seen *= np.minimum(1.0, shared[:, None] / np.maximum(people, 1e-9))[:, :, None]
    left, chosen, so_far = list(range(len(stretches))), list[int](), np.zeros(seen.shape[1:])
    while left:
        gains = [float(np.log1p(seen[k] / (1.0 + so_far)).sum()) for k in left]
        best = left[int(np.argmax(np.round(gains, 9)))]
        left.remove(best)
        chosen.append(best)
        so_far += seen[best]
    return chosen
