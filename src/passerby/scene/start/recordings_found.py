"""Search for cameras whose videos are in pieces, or are images: in Frigate's layout, in one folder each, or by their names.

Only one file of each camera is opened, and the rest follows from the names; only some key frames are read to count people.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from glob import escape
from itertools import islice
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import natural_key
from passerby.perception.overview import learn_from_looks
from passerby.perception.pictures import Frame
from passerby.perception.pieces import PICTURE_ENDINGS, VIDEO_ENDINGS, walk_below
from passerby.perception.sources.file_times import times_of
from passerby.perception.sources.files import MOST_FILES, VideoSource, list_files
from passerby.perception.sources.name_times import find_usual_time
from passerby.perception.sources.recording import open_source
from passerby.perception.video_probe import VideoInfo, WallTime
from passerby.perception.video_still import key_picture
from passerby.scene.start.recordings import (
    Length,
    Look,
    companions_note,
    find_chapters,
    is_numbered_series,
    pieces_among,
    set_aside_small_copies,
    time_in,
)

VIDEO_FOLDERS = ("video", "videos")
"""Names of folders that hold the videos of all cameras."""
PROPOSED_S = 900.0
"""Length of the proposed span, seconds: it is sufficient for a rig if there are many people, and takes minutes to process."""
FULL, MOST_ENDS = 0.8, 10_000
"""Each camera must have at least this share of its maximum number of files in a span; number of span ends that are tried, one
per minute."""
ASSUMED_FPS = 25.0
"""Frame rate of numbered images until the user states it; it is only used to read their sizes."""
_DAY, _HOUR = re.compile(r"\d{4}-\d\d-\d\d"), re.compile(r"\d\d")
_NO_CAMERA = re.compile(r"calib|intrinsic|checker|chess|board|snapshot|thumb|clips", re.IGNORECASE)
"""Names of folders that are not those of cameras."""
MOST_CAMERAS, MOST_MOMENTS = 3, 96
"""Maximum number of cameras, and of moments, whose key frames are examined: a key frame of 1920 x 1080 takes some 50 ms, a day
of three cameras a quarter of a minute."""
LEAST_STEP_S = 60.0
"""Minimum time between two moments, seconds."""


@dataclass(frozen=True)
class FoundRecording:
    """One camera's files."""

    text: str
    """The text that gives the camera's name."""
    video: Path
    """A folder, a pattern or a file, as the scene file names it."""


@dataclass(frozen=True, eq=False)
class RecordingSurvey:
    """The data of a recording that are known without opening all of its files."""

    info: VideoInfo
    """Metadata of one file, with the length of all."""
    files: int
    begins: tuple[float, ...] = ()
    """Wall times at which the files begin, seconds since 1970, ascending; empty if they are unknown."""
    paths: tuple[Path, ...] = ()
    """The files in the order of `begins`; empty for images."""
    utc: bool = False
    unknown_rate: bool = False
    """Whether these are numbered images, whose frame rate is unknown."""


def find_recordings(folder: Path, look: Look, notes: list[str]) -> list[FoundRecording]:
    """Find the cameras of a folder whose videos are in pieces, or are images; none if each camera is one file.

    Beside cameras in pieces, other cameras may be one file each. Files that are left out are listed in `notes`.
    """
    files = list(islice(walk_below(folder), MOST_FILES))
    videos = [path for path in files if path.suffix.lower() in VIDEO_ENDINGS]
    if not videos:
        return _find_images([path for path in files if path.suffix.lower() in PICTURE_ENDINGS])
    videos, copies = set_aside_small_copies(videos)
    notes += companions_note(files, copies)
    return _find_frigate(folder, videos) or _find_by_folders(folder, videos, look, notes) or _find_by_names(videos, look)


def seconds_of(look: Look) -> Length:
    """Return a function that gives the duration of a video, seconds, from its metadata; None if unknown."""

    def length(path: Path) -> float | None:
        info = look(path)
        return None if info is None else info.seconds

    return length


