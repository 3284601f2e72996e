"""Preparation of the stages that a plan names. Networks are opened in the process that uses them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import islice
from typing import Any, Literal

import cv2
import numpy as np

from passerby.common.arrays import Ints
from passerby.common.errors import EvidenceError
from passerby.core.observations import Boxes, Keypoints, Vectors
from passerby.perception.background import (
    VERSION,
    BackgroundDetector,
    BackgroundModel,
    BackgroundOptions,
    Sampling,
    learn_background,
    plan_sampling,
)
from passerby.perception.kept import StageCache, hash_of_arrays
from passerby.perception.networks import Network
from passerby.perception.pictures import Detections, Detector, Embedder, Frame, KeypointEstimator, VideoError
from passerby.perception.plan import Plan
from passerby.perception.stretches import Stretch, key_frames, spread_evenly
from passerby.perception.video import TURNS, VideoInfo, VideoReader, expected_count
from passerby.perception.yolox import YoloxDetector, YoloxOptions

UNKNOWN_LENGTH_S = 3600.0
"""Length assumed for a video that does not state it: a background for every five minutes of an hour."""
KEY_EVERY_S, FEWEST_KEYS = 2.0, 50
"""The empty scene is learnt from key frames alone where its pictures are at least this far apart, and where at least this
number of them is found: frames between them need not be decoded."""
PICTURES, EVERY_S = 12, 2.0
"""Number of pictures that are searched for people, and the time between two of them if the video is long enough."""
FEW = 0.5
"""Mean number of people found in a picture below which other turns of the video are tried."""
CERTAIN = 0.5
"""Score of a person who counts: turned images have more weak false detections."""
LEAST, TIMES = 6, 3
"""A turn is chosen if it gives at least this number of people, and this multiple of the people without a turn."""


def open_detector(network: Network, plan: Plan) -> Detector:
    """Open a network that finds people. Raises `InputError` where it does not."""
    return YoloxDetector(network, YoloxOptions(score=plan.min_score, tiles=plan.tiles))


def open_embedder(choice: Network | Literal["stripes"]) -> Embedder:
    """Open the embedder of people's appearance. Raises `InputError` where the network is no embedder."""
    if isinstance(choice, Network):
        from passerby.perception.reid import ReidEmbedder

        return ReidEmbedder(choice)
    from passerby.perception.reid import StripesEmbedder

    return StripesEmbedder()


def open_estimator(network: Network) -> KeypointEstimator:
    """Open a network that finds joints. Raises `InputError` where it does not."""
    from passerby.perception.keypoints import open_keypoints

    return open_keypoints(network)


def background_identity() -> dict[str, Any]:
    """Return the settings that determine how an empty scene is learnt, without the video."""
    return {"background": VERSION, **asdict(BackgroundOptions())}


def background_count(info: VideoInfo) -> int | None:
    """Return about how many pictures an empty scene is learnt from; None where the file does not state its length."""
    return expected_count(info, 1.0 / plan_sampling(info.seconds or UNKNOWN_LENGTH_S).interval_s)


def open_background(kept: StageCache, info: VideoInfo, tell: Callable[[int], None], *, is_part: bool = False) -> Detector:
    """Open background subtraction with the kept empty scene, or learn the empty scene now and keep it.

    `tell` is called after each picture that is used for learning, with their number.

    Raises `InputError` for a video that is too short to separate the scene from the people, or that cannot be decoded.
    """
    arrays = kept.load(0)
    if arrays is None:
        try:
            model = _learn_part(info, tell) if is_part else _learn_whole(info, tell)
        except EvidenceError as error:
            raise VideoError(info.path, str(error)) from None
        kept.save(0, model.to_arrays())
        kept.finish({})
    else:
        model = BackgroundModel.from_arrays(arrays)
    return BackgroundDetector(model)


def _learn_whole(info: VideoInfo, tell: Callable[[int], None]) -> BackgroundModel:
    """Learn the empty scene of a video. Raises `EvidenceError` and `InputError` as `learn_background` does."""
    sampling = plan_sampling(info.seconds or UNKNOWN_LENGTH_S)
    return learn_background(count_frames(VideoReader(info, rate=1.0 / sampling.interval_s), tell), sampling)


def _learn_part(info: VideoInfo, tell: Callable[[int], None]) -> BackgroundModel:
    """Learn the empty scene of some minutes of a long video, as one; from key frames where these are sufficient."""
    interval_s = plan_sampling(info.seconds or UNKNOWN_LENGTH_S).interval_s
    sampling = Sampling(interval_s, math.inf)
    if info.seconds is not None and interval_s >= KEY_EVERY_S:
        counted: list[int] = []
        times = spread_evenly(Stretch(info.begin_s, info.begin_s + info.seconds), round(info.seconds / interval_s))
        with suppress(EvidenceError):
            model = learn_background(count_frames(key_frames(info, times), counted.append), sampling)
            if len(counted) >= FEWEST_KEYS:
                tell(len(times))
                return model
    return learn_background(count_frames(VideoReader(info, rate=1.0 / interval_s), tell), sampling)


def count_frames(frames: Iterable[Frame], tell: Callable[[int], None]) -> Iterator[Frame]:
    """Yield the frames; `tell` is called with the number of those taken."""
    for number, frame in enumerate(frames, start=1):
        yield frame
        tell(number)


class GivenBoxes:
    """Boxes from a file, used in place of a detector."""

    def __init__(self, boxes: Boxes) -> None:
        self._boxes = boxes
        self._order = np.argsort(boxes.frame, kind="stable")
        self._frames = boxes.frame[self._order]

    @property
    def identity(self) -> dict[str, Any]:
        """Digest of the boxes' content."""
        return {"detector": "given", "boxes": hash_of_arrays(self._boxes.frame, self._boxes.ltwh)}

    def __call__(self, frame: Frame) -> Detections:
        """Return the boxes of a frame, in the order of the file."""
        rows = self._rows(frame.number)
        return Detections(self._boxes.ltwh[rows], self._boxes.score[rows])

    def named(self, frame: Ints, appearance: Vectors | None, keypoints: Keypoints) -> tuple[Boxes, Keypoints]:
        """Return all boxes in the order of the file, with the embeddings of the processed ones, and the joints with identities.

        `frame` are the frame numbers of the processed rows, in the order of the pictures.
        """
        rows = np.concatenate([self._rows(number) for number in np.unique(frame).tolist()] or [np.zeros(0, np.int64)])
        boxes = self._boxes
        if appearance is not None:
            vectors = no_embeddings(len(boxes), appearance.shape[1])
            vectors[rows] = appearance
            boxes = replace(boxes, embedding=vectors)
        return boxes, replace(keypoints, identity=boxes.identity[rows]) if len(keypoints) else keypoints

    def _rows(self, number: int) -> Ints:
        low, high = np.searchsorted(self._frames, (number, number + 1))
        return np.asarray(self._order[low:high])


def no_embeddings(rows: int, dimensions: int) -> Vectors:
    """Return embeddings (rows, dimensions) of boxes that were not processed: zeros."""
    return np.zeros((rows, dimensions), dtype=np.float32)


def turn_that_shows_people(info: VideoInfo, detector: Detector) -> int:
    """Return the degrees clockwise by which a video has to be turned so that people in it are found; 0 where no turn helps.

    Args:
        info: the video.
        detector: the detector for the video without a turn.

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
