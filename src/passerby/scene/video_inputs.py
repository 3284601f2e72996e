"""The videos of a scene, watched side by side, each camera with a progress of its own."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from passerby.common.errors import InputError
from passerby.common.parallel import interrupted_later
from passerby.common.progress import Forward, Progress, tell_warning
from passerby.common.text import list_names
from passerby.findings.finding import Finding, Severity
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.perception.model_files import AUTO
from passerby.perception.pictures import VideoError
from passerby.perception.plan import CROPS_PER_S, Plan, keypoints_to_be_had, make_plan
from passerby.perception.video import VideoInfo
from passerby.perception.video_observations import VideoObservations
from passerby.perception.watching import CameraJob, Tell, find_kept_results, watch_camera, work_of
from passerby.scene.camera_input import CameraInput
from passerby.scene.reading import add_video_results, name_video_error, needs_embeddings, needs_keypoints, needs_video
from passerby.scene.scene import Scene
from passerby.scene.tables import WATCHED_FPS

KEPT_FOLDER = "perception"
MADE_AGAIN = "what was kept is of other videos, options or versions, and was made again"
ENOUGH_PICTURES = 300
"""Short videos are looked at more often than `WATCHED_FPS`, until there are so many pictures: a minute's worth."""
ENOUGH_CAMERAS = 2
"""The joints of one camera alone are no points in space."""
TOLD_EVERY_S = 0.25

Found = TypeVar("Found")


@dataclass(eq=False)
class SceneVideoProcessor:
    """Watches the videos of a scene, and remembers what is to be reported of it."""

    keep: Path | None
    """Folder in which results are kept; None: nothing is kept."""
    executor: Executor | None
    tell: Progress
    notes: list[Finding] = field(default_factory=list)
    """What could not be had."""
    figures: dict[str, Any] = field(default_factory=dict)
    """JSON-ready: what was used, and what each camera's video gave."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time of each stage, summed over the cameras."""

    def __call__(self, scene: Scene, readings: Sequence[CameraInput]) -> None:
        """Complete the readings; faults and findings are added to them. Raises `InputError` where a model cannot be used."""
        plan = plan_of(scene, readings, self.tell)
        self.notes += plan.notes
        wanting = [reading for reading in readings if needs_video(scene, reading)]
        with _shelves(self.keep) as shelf:
            jobs = [_job(scene, reading, plan, shelf) for reading in wanting]
            results = self._watch_all(jobs)
        again = [
            job.name
            for job, found in zip(jobs, results, strict=True)
            if isinstance(found, VideoObservations) and found.made_again
        ]
        if again and self.keep is not None:
            tell_warning(self.tell, f"{self.keep / KEPT_FOLDER}: {MADE_AGAIN}: {list_names(again)}")
        for reading, job, result in zip(wanting, jobs, results, strict=True):
            if isinstance(result, InputError):
                reading.faults += faults_of(result)
                continue
            table = scene.cameras[reading.name]
            used = table.from_s or 0.0, math.inf if table.until_s is None else table.until_s
            reading.faults += result.faults(reading.name, job.info, *used, stated=table.rotate)
            reading.findings += result.findings(reading.name, job.info)
            add_video_results(scene, reading, result.boxes, result.keypoints)
            for stage, seconds in result.seconds.items():
                self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self.figures = plan.figures | {
            "cameras": {
                reading.name: {"pictures": result.pictures, "boxes": len(result.boxes), **result.summary}
                for reading, result in zip(wanting, results, strict=True)
                if isinstance(result, VideoObservations)
            }
        }

    def _watch_all(self, jobs: Sequence[CameraJob]) -> list[VideoObservations | InputError]:
        """The results of all jobs, in their order; an error that names one camera's fault stops no other camera."""
        forward = Forward(self.tell, "processing videos")
        for job in jobs:
            forward(job.name, 0, work_of(job))
        if self.executor is None:
            results = []
            for job in jobs:
                results.append(_result(watch_camera, job, partial(forward, job.name)))
                forward.finish(job.name)
            return results
        # What is kept is read here: processes take longer to begin.
        kept = [_result(find_kept_results, job, partial(forward, job.name)) for job in jobs]
        made = iter(_watch_apart([job for job, found in zip(jobs, kept, strict=True) if found is None], self.executor, forward))
        return [next(made) if found is None else found for found in kept]


def plan_of(scene: Scene, readings: Sequence[CameraInput], tell: Progress) -> Plan:
    """What a scene's videos are watched with. Raises `InputError` where a model that it names cannot be used."""
    wanted = scene.perception
    models = None if wanted.models is None else scene.resolve(wanted.models)
    base, keypoints = scene.resolve(Path()), choose_keypoints(scene, readings)
    try:
        plan = make_plan(wanted.detector, wanted.embedder, keypoints, models=models, base=base, tell=tell)
    except InputError as error:
        raise InputError(f"{scene.place}: {error}") from None
    per_s = wanted.keypoints_per_s or (CROPS_PER_S if wanted.keypoints == AUTO else None)
    return replace(plan, keypoints_per_s=per_s, min_score=wanted.min_score, tiles=wanted.tiles)


def choose_keypoints(scene: Scene, readings: Sequence[CameraInput]) -> str:
    """The scene's choice of keypoints; "none" where it is left to us and fewer than two cameras would have any."""
    choice = scene.perception.keypoints
    with_joints = sum(reading.keypoints_path is not None or _is_measurable(scene, reading) for reading in readings)
    return "none" if choice == AUTO and with_joints < ENOUGH_CAMERAS else choice


