"""Wall times of the recordings: the span that `[scene]` chooses, and the clock offsets that file times suggest.

File times are only a first guess. Cameras' clocks are set by hand, copies and exports have other times, a timecode may count
recorded frames, and some makers state the end of a recording. So they are used only if the recordings begin, by these times,
farther apart than the search range, and still overlap. People's tracks then decide between them and the ordinary search.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, time
from itertools import combinations
from typing import TYPE_CHECKING

from passerby.common.errors import InputError
from passerby.findings.finding import Finding, notice
from passerby.perception.sources.files import VideoSource, WallSpan
from passerby.perception.sources.recording import WallExtent, rebased, wall_extent
from passerby.perception.video_camera import DAY_S
from passerby.perception.video_probe import WallTime
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

if TYPE_CHECKING:
    from passerby.association.clocks.starts import MeasuredStart

LEAST_OVERLAP = 0.2
"""Minimum overlap of two recordings, as a share of the shorter one. With less, few people are in both views. It is the same
share as for videos that are cut short."""


@dataclass(frozen=True)
class WallClock:
    """The relation of frame numbers to wall time."""

    origin: WallTime
    """Wall time of frame 1 of all recordings whose files state their wall times."""
    first: WallTime | None = None
    """The beginning of the span that is used; None if none is chosen."""
    last: WallTime | None = None
    """The end of this span; None if none is chosen."""
    cameras: tuple[str, ...] = ()
    """The cameras whose frames count from the origin."""


def source_of(scene: Scene, name: str, span: WallSpan | None = None) -> VideoSource | None:
    """Return the files of a camera's video; None if it has none."""
    table = scene.cameras[name]
    if not table.videos:
        return None
    paths = tuple(map(scene.resolve, table.videos))
    times = None if table.video_times is None else scene.resolve(table.video_times)
    return VideoSource(paths, table.video_names, times, scene.fps_of(name), span, rotate=table.rotate)


def choose_span(scene: Scene) -> WallSpan | None:
    """Return the span of wall time that the scene chooses; None if it chooses none.

    Raises `InputError` if no wall times are known, or if a time of day occurs on no day of the recordings, or on several.
    """
    first, last = scene.scene.from_, scene.scene.until
    if first is None and last is None:
        return None
    place = f"{scene.place}: [scene] {'from' if first is not None else 'until'}"
    extents = _extents(scene)
    if not extents:
        raise InputError(
            f"{place}: no camera's files tell their wall times: name pieces of recordings with times in their names, add "
            "video_names or video_times to the cameras, or use from_s and until_s of each camera"
        )
    zoned = first if first is not None else last
    if zoned is not None and zoned.tzinfo is not None and not all(extent.utc for extent in extents.values()):
        unknown = next(name for name, extent in extents.items() if not extent.utc)
        raise InputError(
            f"{place} has an offset from UTC, but the files of camera {unknown} do not tell their time zone: write the time as "
            "their names have it, without an offset"
        )
    if isinstance(zoned, datetime):
        return WallSpan(_seconds(first, -math.inf), _seconds(last, math.inf))
    return _find_span_of_day(place, first, last, extents)


def _extents(scene: Scene) -> dict[str, WallExtent]:
    """Return the extent in wall time of each camera that has one. Faults of the other cameras' files are reported later."""
    out = {}
    for name in scene.cameras:
        source = source_of(scene, name)
        try:
            extent = None if source is None else wall_extent(source)
        except InputError:
            continue
        if extent is not None:
            out[name] = extent
    return out


def _seconds(moment: datetime | time | None, otherwise: float) -> float:
    if not isinstance(moment, datetime):
        return otherwise
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()


