"""The stages that a plan names, ready to work. Networks are opened in the process that uses them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from typing import Any, Literal

from passerby.common.errors import EvidenceError
from passerby.perception.background import (
    VERSION,
    BackgroundDetector,
    BackgroundModel,
    BackgroundOptions,
    learn_background,
    plan_sampling,
)
from passerby.perception.kept import StageCache
from passerby.perception.networks import Network
from passerby.perception.pictures import Detector, Embedder, Frame, KeypointEstimator
from passerby.perception.plan import Plan
from passerby.perception.video import VideoInfo, VideoReader, expected_count
from passerby.perception.video_error import VideoError
from passerby.perception.yolox import YoloxDetector, YoloxOptions

UNKNOWN_LENGTH_S = 3600.0
"""Taken for the length of a video that does not tell it: a background for every five minutes of an hour."""


def open_detector(network: Network, plan: Plan) -> Detector:
    """A network that finds people. Raises `InputError` where it is none."""
    return YoloxDetector(network, YoloxOptions(score=plan.min_score, tiles=plan.tiles))


def open_embedder(choice: Network | Literal["stripes"]) -> Embedder:
    """What describes how people look. Raises `InputError` where the network is no embedder."""
    if isinstance(choice, Network):
        from passerby.perception.reid import ReidEmbedder

        return ReidEmbedder(choice)
    from passerby.perception.stripes import StripesEmbedder

    return StripesEmbedder()


def open_estimator(network: Network) -> KeypointEstimator:
    """A network that finds joints. Raises `InputError` where it is none."""
    from passerby.perception.keypoints import open_keypoints

    return open_keypoints(network)


def background_identity() -> dict[str, Any]:
    """What decides an empty scene as it is learnt, the video aside."""
    return {"background": VERSION, **asdict(BackgroundOptions())}


def background_count(info: VideoInfo) -> int | None:
    """About how many pictures an empty scene is learnt from; None where the file does not tell its length."""
    return expected_count(info, 1.0 / plan_sampling(info.seconds or UNKNOWN_LENGTH_S).interval_s)


def open_background(kept: StageCache, info: VideoInfo, tell: Callable[[int], None]) -> Detector:
    """Background subtraction, with the empty scene that is kept, or that is learnt now and kept.

    `tell` is called with how many pictures were taken to learn from, after each.

    Raises `InputError` for a video that is too short to tell the scene from the people, or that cannot be decoded.
    """
    arrays = kept.load(0)
    if arrays is None:
        sampling = plan_sampling(info.seconds or UNKNOWN_LENGTH_S)
        try:
            model = learn_background(_counted(VideoReader(info, rate=1.0 / sampling.interval_s), tell), sampling)
        except EvidenceError as error:
            raise VideoError(info.path, str(error)) from None
        kept.save(0, model.to_arrays())
        kept.finish({})
    else:
        model = BackgroundModel.from_arrays(arrays)
    return BackgroundDetector(model)


def _counted(frames: Iterable[Frame], tell: Callable[[int], None]) -> Iterator[Frame]:
    """The frames; `tell` is called with how many have been taken."""
    for number, frame in enumerate(frames, start=1):
        yield frame
        tell(number)