def _find_frigate(folder: Path, videos: Sequence[Path]) -> list[FoundRecording]:
    """Find cameras by the folder below day and hour, as Frigate makes them; empty if the layout is another one."""
    cameras: dict[str, list[Path]] = {}
    for path in videos:
        resolved = path.absolute()
        time = find_usual_time(resolved) if len(resolved.parts) > 4 else None
        if time is None or not _HOUR.fullmatch(resolved.parts[-3]) or not _DAY.fullmatch(resolved.parts[-4]):
            return []
        cameras.setdefault(path.parent.name, []).append(path)
    if len(cameras) < 2:
        return []
    found = []
    for camera in sorted(cameras, key=natural_key):
        first = cameras[camera][0]
        above = first.relative_to(folder).parts[:-2]
        stars = ["*" if _DAY.fullmatch(part) or _HOUR.fullmatch(part) else escape(part) for part in above]
        found.append(FoundRecording(camera, folder.joinpath(*stars, escape(camera), f"*{first.suffix}")))
    return found


def _find_by_folders(folder: Path, videos: Sequence[Path], look: Look, notes: list[str]) -> list[FoundRecording]:
    """Find cameras with one folder each, at least one of them with pieces; empty if there are fewer than two."""
    held: dict[Path, list[Path]] = {}
    for path in videos:
        parts = path.relative_to(folder).parts
        if len(parts) > 1:
            held.setdefault(folder / parts[0], []).append(path)
    named = next((inner for inner in held if inner.name.lower() in VIDEO_FOLDERS and len(held[inner]) > 1), None)
    whole = next(iter(held)) if len(held) == 1 and len(held[next(iter(held))]) == len(videos) else named
    if whole is not None:
        told: list[str] = []
        found = _find_by_folders(whole, held[whole], look, told) or _find_by_names(held[whole], look)
        notes += told if found else []
        return found
    pieces = {inner: one for inner, paths in held.items() if (one := _pieces_in(inner, paths, look)) is not None}
    cameras = {inner: held[inner] for inner in held if inner in pieces or not _NO_CAMERA.search(inner.name)}
    if not pieces or len(cameras) < 2:
        return []
    notes += [f"left out: {path}: the cameras are assumed to be the subfolders" for path in videos if path.parent == folder]
    notes += [f"left out: the videos in {inner}: its name is not that of a camera" for inner in held if inner not in cameras]
    for inner, paths in cameras.items():
        used = paths[:1] if inner not in pieces else _choose_files(pieces[inner], paths)
        if more := [path for path in paths if path not in used]:
            notes.append(f"left out: {', '.join(path.name for path in more)} in {inner}: another recording than {used[0].name}")
    found = [pieces.get(inner) or FoundRecording(inner.name, paths[0]) for inner, paths in cameras.items()]
    return sorted(found, key=lambda one: natural_key(one.text))


def _pieces_in(inner: Path, paths: Sequence[Path], look: Look) -> FoundRecording | None:
    """Find the pieces of one recording in a camera's folder; None if it holds none."""
    if len(paths) < 2:
        return None
    if is_numbered_series(paths) or _are_timed(paths) or len(pieces_among(paths, seconds_of(look))) == len(paths):
        return FoundRecording(inner.name, inner)
    if len({path.parent for path in paths}) > 1:
        return None
    first = next(iter(find_chapters(paths, look, one_camera=not _NO_CAMERA.search(inner.name))), None)
    if first is None:
        return None
    alone = len(first.paths) == sum(path.suffix.lower() in VIDEO_ENDINGS for path in paths[0].parent.iterdir())
    return FoundRecording(inner.name, inner if alone else paths[0].parent / first.pattern)


def _choose_files(one: FoundRecording, paths: Sequence[Path]) -> list[Path]:
    return list(paths) if one.video.is_dir() else [path for path in paths if fnmatchcase(path.name, one.video.name)]


def _are_timed(paths: Sequence[Path]) -> bool:
    """Return whether all names contain different times, in several folders, such as the folders of days of recorders."""
    times = [find_usual_time(path) for path in paths]
    known = {time.seconds for time in times if time is not None}
    return len(known) == len(paths) and len({path.parent for path in paths}) > 1