def _find_span_of_day(
    place: str, first: datetime | time | None, last: datetime | time | None, extents: Mapping[str, WallExtent]
) -> WallSpan:
    """Return the span of times of day on the only day of the recordings that has it."""
    begins = sorted(begin for extent in extents.values() for begin in extent.begins)
    zone = next((moment.tzinfo for moment in (first, last) if moment is not None and moment.tzinfo is not None), UTC)
    days = sorted({datetime.fromtimestamp(begin, zone).date() for begin in begins})
    spans = {day: WallSpan(_read_time_on(day, first, -math.inf), _read_time_on(day, last, math.inf)) for day in days}
    found = [day for day, span in spans.items() if any(_may_contain(extent, span) for extent in extents.values())]
    told = " to ".join(WallTime(end, all(one.utc for one in extents.values())).text for end in (begins[0], begins[-1]))
    if not found:
        raise InputError(f"{place}: the recordings show nothing of that time: their files begin from {told}")
    if len(found) > 1:
        raise InputError(
            f"{place}: {len(found)} days of the recordings have this time ({found[0]} to {found[-1]}): write the date too, as "
            f'"{found[-1]} 08:00"'
        )
    return spans[found[0]]


def _read_time_on(day: date, moment: datetime | time | None, otherwise: float) -> float:
    return otherwise if not isinstance(moment, time) else _seconds(datetime.combine(day, moment, moment.tzinfo), otherwise)


def _may_contain(extent: WallExtent, span: WallSpan) -> bool:
    """Return whether a file begins in a span, or whether the last file before the span may reach into it."""
    inside = any(span.first <= begin <= span.last for begin in extent.begins)
    before = [begin for begin in extent.begins if begin < span.first]
    usual = (extent.begins[-1] - extent.begins[0]) / max(1, len(extent.begins) - 1)
    return inside or (bool(before) and span.first - before[-1] <= usual)


def align_wall_clocks(scene: Scene, readings: Sequence[CameraInput]) -> None:
    """Make the frame numbers of all recordings with known wall times count from one origin: the first second of the earliest.

    Cameras whose people come from files keep the frame numbers of these files. A notice names the cameras without wall times
    if others have them. It is a fault if some times are in UTC and others are in an unknown time zone.
    """
    timed = {
        reading.name: (reading.video, reading.video.wall)
        for reading in readings
        if reading.video is not None and reading.video.wall is not None and scene.cameras[reading.name].watched
    }
    if not timed:
        return
    utc = {name: wall.utc for name, (_, wall) in timed.items()}
    if len(set(utc.values())) > 1:
        (known, unknown) = (next(name for name, one in utc.items() if one is which) for which in (True, False))
        reading = next(reading for reading in readings if reading.name == unknown)
        reading.faults.append(
            f"{scene.place}: [cameras.{unknown}]: its files' names do not tell their time zone, those of camera {known} are "
            "in UTC: state a pattern with %z or a table with offsets from UTC (video_names, video_times)"
        )
        return
    origin = math.floor(min(wall.seconds + video.begin_s for video, wall in timed.values()))
    for reading in readings:
        if reading.name in timed:
            reading.video = rebased(timed[reading.name][0], float(origin))
    others = [reading.name for reading in readings if reading.name not in timed and not reading.faults]
    if others:
        text = WallTime(float(origin), all(utc.values())).text
        first = next(reading for reading in readings if reading.name == others[0])
        first.findings.append(notice("wall_clock_missing", *others, place=scene.place, origin=text))


def wall_clock_of(scene: Scene, readings: Sequence[CameraInput]) -> WallClock | None:
    """Return the wall time from which frames count; None if no wall times are used."""
    timed = [
        one for one in readings if one.video is not None and one.video.wall is not None and scene.cameras[one.name].watched
    ]
    for reading in timed:
        video = reading.video
        assert video is not None
        assert video.wall is not None
        ends = (video.wall.seconds + end for end in video.used)
        first, last = (WallTime(end, video.wall.utc) if math.isfinite(end) else None for end in ends)
        return WallClock(video.wall, first, last, tuple(one.name for one in timed))
    return None


@dataclass(frozen=True)
class _Recording:
    begin_s: float
    seconds: float | None


