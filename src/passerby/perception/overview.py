"""A quick look at one camera's recording: the people in key frames all over it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError
from passerby.perception.background import BackgroundDetector, BackgroundOptions, Sampling, learn_background
from passerby.perception.kept import StageCache, cache_lock
from passerby.perception.opening import background_identity, count_frames, open_detector
from passerby.perception.pictures import Detector, Frame
from passerby.perception.stretches import MOST_LOOKS, Overview, Stretch, key_frames, spread_evenly
from passerby.perception.watching import CameraJob, Tell, identify_video

VERSION = 1
"""Version of the results of a quick look."""
WINDOW = 8
"""Number of looks that share an empty scene: light changes over a day, and with fewer frames people who pass stay in it."""


def look_over(job: CameraJob, tell: Tell) -> Overview:
    """Find people in key frames all over a camera's video, or load the kept results. Times are the video's own.

    Raises `InputError` where the video cannot be read or the shelf cannot be written.
    """
    info = job.info
    times = spread_evenly(Stretch(info.begin_s, info.begin_s + (info.seconds or 0.0)), MOST_LOOKS)
    detector = None if job.plan.detector is None else open_detector(job.plan.detector, job.plan)
    finds = background_identity() if detector is None else dict(detector.identity)
    looks = {"overview": VERSION, "looks": len(times), "detector": finds}
    with cache_lock(job.shelf):
        kept = StageCache.of(job.shelf, "overview", identify_video(job, info) | looks)
        arrays = kept.load(0)
        if arrays is None:
            if detector is None:
                counted = count_frames(key_frames(info, times), lambda done: tell(done, 2 * len(times)))
                detector = learn_from_looks(counted, (info.seconds or 0.0) / len(times))
            rows = list(_look(key_frames(info, times), detector, lambda done: tell(len(times) + done, 2 * len(times))))
            arrays = {
                "seconds": np.array([second for second, _ in rows], dtype=np.float64),
                "count": np.array([len(feet) for _, feet in rows], dtype=np.int64),
                "feet": np.concatenate([feet for _, feet in rows] or [np.zeros((0, 2))]),
            }
            kept.save(0, arrays)
    return Overview(arrays["seconds"], arrays["count"], arrays["feet"])


def learn_from_looks(frames: Iterable[Frame], step_s: float) -> Detector | None:
    """Return background subtraction from the key frames of a quick look, `step_s` apart; None with too few of them."""
    options = BackgroundOptions(window_s=WINDOW * step_s, windows=MOST_LOOKS)
    try:
        return BackgroundDetector(learn_background(frames, Sampling(step_s / 2, WINDOW * step_s), options))
    except EvidenceError:
        return None


def _look(frames: Iterable[Frame], detector: Detector | None, tell: Callable[[int], None]) -> Iterator[tuple[float, Floats]]:
    """Yield the time of each frame and the feet (N, 2) of its people, as shares of the image's width and height."""
    for frame in count_frames(frames, tell):
        ltwh = np.zeros((0, 4)) if detector is None else detector(frame).ltwh
        height, width = frame.picture.shape[:2]
        yield frame.seconds, (ltwh[:, :2] + ltwh[:, 2:] * (0.5, 1.0)) / (width, height)
