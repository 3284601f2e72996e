"""Videos of cameras on their side: people in them are found once the images are turned."""

from __future__ import annotations

from itertools import islice

import cv2
import numpy as np

from passerby.perception.background import BackgroundDetector
from passerby.perception.pictures import Detector, Frame
from passerby.perception.video import TURNS, VideoInfo, VideoReader

PICTURES, EVERY_S = 12, 2.0
"""Pictures that are looked at, and the time between two of them where the video is long enough."""
FEW = 0.5
"""People found in a picture on average, below which the video is looked at again."""
CERTAIN = 0.5
"""Score of a person who counts: turned images have more weak false detections."""
LEAST, TIMES = 6, 3
"""So many people in the turned pictures, and so many times those in the pictures as they are."""


def turn_that_shows_people(info: VideoInfo, detector: Detector) -> int:
    """Degrees clockwise by which a video has to be turned so that people in it are found; 0 where no turn helps.

    Args:
        info: the video.
        detector: of the video as it is.

    Raises:
        InputError: as `VideoReader`.
    """
    every_s = EVERY_S if info.seconds is None else min(EVERY_S, info.seconds / PICTURES)
    detectors = {
        turn: detector.turned(turn) if isinstance(detector, BackgroundDetector) else detector for turn in (0, 90, 180, 270)
    }
    counts = dict.fromkeys(detectors, 0)
    for frame in islice(VideoReader(info, rate=1.0 / max(every_s, 1.0 / info.clock_fps)), PICTURES):
        for turn in counts:
            picture = frame.picture if turn == 0 else cv2.rotate(frame.picture, TURNS[360 - turn])
            people = detectors[turn](Frame(frame.number, frame.seconds, np.asarray(picture, dtype=np.uint8)))
            counts[turn] += int((people.score >= CERTAIN).sum())
    best = max((90, 270, 180), key=lambda turn: counts[turn])
    return best if counts[best] >= max(LEAST, TIMES * counts[0]) else 0
