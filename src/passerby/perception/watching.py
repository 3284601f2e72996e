"""Processing of one camera's video from its beginning to its end: people, their appearance, their joints, and camera motion.

Every stage's results are kept in segments. Kept results are not computed again, and a stage that has to be computed takes its
input from the kept results of others.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import onnxruntime

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes, Keypoints
from passerby.perception.kept import SUMMARY, Arrays, StageCache, VideoFilesState, cache_lock, forget_others, video_identity
from passerby.perception.opening import (
    FEW,
    GivenBoxes,
    background_count,
    background_identity,
    no_embeddings,
    open_background,
    open_detector,
    open_embedder,
    open_estimator,
    turn_that_shows_people,
)
from passerby.perception.pictures import Detector, Embedder, Frame, KeypointEstimator, Picture, VideoError
from passerby.perception.places import text_of_view, view_of_text
from passerby.perception.plan import JointBudget, Plan
from passerby.perception.steadiness import SteadinessWatcher
from passerby.perception.video import VideoInfo, VideoReader, expected_count
from passerby.perception.video_observations import VideoObservations

REVISION = 1
"""Increased when a stage gives results that differ from before, so that results of an older version are not used."""
SEGMENT = 64
"""Number of pictures whose results are kept at once: a run that is killed loses no more."""
LOOKS_EVERY_S = 0.4
"""Time between two pictures with embeddings: the appearance of people changes slowly, and networks are slow."""
STEADY_EVERY_S = 1.5
"""Time between two pictures that are compared to detect camera motion."""
PLACE = "place"
"""Key in the summary of a stretch: the view of the camera from its place."""

LEARNT_WORTH = 3
"""Learning the empty scene from a picture takes about three times as long as searching it for people (3.8 and 2.8 in videos of
768 x 576 and 360 x 288). It counts as three, so that the pace of learning predicts that of searching."""

Tell = Callable[[int, int], None]
"""Called with the work done and the total, in pictures that are searched for people; the total is 0 where it is unknown."""


@dataclass(frozen=True, eq=False)
class CameraJob:
    """The work to be done for one camera."""

    name: str
    info: VideoInfo
    rate: float
    """Number of pictures per second of the video's own clock that are searched for people."""
    plan: Plan
    shelf: Path
    """Folder of this camera's kept results."""
    boxes: Boxes | None = None
    """The people, where they are known; None: they have to be found."""
    rotate: int = 0
    """Degrees clockwise by which the scene turns the video's pictures; `info` contains this turn."""
    surroundings: VideoInfo | None = None
    """The part of the recording from which the empty scene is learnt, if `info` is a stretch of it; None: `info` itself."""
    common_shelf: Path | None = None
    """Folder of the empty scene, if other stretches use it too; None: `shelf`."""
    share: float = 1.0
    """Share of the camera's recording that `info` covers."""


def work_of(job: CameraJob) -> int:
    """Return the amount of work, in pictures that are searched for people; 0 where the video does not state its length."""
    pictures = expected_count(job.info, job.rate)
    return _learning(job) + pictures if pictures else 0


def _learning(job: CameraJob) -> int:
    """Return the part of it for learning the empty scene."""
    if job.boxes is not None or job.plan.detector is not None:
        return 0
    return LEARNT_WORTH * (background_count(job.surroundings or job.info) or 0)


@dataclass(eq=False)
class _Stage:
    """A stage during processing: its results of the current segment, computed or kept."""

    kept: StageCache
    part: Arrays | None = None
    rows: list[Arrays] = field(default_factory=list)

    def begin(self, segment: int) -> None:
        """Load the kept results of the segment, if there are any."""
        self.part, self.rows = self.kept.load(segment), []

    def end(self, segment: int) -> None:
        """Keep the results that were computed for the segment."""
        if self.part is None and self.rows:
            self.part = {name: np.concatenate([row[name] for row in self.rows]) for name in self.rows[0]}
            self.kept.save(segment, self.part)


def watch_camera(job: CameraJob, tell: Tell) -> VideoObservations:
    """Process a camera's video, or take the results of an earlier run from the shelf.

    Raises `InputError` where the video cannot be decoded, a network does not fit its role, or the shelf cannot be written.
    """
    threads = cv2.getNumThreads()
    # Cameras are processed side by side: more threads would wait for each other.
    cv2.setNumThreads(1)
    try:
        with cache_lock(job.shelf):
            return _Watch(job, tell).result()
    finally:
        cv2.setNumThreads(threads)


