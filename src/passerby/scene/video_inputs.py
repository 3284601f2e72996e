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
"""So few stretches are watched in order of time: to look over the videos would take as long as one of them."""
KEPT_FOLDER = "perception"
MADE_AGAIN = "what was kept is of other videos, options or versions, and was made again"
ENOUGH_PICTURES, ENOUGH_FOR_NETWORK = 300, 150
"""Short videos are looked at more often than `WATCHED_FPS`, until there are so many pictures: a minute's worth, and half of it
where a network detects people, which takes five times as long as the background does. In six rendered films of 27 s (three
presets, seeds 171 and 172), twice the pictures made rigs by YOLOX-nano no more exact; by the background they made one rig more
exact by a third, and two more were accepted."""
ENOUGH_CAMERAS = 2
"""The joints of one camera alone are no points in space."""
TOLD_EVERY_S = 0.25

Found = TypeVar("Found")


@dataclass(eq=False)
class SceneVideoProcessor:
    """Watches the videos of a scene, all of them or stretches, and remembers what is to be reported of it."""

    keep: Path | None
    """Folder in which results are kept; None: nothing is kept."""
    executor: Executor | None
    tell: Progress
    stretches: tuple[Stretch, ...] = ()
    """Parts of the scene's time to watch, in order of time; none: all of the videos."""
    notes: list[Finding] = field(default_factory=list)
    """What could not be had."""
    figures: dict[str, Any] = field(default_factory=dict)
    """JSON-ready: what was used, and what each camera's video gave."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time of each stage, summed over the cameras."""
    _plan: Plan | None = None
    _found: dict[tuple[str, Stretch | None], VideoObservations | InputError] = field(default_factory=dict)
    """What was found so far, by camera and stretch."""

    def plan_stretches(self, scene: Scene, readings: Sequence[CameraInput]) -> tuple[Stretch, ...]:
        """The stretches of a scene's videos, the one that would teach most first; none where videos are watched as a whole.

        So are videos of less than 45 s, of unknown length, where the people are known, or where the scene points at some of
        them, at any time. Raises `InputError` as a call.
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
        """Complete the readings; faults and findings are added to them. Raises `InputError` where a model cannot be used."""
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
            if not seen:  # it films at other times than those of these stretches
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
        """Add what was seen in a video to a reading."""
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
        """The stretches of a camera that are watched; None: all of its video."""
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
        """The results of all jobs, in their order; an error that names one camera's fault stops no other camera."""
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
        # What is kept is read here: processes take longer to begin.
        kept = [None if find_kept is None else _result(find_kept, job, tell) for job, tell in zip(jobs, progress, strict=True)]
        rest = [(job, tell) for job, tell, found in zip(jobs, progress, kept, strict=True) if found is None]
        made = iter(_work_apart(work, rest, self.executor))
        return [next(made) if found is None else found for found in kept]


def _used_span(scene: Scene, reading: CameraInput) -> tuple[float, float]:
    """The used part of a camera's video, seconds of the scene: frame 1 is at 0."""
    assert reading.video is not None
    table, pace = scene.cameras[reading.name], _pace(reading)
    first = max(reading.video.begin_s / pace, table.from_s or 0.0)
    last = (reading.video.begin_s + (reading.video.seconds or 0.0)) / pace
    return first, max(first, min(last, math.inf if table.until_s is None else table.until_s))


def _pace(reading: CameraInput) -> float:
    """Seconds of a video's own clock in a second of the scene, which may state another rate of frames than the file."""
    assert reading.video is not None
    return (reading.fps or reading.video.clock_fps) / reading.video.clock_fps


def _in_video(stretch: Stretch, reading: CameraInput) -> Stretch:
    """A stretch of the scene's time by the video's own clock."""
    pace = _pace(reading)
    return Stretch(stretch.begin_s * pace, stretch.end_s * pace)


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


def picture_rate(scene: Scene, reading: CameraInput, info: VideoInfo, *, by_network: bool = False) -> float:
    """Pictures to look at in a second of the video's own clock: a whole fraction of its rate, for even steps.

    Args:
        scene: may state how many.
        reading: of the camera.
        info: its video.
        by_network: whether a network detects people in them.
    """
    pace = (reading.fps or info.clock_fps) / info.clock_fps
    wanted = scene.perception.fps
    if wanted is None:
        seconds = info.seconds / pace if info.seconds else None
        enough = ENOUGH_FOR_NETWORK if by_network else ENOUGH_PICTURES
        wanted = max(WATCHED_FPS, enough / seconds) if seconds else WATCHED_FPS
    # The rate of images is a quotient: 12.500000001 a second are 12.5.
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
    """The folder of kept results; a passing one where nothing is kept."""
    if keep is not None:
        yield keep / KEPT_FOLDER
        return
    with tempfile.TemporaryDirectory(prefix="passerby-") as folder:
        yield Path(folder)


@dataclass(eq=False)
class _JobProgress:
    """How far one job is. What is reported is its camera's progress, all its jobs together."""

    camera: str
    total: int
    """0 where that is unknown."""
    others: list[_JobProgress]
    """The jobs of the camera, this one among them."""
    forward: Forward
    done: int = 0

    def __post_init__(self) -> None:
        self.others.append(self)

    def __call__(self, done: int, total: int) -> None:
        self.done, self.total = max(self.done, done), self.total or total
        self.report()

    def finish(self) -> None:
        """All of the job is done."""
        self.done = self.total = max(self.done, self.total)
        self.report()

    def report(self) -> None:
        """Report how far the camera is."""
        known = all(one.total for one in self.others)
        total = sum(one.total for one in self.others) if known else 0
        self.forward(self.camera, sum(one.done for one in self.others), total)


def _work_apart(
    work: Callable[[CameraJob, Tell], Found], jobs: Sequence[tuple[CameraJob, _JobProgress]], executor: Executor
) -> list[Found | InputError]:
    """The results of all jobs in their order, each made in a process of its own.

    Each process writes how far it is to a file that belongs to this run alone: nothing of an earlier run is taken for it, and
    it stays until all are done.
    """
    # Other machines see the folder of kept results only.
    shared = (jobs[0][0].common_shelf or jobs[0][0].shelf).parent if jobs and hasattr(executor, "least_s") else None
    if shared is not None:
        shared.mkdir(parents=True, exist_ok=True)
    # Processes of a run that is interrupted may write for a moment longer.
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
