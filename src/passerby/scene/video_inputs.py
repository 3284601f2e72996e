"""Processing of a scene's videos in parallel, with separate progress for each camera."""

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
from passerby.core.observations import Boxes, Keypoints
from passerby.findings.finding import Finding, Severity
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.perception.model_files import AUTO
from passerby.perception.overview import look_over
from passerby.perception.pictures import VideoError
from passerby.perception.plan import CROPS_PER_S, Plan, keypoints_to_be_had, make_plan
from passerby.perception.stretches import (
    MOST_LOOKS,
    Stretch,
    cut_into_stretches,
    find_window,
    is_divisible,
    part_of_video,
    rank_stretches,
)
from passerby.perception.video import VideoInfo
from passerby.perception.video_observations import VideoObservations, join_stretches
from passerby.perception.watching import CameraJob, Tell, find_kept_results, watch_camera, work_of
from passerby.scene.camera_input import CameraInput
from passerby.scene.pointing import is_pointed_at
from passerby.scene.reading import add_video_results, name_video_error, needs_embeddings, needs_keypoints, needs_video
from passerby.scene.scene import Scene
from passerby.scene.tables import WATCHED_FPS

UNRANKED = 4
"""Up to this number, stretches are processed in order of time: an overview of the videos would take as long as one of them."""
KEPT_FOLDER = "perception"
MADE_AGAIN = "what was kept is of other videos, options or versions, and was made again"
ENOUGH_PICTURES, ENOUGH_FOR_NETWORK = 300, 150
"""Number of pictures up to which short videos are processed at a higher rate than `WATCHED_FPS`: those of a minute, and half of
them if a network detects people, which takes five times as long as background subtraction. In six rendered films of 27 s (three
presets, seeds 171 and 172), twice the pictures made rigs by YOLOX-nano no more accurate; by background subtraction, they made
one rig more accurate by a third, and two more were accepted."""
ENOUGH_CAMERAS = 2
"""Minimum number of cameras with joints: those of one camera alone give no points in space."""
TOLD_EVERY_S = 0.25

Found = TypeVar("Found")


