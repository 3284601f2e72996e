"""What the cameras' own clocks say of their clock offsets, by the creation times and timecodes of their video files.

They are a first guess: cameras' clocks are set by hand, copies and exports have other times, a timecode may count recorded
frames, and some makers state the end of a recording. So they are used only where they say that the recordings begin farther
apart than is searched for, and still overlap; people's tracks then decide between them and the ordinary search.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from passerby.association.clocks.starts import CREATION_TIME, MEASURED_SIGMAS, TIMECODE, MeasuredStart
from passerby.findings.finding import Finding, notice
from passerby.perception.video_clock import DAY_S
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

LEAST_OVERLAP = 0.2
"""Of the shorter of two recordings. People who are in both views for less of it are few; as for videos that are cut short."""


@dataclass(frozen=True)
class _Recording:
    begin_s: float
    seconds: float | None


def measure_by_file_clocks(scene: Scene, readings: Sequence[CameraInput]) -> tuple[MeasuredStart, ...]:
    """The differences of two recordings' starts by their files' clocks; none where the ordinary search covers them all."""
    search_s = scene.association.search_s
    measured = []
    for kind, begins in _clocks(scene, readings):
        pairs = [(pair, _later(begins, pair, kind)) for pair in combinations(begins, 2)]
        if search_s <= 0 or all(abs(later) <= search_s for _, later in pairs):
            continue
        sigma_s = search_s / MEASURED_SIGMAS
        for (first, second), later in pairs:
            told = [later]
            if kind == CREATION_TIME:
                # Where the times are those of the ends.
                told.append(later - _length(begins[second]) + _length(begins[first]))
            told = told if abs(told[0] - told[-1]) > search_s else told[:1]
            measured += [
                MeasuredStart((first, second), one, sigma_s, kind)
                for one in told
                if _overlap(begins[first], begins[second], one)
            ]
    return tuple(measured)


def file_clock_findings(scene: Scene, readings: Sequence[CameraInput]) -> list[Finding]:
    """A notice of recordings that begin farther apart, by their files' clocks, than is searched for."""
    search_s = scene.association.search_s
    measured = measure_by_file_clocks(scene, readings)
    found: list[Finding] = []
    for kind, begins in _clocks(scene, readings):
        first, *others = begins
        later = {name: _later(begins, (first, name), kind) for name in others}
        if search_s <= 0 or all(abs(_later(begins, pair, kind)) <= search_s for pair in combinations(begins, 2)):
            continue
        if found and _are_alike(found[0].values["later_s"], later, search_s):
            continue
        used = any(one.found_by == kind for one in measured)
        most_s = max(abs(_later(begins, pair, kind)) for pair in combinations(begins, 2))
        code = "file_clocks_differ" if used else "file_clocks_unused"
        values = {"found_by": kind, "later_s": later, "search_s": search_s, "most_s": most_s + search_s}
        found.append(notice(code, first, *others, place=str(scene.place), **values))
    return found


def _are_alike(one: Mapping[str, float], other: Mapping[str, float], within_s: float) -> bool:
    return one.keys() == other.keys() and all(abs(one[name] - other[name]) <= within_s for name in one)


def _clocks(scene: Scene, readings: Sequence[CameraInput]) -> list[tuple[str, dict[str, _Recording]]]:
    """By kind of clock, the recordings of two cameras or more that state it; those on a wall clock by their names do not."""
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


def _later(begins: Mapping[str, _Recording], pair: tuple[str, str], kind: str) -> float:
    """How much later the second recording begins, seconds; by timecodes, which begin anew each day, at most half a day."""
    later = begins[pair[1]].begin_s - begins[pair[0]].begin_s
    return (later + DAY_S / 2) % DAY_S - DAY_S / 2 if kind == TIMECODE else later


def _overlap(first: _Recording, second: _Recording, later: float) -> bool:
    """Whether two recordings have enough time in common where the second begins so much later."""
    if first.seconds is None or second.seconds is None:
        return True
    common = min(first.seconds, later + second.seconds) - max(0.0, later)
    return common >= LEAST_OVERLAP * min(first.seconds, second.seconds)