def _find_by_names(videos: Sequence[Path], look: Look) -> list[FoundRecording]:
    """Find cameras whose pieces are in one folder and differ in the text before or after the time, or before the chapter."""
    if len({path.parent for path in videos}) != 1:
        return []
    place = videos[0].parent
    groups: dict[tuple[str, str, str], list[Path]] = {}
    for path in videos:
        if (span := time_in(path.stem)) is not None:
            groups.setdefault((path.stem[: span[0]], path.stem[span[1] :], path.suffix), []).append(path)
    pieces = {key: paths for key, paths in groups.items() if len(paths) > 1 and pieces_among(paths, seconds_of(look))}
    if len(pieces) > 1:
        # The pattern has a digit after the beginning, so that "gate_" does not match "gate_left_" as well.
        return [
            FoundRecording(f"{before} {behind}".strip(" _-."), place / f"{escape(before)}[12]*{escape(behind)}{suffix}")
            for before, behind, suffix in sorted(pieces, key=lambda key: natural_key("".join(key)))
        ]
    chapters = find_chapters(videos, look, one_camera=False)
    taken = {path for one in chapters for path in one.paths}
    found = [FoundRecording(one.name, place / one.pattern) for one in chapters]
    found += [FoundRecording(path.stem, path) for path in videos if path not in taken] if chapters else []
    return sorted(found, key=lambda one: natural_key(one.text)) if len(found) > 1 else []


def _find_images(pictures: Sequence[Path]) -> list[FoundRecording]:
    """Find cameras with one folder of images each; empty if there are fewer than two."""
    held: dict[Path, int] = {}
    for path in pictures:
        if not _NO_CAMERA.search(path.parent.name):
            held[path.parent] = held.get(path.parent, 0) + 1
    found = [FoundRecording(inner.name, inner) for inner, count in held.items() if count > 1]
    return sorted(found, key=lambda one: natural_key(one.text)) if len(found) > 1 else []


def survey_recording(video: Path, probe: Callable[[Path], VideoInfo]) -> RecordingSurvey:
    """Survey a camera's files. Raises `InputError` if none of them can be read."""
    files = list_files(VideoSource((video,)))
    rate = ASSUMED_FPS if files.kind == "pictures" else None
    times = times_of(VideoSource((video,), fps=rate), files)
    timed = times is not None and times.wall
    order = np.argsort(times.begin, kind="stable") if times is not None and timed else np.zeros(0, dtype=np.int64)
    begins = () if times is None else tuple(times.begin[order].tolist())
    paths = tuple(files.paths[number] for number in order) if files.kind == "videos" else ()
    unknown = times is not None and times.numbered
    if files.kind == "pictures":
        info = open_source(VideoSource((video,), fps=rate)).info
        return RecordingSurvey(
            replace(info, seconds=None) if unknown else info, len(files.paths), begins, (), _utc(times), unknown
        )
    info = _probe_first_readable(files.paths, probe)
    length = info.seconds or 0.0
    seconds = begins[-1] - begins[0] + length if begins else length * len(files.paths)
    return RecordingSurvey(replace(info, seconds=seconds or None), len(files.paths), begins, paths, _utc(times))


def _utc(times: object) -> bool:
    return bool(getattr(times, "utc", False))


def _probe_first_readable(paths: Sequence[Path], probe: Callable[[Path], VideoInfo]) -> VideoInfo:
    """Read the metadata of a file in the middle, or of the next readable one.

    The first file may have been cut, and the last one may still be written.
    """
    middle = len(paths) // 2
    tried = [*paths[middle : middle + 5], *paths[:3]]
    for path in tried[:-1]:
        try:
            return probe(path)
        except InputError:
            continue
    return probe(tried[-1])


@dataclass(frozen=True)
class ProposedSpan:
    """A span of wall time that `init` proposes."""

    first: str
    last: str
    why: str