@dataclass(eq=False)
class SceneVideoProcessor:
    """Processes the videos of a scene, all of them or stretches, and collects notes and figures for the report."""

    keep: Path | None
    """Folder in which results are kept; None: no results are kept."""
    executor: Executor | None
    tell: Progress
    stretches: tuple[Stretch, ...] = ()
    """Parts of the scene's time to process, in order of time; none: all of the videos."""
    notes: list[Finding] = field(default_factory=list)
    """Notes of models that were not available."""
    figures: dict[str, Any] = field(default_factory=dict)
    """JSON-ready figures of the models that were used, and of the results from each camera's video."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time of each stage, summed over the cameras."""
    _plan: Plan | None = None
    _found: dict[tuple[str, Stretch | None], VideoObservations | InputError] = field(default_factory=dict)
    """Results so far, by camera and stretch."""

    def plan_stretches(self, scene: Scene, readings: Sequence[CameraInput]) -> tuple[Stretch, ...]:
        """Divide a scene's videos into stretches, the most informative one first; none if videos are processed as a whole.

        Videos are processed as a whole if they are shorter than 45 s or of unknown length, if a table has the times of their
        frames, if people are known, or if the scene points at some of them, at any time. Raises `InputError` as a call does.
        """
        filmed = [reading for reading in readings if needs_video(scene, reading) and reading.awaiting]
        if (
            not filmed
            or is_pointed_at(scene, filmed)
            or not all(reading.video is not None and is_divisible(reading.video) for reading in filmed)
        ):
            return ()
        spans = [_used_span(scene, reading) for reading in filmed]
        stretches = cut_into_stretches(min(first for first, _ in spans), max(last for _, last in spans))
        if len(stretches) <= UNRANKED:
            return stretches if len(stretches) > 1 else ()
        plan = self._make_plan(scene, readings)
        with _shelves(self.keep) as shelf:
            jobs = [_job(scene, reading, plan, shelf) for reading in filmed]
            looks = self._run_all(look_over, jobs, "looking over the videos", [2 * MOST_LOOKS for _ in jobs])
        overviews = {}
        for reading, look in zip(filmed, looks, strict=True):
            if isinstance(look, InputError):
                raise look
            overviews[reading.name] = replace(look, seconds=look.seconds / _pace(reading))
        return tuple(stretches[k] for k in rank_stretches(stretches, overviews))

    def __call__(self, scene: Scene, readings: Sequence[CameraInput]) -> None:
        """Complete the readings; faults and findings are added to them. Raises `InputError` if a model cannot be used."""
        plan = self._make_plan(scene, readings)
        wanting = [reading for reading in readings if needs_video(scene, reading)]
        wanted = [(reading, stretch) for reading in wanting for stretch in self._stretches_of(scene, reading)]
        left = [(reading, stretch) for reading, stretch in wanted if (reading.name, stretch) not in self._found]
        with _shelves(self.keep) as shelf:
            jobs = [_job(scene, reading, plan, shelf, stretch) for reading, stretch in left]
            results = self._run_all(watch_camera, jobs, self._stage_name(), [work_of(job) for job in jobs], find_kept_results)
        again = []
        for (reading, stretch), result in zip(left, results, strict=True):
            self._found[reading.name, stretch] = result
            if isinstance(result, VideoObservations):
                again += [reading.name] if result.made_again else []
                for stage, seconds in result.seconds.items():
                    self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        if again and self.keep is not None:
            tell_warning(self.tell, f"{self.keep / KEPT_FOLDER}: {MADE_AGAIN}: {list_names(list(dict.fromkeys(again)))}")
        cameras = {}
        for reading in wanting:
            stretches = self._stretches_of(scene, reading)
            found = [self._found[reading.name, stretch] for stretch in stretches]
            errors = [one for one in found if isinstance(one, InputError)]
            if errors:
                reading.faults += faults_of(errors[0])
                continue
            seen = [one for one in found if isinstance(one, VideoObservations)]
            if not seen:  # the camera recorded at other times than these stretches
                reading.unprocessed = ((-math.inf, math.inf),)
                add_video_results(scene, reading, Boxes.empty(), Keypoints.empty())
                continue
            assert reading.video is not None
            result = join_stretches(seen, reading.video.size) if len(seen) > 1 else seen[0]
            self._complete(scene, reading, result, stretches)
            cameras[reading.name] = {"pictures": result.pictures, "boxes": len(result.boxes), **result.summary}
        self.figures = plan.figures | {"cameras": cameras}

    def _complete(
        self, scene: Scene, reading: CameraInput, result: VideoObservations, stretches: Sequence[Stretch | None]
    ) -> None:
        """Add the results from a video to a reading."""
        assert reading.video is not None
        table = scene.cameras[reading.name]
        used = table.from_s or 0.0, math.inf if table.until_s is None else table.until_s
        reading.faults += result.faults(reading.name, reading.video, *used, stated=table.rotate)
        reading.findings += result.findings(reading.name, reading.video)
        watched = [_in_video(stretch, reading) for stretch in stretches if stretch is not None]
        if watched:
            ends = [-math.inf, *(end for one in watched for end in (one.begin_s, one.end_s)), math.inf]
            reading.unprocessed = tuple((a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a)
        add_video_results(scene, reading, result.boxes, result.keypoints)

    def _make_plan(self, scene: Scene, readings: Sequence[CameraInput]) -> Plan:
        if self._plan is None:
            self._plan = plan_of(scene, readings, self.tell)
            self.notes += self._plan.notes
        return self._plan

    def _stretches_of(self, scene: Scene, reading: CameraInput) -> list[Stretch | None]:
        """Return the stretches of a camera that are processed; None stands for its whole video."""
        if not self.stretches or not reading.awaiting:
            return [None]
        first, last = _used_span(scene, reading)
        return [one for one in self.stretches if one.begin_s < last and one.end_s > first]

    def _stage_name(self) -> str:
        seconds = sum(one.seconds for one in self.stretches)
        return "processing videos" + (f", {seconds:.0f} s" if self.stretches else "")

    def _run_all(
        self, work: Callable[[CameraJob, Tell], Found], jobs: Sequence[CameraJob], stage: str, totals: Sequence[int],
        find_kept: Callable[[CameraJob, Tell], Found | None] | None = None,
    ) -> list[Found | InputError]:  # fmt: skip
        """Return the results of all jobs, in their order; an error of one camera does not stop the other cameras."""
        forward = Forward(self.tell, stage)
        of_camera: dict[str, list[_JobProgress]] = {}
        progress = [
            _JobProgress(job.name, total, of_camera.setdefault(job.name, []), forward)
            for job, total in zip(jobs, totals, strict=True)
        ]
        for one in progress:
            one.report()
        if self.executor is None:
            results = []
            for job, tell in zip(jobs, progress, strict=True):
                results.append(_result(work, job, tell))
                tell.finish()
            return results
        # Kept results are read in this process, because other processes take longer to begin.
        kept = [None if find_kept is None else _result(find_kept, job, tell) for job, tell in zip(jobs, progress, strict=True)]
        rest = [(job, tell) for job, tell, found in zip(jobs, progress, kept, strict=True) if found is None]
        made = iter(_work_apart(work, rest, self.executor))
        return [next(made) if found is None else found for found in kept]


def _used_span(scene: Scene, reading: CameraInput) -> tuple[float, float]:
    """Return begin and end of the used part of a camera's video, seconds of the scene: frame 1 is at 0."""
    assert reading.video is not None
    table, pace = scene.cameras[reading.name], _pace(reading)
    first = max(reading.video.begin_s / pace, table.from_s or 0.0)
    last = (reading.video.begin_s + (reading.video.seconds or 0.0)) / pace
    return first, max(first, min(last, math.inf if table.until_s is None else table.until_s))


def _pace(reading: CameraInput) -> float:
    """Return the seconds of a video's own clock per second of the scene, which may state another frame rate than the file."""
    assert reading.video is not None
    return (reading.fps or reading.video.clock_fps) / reading.video.clock_fps


def _in_video(stretch: Stretch, reading: CameraInput) -> Stretch:
    """Convert a stretch of the scene's time to the video's own clock."""
    pace = _pace(reading)
    return Stretch(stretch.begin_s * pace, stretch.end_s * pace)


def plan_of(scene: Scene, readings: Sequence[CameraInput], tell: Progress) -> Plan:
    """Return the models and options for a scene's videos. Raises `InputError` if a model that it names cannot be used."""
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
    """Return the scene's choice of keypoints; "none" if it is "auto" and fewer than two cameras would have keypoints."""
    choice = scene.perception.keypoints
    with_joints = sum(reading.keypoints_path is not None or _is_measurable(scene, reading) for reading in readings)
    return "none" if choice == AUTO and with_joints < ENOUGH_CAMERAS else choice


def _is_measurable(scene: Scene, reading: CameraInput) -> bool:
    return reading.video is not None and not reading.faults and needs_keypoints(scene, reading)


def keypoints_for(scene: Scene) -> str | None:
    """Return the network that would detect joints in the videos of a scene that switches them off.

    It is on this computer or can be downloaded. None if there is none, or if there are fewer than two videos.
    """
    filmed = [table for table in scene.cameras.values() if table.video is not None and table.keypoints is None]
    if scene.perception.keypoints != "none" or len(filmed) < ENOUGH_CAMERAS:
        return None
    return keypoints_to_be_had(None if scene.perception.models is None else scene.resolve(scene.perception.models))


def joints_remedy(scene: Scene, severity: Severity) -> Finding | None:
    """Return the finding that joints could help to register all cameras of a scene; None if no network is available."""
    name = keypoints_for(scene)
    return None if name is None else Finding("keypoints_unused", severity, values={"network": name})


def picture_rate(scene: Scene, reading: CameraInput, info: VideoInfo, *, by_network: bool = False) -> float:
    """Compute the pictures to process per second of the video's own clock: its rate over a whole number, for even steps.

    Args:
        scene: may state a rate.
        reading: reading of the camera.
        info: its video.
        by_network: whether a network detects people in the pictures.
    """
    pace = (reading.fps or info.clock_fps) / info.clock_fps
    wanted = scene.perception.fps
    if wanted is None:
        seconds = info.seconds / pace if info.seconds else None
        enough = ENOUGH_FOR_NETWORK if by_network else ENOUGH_PICTURES
        wanted = max(WATCHED_FPS, enough / seconds) if seconds else WATCHED_FPS
    # The rate of images is a computed quotient: 12.500000001 per second is 12.5.
    return info.average_fps / max(1, round(round(info.average_fps * pace / wanted, 6)))


def _job(scene: Scene, reading: CameraInput, plan: Plan, shelf: Path, stretch: Stretch | None = None) -> CameraJob:
    assert reading.video is not None
    appearance = needs_embeddings(scene, reading)
    joints = plan.keypoints if needs_keypoints(scene, reading) else None
    own = shelf / reading.name
    job = CameraJob(
        name=reading.name,
        info=reading.video,
        rate=picture_rate(scene, reading, reading.video, by_network=reading.awaiting and plan.detector is not None),
        plan=replace(plan, embedder=plan.embedder if appearance else None, keypoints=joints),
        shelf=own,
        rotate=reading.rotate,
        boxes=None if reading.awaiting else reading.boxes,
    )
    if stretch is None:
        return job
    part = _in_video(stretch, reading)
    whole = Stretch(reading.video.begin_s, reading.video.begin_s + (reading.video.seconds or 0.0))
    return replace(
        job,
        info=part_of_video(reading.video, part),
        shelf=own / f"{stretch.begin_s:09.3f}",
        surroundings=part_of_video(reading.video, find_window(whole, part)),
        common_shelf=own,
        share=part.seconds / whole.seconds,
    )


@contextmanager
def _shelves(keep: Path | None) -> Iterator[Path]:
    """Provide the folder of kept results; a temporary one if no results are kept."""
    if keep is not None:
        yield keep / KEPT_FOLDER
        return
    with tempfile.TemporaryDirectory(prefix="passerby-") as folder:
        yield Path(folder)


@dataclass(eq=False)
class _JobProgress:
    """Progress of one job. It reports the progress of the camera, over all of its jobs."""

    camera: str
    total: int
    """Number of steps of the job; 0 if it is unknown."""
    others: list[_JobProgress]
    """Progress of all jobs of the camera, this one among them."""
    forward: Forward
    done: int = 0

    def __post_init__(self) -> None:
        self.others.append(self)

    def __call__(self, done: int, total: int) -> None:
        self.done, self.total = max(self.done, done), self.total or total
        self.report()

    def finish(self) -> None:
        """Mark all of the job as done, and report."""
        self.done = self.total = max(self.done, self.total)
        self.report()

    def report(self) -> None:
        """Report the progress of the camera."""
        known = all(one.total for one in self.others)
        total = sum(one.total for one in self.others) if known else 0
        self.forward(self.camera, sum(one.done for one in self.others), total)


def _work_apart(
    work: Callable[[CameraJob, Tell], Found], jobs: Sequence[tuple[CameraJob, _JobProgress]], executor: Executor
) -> list[Found | InputError]:
    """Run all jobs with the executor, and return the results in their order.

    Each job writes its progress to a file that belongs only to this run, so that no file of an earlier run is read. The files
    stay until all jobs are done.
    """
    # Other machines see only the folder of kept results.
    shared = (jobs[0][0].common_shelf or jobs[0][0].shelf).parent if jobs and hasattr(executor, "least_s") else None
    if shared is not None:
        shared.mkdir(parents=True, exist_ok=True)
    # Processes of an interrupted run may still write for a moment.
    with tempfile.TemporaryDirectory(prefix="passerby-", dir=shared, ignore_cleanup_errors=True) as folder:
        counts = [_Counts(Path(folder) / str(number)) for number in range(len(jobs))]
        with interrupted_later():
            futures = [executor.submit(partial(_result, work), job, own) for (job, _), own in zip(jobs, counts, strict=True)]
        waiting: set[Future[Found | InputError]] = set(futures)
        while waiting:
            _, waiting = wait(waiting, timeout=TOLD_EVERY_S, return_when=FIRST_COMPLETED)
            for (_, tell), own, future in zip(jobs, counts, futures, strict=True):
                if future.done() and not future.cancelled() and future.exception() is None:
                    tell.finish()
                elif (read := own.read()) is not None:
                    tell(*read)
        return [future.result() for future in futures]


@dataclass(eq=False)
class _Counts:
    """Progress of one job in a file: one process writes it, another process reads it."""

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
            # The file is replaced in one step, so that an incomplete number is never read.
            written.replace(self.path)

    def read(self) -> tuple[int, int] | None:
        """Return (done, total) as last written; None if there is nothing yet."""
        try:
            done, total = self.path.read_text(encoding="ascii").split()
            return int(done), int(total)
        except (OSError, ValueError):
            return None


def _result(watch: Callable[[CameraJob, Tell], Found], job: CameraJob, tell: Tell) -> Found | InputError:
    """Return the observations of a job, or the error of its camera."""
    try:
        # One thread per job: more would wait for each other, and their number would change the last bits of a result.
        with threadpool_limits(limits=1, user_api="blas"):
            return watch(job, tell)
    except VideoError as error:
        return name_video_error(error, job.name) if error.path in (job.info.path, *job.info.files) else InputError(str(error))
    except InputError as error:
        return InputError(str(error))