def find_kept_results(job: CameraJob, tell: Tell) -> VideoObservations | None:
    """Return what `watch_camera` would take from the shelf; None where a result is missing. Raises `InputError` likewise."""
    if not any(job.shelf.glob(f"people-*/{SUMMARY}")):
        return None  # no network is opened without need
    with cache_lock(job.shelf):
        background = _background(job)
        if job.boxes is None and job.plan.detector is None and background.summary() is None:
            return None
        return _Watch(job, tell).kept()


def identify_video(job: CameraJob, info: VideoInfo) -> dict[str, Any]:
    """Return the settings that determine the results of all stages that read pictures from a video."""
    video = {"video": video_identity(info), "rate": job.rate, "segment": SEGMENT, "revision": REVISION}
    turned = {"rotate": job.rotate} if job.rotate else {}
    return video | turned | {"versions": _versions()}


def _background(job: CameraJob) -> StageCache:
    """Return the cache of the empty scene of background subtraction."""
    video = identify_video(job, job.surroundings or job.info)
    return StageCache.of(job.common_shelf or job.shelf, "background", video | background_identity())


class _Watch:
    """One pass through a camera's video."""

    def __init__(self, job: CameraJob, tell: Tell) -> None:
        self._job, self._tell = job, tell
        self._learning, self._work = _learning(job), work_of(job)
        self.seconds: dict[str, float] = {}
        self._found = 0
        self._used: set[Path] = set()
        self._files, self._at_s = VideoFilesState(job.info), -math.inf
        video = identify_video(job, job.info)
        self._detector = self._open_detector()
        self._embedder: Embedder | None = None if job.plan.embedder is None else open_embedder(job.plan.embedder)
        self._estimator: KeypointEstimator | None = None if job.plan.keypoints is None else open_estimator(job.plan.keypoints)
        self._looks_every = max(1, round(LOOKS_EVERY_S * job.rate))
        self._budget = _budget_of(job)
        self._people = self._stage("people", video | {"detector": dict(self._detector.identity)})
        people = {"people": self._people.kept.key}
        self._looks = self._joints = None
        if self._embedder is not None:
            self._looks = self._stage("looks", people | {"embedder": dict(self._embedder.identity), "every": self._looks_every})
        if self._estimator is not None:
            chosen = {} if self._budget is None else {"chosen": self._budget.identity}
            self._joints = self._stage("joints", people | {"estimator": dict(self._estimator.identity)} | chosen)

    @property
    def _stages(self) -> list[_Stage]:
        return [stage for stage in (self._people, self._looks, self._joints) if stage is not None]

    def _stage(self, name: str, identity: dict[str, Any]) -> _Stage:
        stage = _Stage(StageCache.of(self._job.shelf, name, identity))
        self._used.add(stage.kept.folder)
        return stage

    def _open_detector(self) -> Detector:
        """Open the detector; for background subtraction the empty scene is learnt first."""
        if self._job.boxes is not None:
            return GivenBoxes(self._job.boxes)
        if self._job.plan.detector is not None:
            return open_detector(self._job.plan.detector, self._job.plan)
        kept = _background(self._job)
        self._used.add(kept.folder)
        shared = nullcontext() if self._job.common_shelf is None else cache_lock(self._job.common_shelf)
        with self._time_stage("background"), shared:
            part = self._job.surroundings
            return open_background(kept, part or self._job.info, self._tell_learnt, is_part=part is not None)

    def result(self) -> VideoObservations:
        """Compute the results that are not kept, and collect all of them."""
        if (found := self.kept()) is not None:
            return found
        used = {path.name for path in self._used}
        other = any(path.parent.name not in used for path in self._job.shelf.glob(f"people-*/{SUMMARY}"))
        summary = self._watch()
        parts = self._parts(summary["pictures"])
        if parts is None:
            raise InputError(f"{self._job.shelf}: what was just written there cannot be read again: choose another folder")
        return replace(self._finish(summary, parts), made_again=other)

    def kept(self) -> VideoObservations | None:
        """Return all results if all are kept, else None."""
        summaries = [stage.kept.summary() for stage in self._stages]
        summary = summaries[0]
        parts = None if summary is None or None in summaries else self._parts(summary["pictures"])
        return None if summary is None or parts is None else self._finish(summary, parts)

    def _finish(self, summary: dict[str, Any], parts: list[Arrays]) -> VideoObservations:
        """Delete results that are not of this run, and collect the others."""
        forget_others(self._job.shelf, self._used)
        done = max(self._learning + summary["pictures"], self._work)
        self._tell(done, done)
        return self._gather(summary, parts)

    def _tell_learnt(self, pictures: int) -> None:
        """Report the progress while the empty scene is learnt."""
        self._tell(min(LEARNT_WORTH * pictures, self._learning), self._work)

    def _tell_looked_at(self, pictures: int) -> None:
        """Report the progress while people are searched for."""
        done = self._learning + pictures
        self._tell(done, max(self._work, done) if self._work else 0)

    def _watch(self) -> dict[str, Any]:
        """Process the video; keep the results of all stages, and return the summary."""
        job = self._job
        reader, watcher = VideoReader(job.info, job.rate), SteadinessWatcher(job.info.size)
        steady_every = max(1, round(STEADY_EVERY_S * job.rate))
        index = -1
        with self._time_stage("watching"):
            for index, frame in enumerate(reader):
                place = index % SEGMENT
                if place == 0:
                    self._turn(index // SEGMENT)
                self._at_s = frame.seconds
                self._look(index, place, frame)
                if index % steady_every == 0:
                    with self._time_stage("steadiness"):
                        watcher.look(frame)
                self._tell_looked_at(index + 1)
        self._at_s = math.inf
        self._turn((index + SEGMENT) // SEGMENT)
        summary = _summary(index + 1, reader, watcher)
        if job.surroundings is not None and watcher.view is not None:
            summary |= {PLACE: text_of_view(watcher.view)}
        if job.boxes is None and self._found < FEW * (index + 1):
            with self._time_stage("detection"):
                turn = turn_that_shows_people(job.info, self._detector)
            # Without a network the turned shapes may be vehicles, and people upside down cannot be recognised.
            found = "rotate" if job.plan.detector is not None else "wide_shapes_rotate"
            summary |= {found: (job.rotate + turn) % 360} if turn else {}
        for stage in self._stages:
            stage.kept.finish(summary)
        return summary

    def _turn(self, segment: int) -> None:
        """End the segment before this one and begin this one; results of a video that has changed are not kept."""
        path = self._files.changed(self._at_s)
        if path is not None:
            what, when = ("has grown", " when its recording has ended") if self._files.grown(path) else ("was changed", "")
            told = f"{what} while it was processed: run the same command again{when}"
            raise VideoError(path, f"camera {self._job.name}: {told}")
        for stage in self._stages:
            if segment:
                stage.end(segment - 1)
            stage.begin(segment)

    def _look(self, index: int, place: int, frame: Frame) -> None:
        """Run all stages on one picture, except those with kept results."""
        if self._people.part is None:
            with self._time_stage("detection"):
                people = self._detector(frame)
            # Boxes of a file stay as they are: they are in the pixels of camera projection, or as another detector gave them.
            ltwh = people.ltwh if isinstance(self._detector, GivenBoxes) else people.centred
            score = people.score
            self._people.rows.append(_row_of(frame, ltwh, score))
        else:
            first = int(self._people.part["count"][:place].sum())
            rows = slice(first, first + int(self._people.part["count"][place]))
            ltwh, score = self._people.part["ltwh"][rows], self._people.part["score"][rows]
        self._found += len(ltwh)
        if self._looks is not None and self._embedder is not None and self._looks.part is None:
            with self._time_stage("embedding"):
                wanted = len(ltwh) > 0 and index % self._looks_every == 0
                vectors = self._embedder(frame.picture, ltwh) if wanted else no_embeddings(len(ltwh), self._embedder.dimensions)
            self._looks.rows.append({"vectors": vectors})
        if self._joints is not None and self._estimator is not None:
            # People are chosen also where the result is kept: the choice depends on all images before.
            chosen = self._choose_people(frame, ltwh, score)
            if self._joints.part is None:
                with self._time_stage("keypoints"):
                    self._joints.rows.append(_joints_of(self._estimator, frame.picture, ltwh, chosen))

    def _choose_people(self, frame: Frame, ltwh: Floats, score: Floats) -> Ints:
        """Return the rows of the people of a picture whose joints are to be found."""
        if self._budget is None:
            return np.arange(len(ltwh))
        height, width = frame.picture.shape[:2]
        return self._budget.choose(frame.seconds, ltwh, score, (width, height))

    def _parts(self, pictures: int) -> list[Arrays] | None:
        """Return the kept results of each stage, its segments concatenated; None where one is missing."""
        gathered, segments = [], (pictures + SEGMENT - 1) // SEGMENT
        for stage in self._stages:
            loaded = [stage.kept.load(segment) for segment in range(segments)]
            parts = [part for part in loaded if part is not None]
            if len(parts) < segments or not parts:
                return None
            gathered.append({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
        return gathered

    def _gather(self, summary: dict[str, Any], parts: list[Arrays]) -> VideoObservations:
        """Return the people of the whole video."""
        kept = iter(parts)
        people = next(kept)
        frame = np.repeat(people["number"], people["count"])
        boxes = Boxes(frame, np.full(len(frame), UNKNOWN), people["ltwh"], people["score"])
        appearance = next(kept)["vectors"] if self._looks is not None else None
        joints = next(kept) if self._joints is not None else None
        keypoints = Keypoints.empty()
        if joints is not None and self._estimator is not None:
            keypoints = Keypoints(frame, boxes.identity, joints["xy"], joints["score"], self._estimator.joints)
        if isinstance(self._detector, GivenBoxes):
            boxes, keypoints = self._detector.named(frame, appearance, keypoints)
        elif appearance is not None:
            boxes = replace(boxes, embedding=appearance)
        seen = keypoints.take(np.flatnonzero((keypoints.score > 0).any(axis=1)))
        view = view_of_text(summary[PLACE]) if PLACE in summary else None
        plain = {name: value for name, value in summary.items() if name != PLACE}
        return VideoObservations(
            boxes, seen, summary["pictures"], plain, self.seconds, begin_s=self._job.info.used[0], view=view
        )

    @contextmanager
    def _time_stage(self, stage: str) -> Iterator[None]:
        """Add the time of a stage to its total."""
        began = time.perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began


def _budget_of(job: CameraJob) -> JointBudget | None:
    """Return the object that chooses the people whose joints are found; None: all people are chosen."""
    if job.plan.keypoints is None or job.plan.keypoints_per_s is None:
        return None
    images = expected_count(job.info, job.rate)
    return JointBudget(job.plan.keypoints_per_s, job.rate, images, job.share)


def _joints_of(estimator: KeypointEstimator, picture: Picture, ltwh: Floats, chosen: Ints) -> Arrays:
    """Return the joints of a picture's people, to be kept; people who are not chosen have zeros."""
    xy, score = np.zeros((len(ltwh), len(estimator.joints), 2)), np.zeros((len(ltwh), len(estimator.joints)))
    if len(chosen):
        xy[chosen], score[chosen] = estimator(picture, ltwh[chosen])
    return {"xy": xy, "score": score}


def _row_of(frame: Frame, ltwh: Floats, score: Floats) -> Arrays:
    """Return the results of one picture, to be kept."""
    return {
        "number": np.array([frame.number], dtype=np.int64),
        "count": np.array([len(score)], dtype=np.int64),
        "ltwh": np.asarray(ltwh, dtype=np.float64).reshape(-1, 4),
        "score": np.asarray(score, dtype=np.float64),
    }


def _summary(pictures: int, reader: VideoReader, watcher: SteadinessWatcher) -> dict[str, Any]:
    """Return the summary of how a video was read, as plain values."""
    decoded, steadiness = reader.decoded, watcher.result()
    assert decoded is not None
    # Only for recordings in pieces, so that the kept results of files stay as they are.
    pieces = {"cut_pieces": decoded.cut_pieces, "failed_pieces": decoded.failed_pieces} if reader.info.pieces else {}
    return {
        "pictures": pictures,
        "ended_early": decoded.ended_early,
        "broken": decoded.broken,
        "first_broken_s": decoded.first_broken_s,
        "moves": [asdict(move) for move in steadiness.moves],
        "shake_px": steadiness.largest_shake_px,
        **pieces,
    }


def _versions() -> dict[str, str]:
    """Return the versions of the libraries that determine a picture's values and a network's results."""
    return {"numpy": np.__version__, "opencv": cv2.__version__, "av": av.__version__, "onnxruntime": onnxruntime.__version__}