def propose_span(surveys: Sequence[RecordingSurvey]) -> ProposedSpan | None:
    """Propose the quarter of an hour with most people, by a few key frames, that all cameras have.

    It is the last quarter of an hour if no person is seen.

    None if the recordings are shorter than twice this span, or if no times are known.
    """
    if not surveys or not all(len(survey.begins) > 1 for survey in surveys):
        return None
    begins = [np.array(survey.begins) for survey in surveys]
    whole = max(times[-1] for times in begins) - min(times[0] for times in begins)
    if whole < 2 * PROPOSED_S:
        return None
    ends = (
        60.0
        * np.arange(
            np.ceil(min(times[-1] for times in begins) / 60.0) + 1, np.floor(max(times[0] for times in begins) / 60.0), -1
        )[:MOST_ENDS]
    )
    if not len(ends):
        return None
    counts = np.array([np.searchsorted(times, ends) - np.searchsorted(times, ends - PROPOSED_S) for times in begins])
    full = (counts > 0).all(axis=0) & (counts >= FULL * counts.max(axis=1, keepdims=True)).all(axis=0)
    if not full.any():
        return None
    cameras = [(survey.paths, survey.begins) for survey in surveys if survey.paths]
    look = look_at(cameras, min(times[0] for times in begins), max(times[-1] for times in begins))
    candidates = ends[full]
    means = np.array([look.mean_in(end - PROPOSED_S, end) for end in candidates])
    # Of equal means, the latest end is taken.
    end = float(candidates[np.argmax(means)])
    first, last = (WallTime(time, False).text.replace("T", " ") for time in (end - PROPOSED_S, end))
    long = f"the recordings last {whole / 3600.0:.1f} hours"
    if means.max() > 0:
        why = (
            f"{long}: in these {PROPOSED_S / 60:.0f} minutes a quick look at {len(look.people)} images saw most people, "
            f"{means.max():.1f} in an image, and {look.people.mean():.1f} over all of them"
        )
    else:
        seen = (
            f"a quick look at {len(look.people)} images saw no person"
            if len(look.people)
            else "too few images can be looked at"
        )
        why = (
            f"{long}: the last {PROPOSED_S / 60:.0f} minutes that all cameras have are proposed; {seen}: choose a time with "
            "many people"
        )
    return ProposedSpan(first, last, why)


@dataclass(frozen=True, eq=False)
class Glance:
    """Counts of people at moments of recordings."""

    seconds: Floats
    """(N,) times of the pictures that could be read, of all cameras, seconds since 1970, ascending."""
    people: Floats
    """(N,) number of people in each picture."""

    def mean_in(self, first: float, last: float) -> float:
        """Compute the mean number of people in the pictures within a span; 0 if there are no pictures."""
        inside = (self.seconds >= first) & (self.seconds <= last)
        return float(self.people[inside].mean()) if inside.any() else 0.0


def look_at(cameras: Sequence[tuple[Sequence[Path], Sequence[float]]], first: float, last: float) -> Glance:
    """Count people in key frames at even steps of a span.

    Args:
        cameras: the files of each camera, and the times at which they begin, seconds since 1970, ascending. Only the first
            `MOST_CAMERAS` are examined.
        first: beginning of the span, seconds since 1970.
        last: end of the span, seconds since 1970.
    """
    step = max((last - first) / MOST_MOMENTS, LEAST_STEP_S)
    moments = np.arange(first + step / 2, last, step)
    seconds: list[float] = []
    people: list[float] = []
    for paths, begins in cameras[:MOST_CAMERAS]:
        frames = _key_frames(paths, np.asarray(begins), moments, first)
        try:
            detector = learn_from_looks(frames, step)
            people += [] if detector is None else [float(len(detector(frame).score)) for frame in frames]
        except InputError:
            continue
        seconds += [] if detector is None else [first + frame.seconds for frame in frames]
    order = np.argsort(seconds, kind="stable")
    return Glance(np.array(seconds)[order], np.array(people)[order])


def _key_frames(paths: Sequence[Path], begins: Floats, moments: Floats, zero: float) -> list[Frame]:
    """Read a key frame for each moment, from the last file that begins before it.

    Frames that cannot be read, or were taken before, are left out.
    """
    frames: list[Frame] = []
    taken: set[tuple[int, float]] = set()
    for moment in moments.tolist():
        number = int(np.searchsorted(begins, moment, side="right")) - 1
        if number < 0:
            continue
        try:
            found = key_picture(paths[number], moment - float(begins[number]))
        except InputError:
            continue
        if found is None or (number, found[0]) in taken:
            continue
        taken.add((number, found[0]))
        picture = found[1]
        if not frames or picture.shape == frames[0].picture.shape:
            frames.append(Frame(len(frames) + 1, moment - zero, picture))
    return frames