def measure_by_file_clocks(scene: Scene, readings: Sequence[CameraInput]) -> tuple[MeasuredStart, ...]:
    """Measure the differences of recordings' starts by their files' clocks; none if the ordinary search covers all of them."""
    from passerby.association.clocks.starts import (
        CREATION_TIME,
        MEASURED_SIGMAS,
        MeasuredStart,
    )  # loads SciPy, which the page's first pictures do not need

    search_s = scene.association.search_s
    measured = []
    for kind, begins in _clocks(scene, readings):
        pairs = [(pair, _measure_delay(begins, pair, kind)) for pair in combinations(begins, 2)]
        if search_s <= 0 or all(abs(later) <= search_s for _, later in pairs):
            continue
        sigma_s = search_s / MEASURED_SIGMAS
        for (first, second), later in pairs:
            told = [later]
            if kind == CREATION_TIME:
                # The difference if the creation times are those of the ends of the recordings.
                told.append(later - _length(begins[second]) + _length(begins[first]))
            told = told if abs(told[0] - told[-1]) > search_s else told[:1]
            measured += [
                MeasuredStart((first, second), one, sigma_s, kind)
                for one in told
                if _overlap(begins[first], begins[second], one)
            ]
    return tuple(measured)


def file_clock_findings(scene: Scene, readings: Sequence[CameraInput]) -> list[Finding]:
    """Return a notice for recordings that begin, by their files' clocks, farther apart than the search range."""
    search_s = scene.association.search_s
    measured = measure_by_file_clocks(scene, readings)
    found: list[Finding] = []
    for kind, begins in _clocks(scene, readings):
        first, *others = begins
        later = {name: _measure_delay(begins, (first, name), kind) for name in others}
        if search_s <= 0 or all(abs(_measure_delay(begins, pair, kind)) <= search_s for pair in combinations(begins, 2)):
            continue
        if found and _are_alike(found[0].values["later_s"], later, search_s):
            continue
        used = any(one.found_by == kind for one in measured)
        most_s = max(abs(_measure_delay(begins, pair, kind)) for pair in combinations(begins, 2))
        code = "file_clocks_differ" if used else "file_clocks_unused"
        values = {"found_by": kind, "later_s": later, "search_s": search_s, "most_s": most_s + search_s}
        found.append(notice(code, first, *others, place=str(scene.place), **values))
    return found


def _are_alike(one: Mapping[str, float], other: Mapping[str, float], within_s: float) -> bool:
    return one.keys() == other.keys() and all(abs(one[name] - other[name]) <= within_s for name in one)


def _clocks(scene: Scene, readings: Sequence[CameraInput]) -> list[tuple[str, dict[str, _Recording]]]:
    """Return, by kind of clock, the recordings that state it, if two or more do; recordings with a wall time are left out."""
    from passerby.association.clocks.starts import (
        CREATION_TIME,
        TIMECODE,
    )  # loads SciPy, which the page's first pictures do not need

    videos = {
        reading.name: reading.video
        for reading in readings
        if reading.video is not None and not reading.faults and reading.video.wall is None and reading.fps is not None
    }
    stated = {
        TIMECODE: {name: (video.clock.timecode_s, video.end_s) for name, video in videos.items()},
        CREATION_TIME: {name: (video.clock.created_s, video.end_s) for name, video in videos.items()},
    }
    begins = {
        kind: {name: _Recording(begin, seconds) for name, (begin, seconds) in times.items() if begin is not None}
        for kind, times in stated.items()
    }
    return [(kind, found) for kind, found in begins.items() if len(found) > 1]


def _length(recording: _Recording) -> float:
    return recording.seconds or 0.0


def _measure_delay(begins: Mapping[str, _Recording], pair: tuple[str, str], kind: str) -> float:
    """Compute how much later the second recording begins, seconds; at most half a day by timecodes, which restart each day."""
    from passerby.association.clocks.starts import TIMECODE  # loads SciPy, which the page's first pictures do not need

    later = begins[pair[1]].begin_s - begins[pair[0]].begin_s
    return (later + DAY_S / 2) % DAY_S - DAY_S / 2 if kind == TIMECODE else later


def _overlap(first: _Recording, second: _Recording, later: float) -> bool:
    """Return whether two recordings overlap sufficiently if the second begins `later` seconds after the first."""
    if first.seconds is None or second.seconds is None:
        return True
    common = min(first.seconds, later + second.seconds) - max(0.0, later)
    return common >= LEAST_OVERLAP * min(first.seconds, second.seconds)
