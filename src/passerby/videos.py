"""The videos of a scene, watched side by side, each camera with a progress of its own."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from passerby.errors import InputError
from passerby.interchange.faults import faults_of
from passerby.perception.plan import Plan, make_plan
from passerby.perception.video import VideoInfo, expected_count
from passerby.perception.watching import CameraJob, Watched, watch_camera
from passerby.progress import Progress
from passerby.reading import CameraReading, fill, of_video, wants_joints, wants_looks, wants_video
from passerby.scene import Scene
from passerby.scene_tables import WATCHED_FPS

KEPT_FOLDER = "perception"
ENOUGH_PICTURES = 300
"""Short videos are looked at more often than `WATCHED_FPS`, until there are so many pictures: a minute's worth."""
TOLD_EVERY_S = 0.25


@dataclass(eq=False)
class Videos:
    """Watches the videos of a scene, and remembers what is to be told of it."""

    keep: Path | None
    """Folder in which results are kept; None: nothing is kept."""
    executor: Executor | None
    tell: Progress
    notes: list[str] = field(default_factory=list)
    """What could not be had, one sentence each."""
    figures: dict[str, Any] = field(default_factory=dict)
    """JSON-ready: what was used, and what each camera's video gave."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time of each stage, summed over the cameras."""

    def __call__(self, scene: Scene, readings: Sequence[CameraReading]) -> None:
        """Complete the readings; faults and findings are added to them. Raises `InputError` where a model cannot be used."""
        plan = plan_of(scene, self.tell)
        self.notes += plan.notes
        wanting = [reading for reading in readings if wants_video(scene, reading)]
        with _shelves(self.keep) as shelf:
            jobs = [_job(scene, reading, plan, shelf) for reading in wanting]
            results = self._watched(jobs)
        for reading, job, result in zip(wanting, jobs, results, strict=True):
            if isinstance(result, InputError):
                reading.faults += faults_of(result)
                continue
            table = scene.cameras[reading.name]
            used = table.from_s or 0.0, math.inf if table.until_s is None else table.until_s
            reading.faults += result.faults(reading.name, job.info, *used)
            reading.findings += result.findings(reading.name, job.info)
            fill(scene, reading, result.boxes, result.keypoints)
            for stage, seconds in result.seconds.items():
                self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self.figures = plan.figures | {
            "cameras": {
                reading.name: {"pictures": result.pictures, "boxes": len(result.boxes), **result.summary}
                for reading, result in zip(wanting, results, strict=True)
                if isinstance(result, Watched)
            }
        }

    def _watched(self, jobs: Sequence[CameraJob]) -> list[Watched | InputError]:
        """The results of all jobs, in their order; an error that names one camera's fault stops no other camera."""
        for job in jobs:
            self.tell("watching", 0, expected_count(job.info, job.rate) or 0, part=job.name)
        if self.executor is None:
            return [_result(job, _Teller(self.tell, job.name)) for job in jobs]
        futures: list[Future[Watched | InputError]] = [self.executor.submit(_result, job, None) for job in jobs]
        waiting = set(futures)
        while waiting:
            _, waiting = wait(waiting, timeout=TOLD_EVERY_S, return_when=FIRST_COMPLETED)
            for job in jobs:
                self.tell("watching", *_progress_of(job), part=job.name)
        return [future.result() for future in futures]


def plan_of(scene: Scene, tell: Progress) -> Plan:
    """What a scene's videos are watched with. Raises `InputError` where a model that it names cannot be used."""
    wanted = scene.perception
    models = None if wanted.models is None else scene.resolve(wanted.models)
    base = scene.resolve(Path())
    try:
        plan = make_plan(wanted.detector, wanted.embedder, wanted.keypoints, models=models, base=base, tell=tell)
    except InputError as error:
        raise InputError(f"{scene.place}: {error}") from None
    return replace(plan, min_score=wanted.min_score, tiles=wanted.tiles)


def picture_rate(scene: Scene, reading: CameraReading, info: VideoInfo) -> float:
    """Pictures to look at in a second of the video's own clock: a whole fraction of its rate, for even steps."""
    pace = (reading.fps or info.clock_fps) / info.clock_fps
    wanted = scene.perception.fps
    if wanted is None:
        seconds = info.seconds / pace if info.seconds else None
        wanted = max(WATCHED_FPS, ENOUGH_PICTURES / seconds) if seconds else WATCHED_FPS
    return info.average_fps / max(1, round(info.average_fps * pace / wanted))


def _job(scene: Scene, reading: CameraReading, plan: Plan, shelf: Path) -> CameraJob:
    assert reading.video is not None
    looks = wants_looks(scene, reading)
    joints = plan.keypoints if wants_joints(scene, reading) else None
    return CameraJob(
        name=reading.name,
        info=reading.video,
        rate=picture_rate(scene, reading, reading.video),
        plan=replace(plan, embedder=plan.embedder if looks else None, keypoints=joints),
        shelf=shelf / reading.name,
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


@dataclass(frozen=True)
class _Teller:
    """Tells how far one camera is."""

    tell: Progress
    name: str

    def __call__(self, done: int, total: int) -> None:
        self.tell("watching", done, total, part=self.name)


@dataclass(eq=False)
class _Noted:
    """Writes how far one camera is into its folder, for another process to read."""

    path: Path
    last: float = 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self.last < TOLD_EVERY_S and done < total:
            return
        self.last = now
        # Whether the folder can be written is the business of those who keep results in it.
        with suppress(OSError):
            self.path.write_text(f"{done} {total}", encoding="ascii")


def _note(job: CameraJob) -> Path:
    return job.shelf / "progress"


def _progress_of(job: CameraJob) -> tuple[int, int]:
    """How far a job is in another process: pictures done, and all of them."""
    try:
        done, total = _note(job).read_text(encoding="ascii").split()
        return int(done), int(total)
    except (OSError, ValueError):
        return 0, expected_count(job.info, job.rate) or 0


def _result(job: CameraJob, tell: _Teller | None) -> Watched | InputError:
    """What was seen, or what is wrong with this camera."""
    noted = _Noted(_note(job)) if tell is None else None
    try:
        # One thread each: more would wait for each other, and their number would change the last bits.
        with threadpool_limits(limits=1, user_api="blas"):
            return watch_camera(job, tell or noted or _Noted(_note(job)))
    except InputError as error:
        return of_video(error, job.name) if str(error).startswith(f"{job.info.path}:") else InputError(str(error))
    finally:
        if noted is not None:
            _note(job).unlink(missing_ok=True)