def _is_measurable(scene: Scene, reading: CameraInput) -> bool:
    return reading.video is not None and not reading.faults and needs_keypoints(scene, reading)


def keypoints_for(scene: Scene) -> str | None:
    """The network that would find joints in a scene's videos, where the scene wants none: one that is on this computer or can
    be fetched. None where there is none, or fewer than two videos.
    """
    filmed = [table for table in scene.cameras.values() if table.video is not None and table.keypoints is None]
    if scene.perception.keypoints != "none" or len(filmed) < ENOUGH_CAMERAS:
        return None
    return keypoints_to_be_had(None if scene.perception.models is None else scene.resolve(scene.perception.models))


def joints_remedy(scene: Scene, severity: Severity) -> Finding | None:
    """What joints would do for a scene whose cameras could not all be registered; None where none can be had."""
    name = keypoints_for(scene)
    return None if name is None else Finding("keypoints_unused", severity, values={"network": name})


def picture_rate(scene: Scene, reading: CameraInput, info: VideoInfo) -> float:
    """Pictures to look at in a second of the video's own clock: a whole fraction of its rate, for even steps."""
    pace = (reading.fps or info.clock_fps) / info.clock_fps
    wanted = scene.perception.fps
    if wanted is None:
        seconds = info.seconds / pace if info.seconds else None
        wanted = max(WATCHED_FPS, ENOUGH_PICTURES / seconds) if seconds else WATCHED_FPS
    # The rate of images is a quotient: 12.500000001 a second are 12.5.
    return info.average_fps / max(1, round(round(info.average_fps * pace / wanted, 6)))


def _job(scene: Scene, reading: CameraInput, plan: Plan, shelf: Path) -> CameraJob:
    assert reading.video is not None
    appearance = needs_embeddings(scene, reading)
    joints = plan.keypoints if needs_keypoints(scene, reading) else None
    return CameraJob(
        name=reading.name,
        info=reading.video,
        rate=picture_rate(scene, reading, reading.video),
        plan=replace(plan, embedder=plan.embedder if appearance else None, keypoints=joints),
        shelf=shelf / reading.name,
        rotate=reading.rotate,
        boxes=None if reading.awaiting else reading.boxes,
    )


@contextmanager
def _shelves(keep: Path | None) -> Iterator[Path]:
    """The folder of kept results; a passing one where nothing is kept."""
    if keep is not None:
        yield keep / KEPT_FOLDER
        return
    with tempfile.TemporaryDirectory(prefix="passerby-") as folder:
        yield Path(folder)


def _watch_apart(jobs: Sequence[CameraJob], executor: Executor, forward: Forward) -> list[VideoObservations | InputError]:
    """The results of all jobs in their order, each made in a process of its own.

    Each process writes how far it is to a file that belongs to this run alone: nothing of an earlier run is taken for it, and
    it stays until all are done.
    """
    # Other machines see the folder of kept results only.
    shared = jobs[0].shelf.parent if jobs and hasattr(executor, "least_s") else None
    if shared is not None:
        shared.mkdir(parents=True, exist_ok=True)
    # Processes of a run that is interrupted may write for a moment longer.
    with tempfile.TemporaryDirectory(prefix="passerby-", dir=shared, ignore_cleanup_errors=True) as folder:
        counts = [_Counts(Path(folder) / str(number)) for number in range(len(jobs))]
        with interrupted_later():
            futures = [executor.submit(partial(_result, watch_camera), job, own) for job, own in zip(jobs, counts, strict=True)]
        waiting: set[Future[VideoObservations | InputError]] = set(futures)
        while waiting:
            _, waiting = wait(waiting, timeout=TOLD_EVERY_S, return_when=FIRST_COMPLETED)
            for job, own, future in zip(jobs, counts, futures, strict=True):
                if future.done() and not future.cancelled() and future.exception() is None:
                    forward.finish(job.name)
                elif (read := own.read()) is not None:
                    forward(job.name, *read)
        return [future.result() for future in futures]


@dataclass(eq=False)
class _Counts:
    """How far one camera is, in a file: written by one process, read by another."""

    path: Path
    last: float = 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self.last < TOLD_EVERY_S and done < total:
            return
        self.last = now
        written = self.path.with_suffix(".new")
        # A full disk is reported by the code that keeps results on it.
        with suppress(OSError):
            written.write_text(f"{done} {total}", encoding="ascii")
            # In one step: half a number is never read.
            written.replace(self.path)

    def read(self) -> tuple[int, int] | None:
        """What was written last; None where nothing was so far."""
        try:
            done, total = self.path.read_text(encoding="ascii").split()
            return int(done), int(total)
        except (OSError, ValueError):
            return None


def _result(watch: Callable[[CameraJob, Tell], Found], job: CameraJob, tell: Tell) -> Found | InputError:
    """What was seen, or what is wrong with this camera."""
    try:
        # One thread each: more would wait for each other, and their number would change the last bits.
        with threadpool_limits(limits=1, user_api="blas"):
            return watch(job, tell)
    except VideoError as error:
        return name_video_error(error, job.name) if error.path in (job.info.path, *job.info.files) else InputError(str(error))
    except InputError as error:
        return InputError(str(error))
