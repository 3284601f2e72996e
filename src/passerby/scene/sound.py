"""The clock offsets of a scene's cameras by the sound of their videos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from passerby.association.clocks.starts import SOUND, MeasuredStart
from passerby.findings.finding import Finding, notice
from passerby.perception.sound import Onsets, has_sound, listen, offset_by_sound
from passerby.perception.video import VideoInfo
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

SAME_RATE = 1e-4
"""A video whose frames are said to come at another rate than its own has another clock than its sound."""


def measure_by_sound(scene: Scene, readings: Sequence[CameraInput]) -> tuple[tuple[MeasuredStart, ...], tuple[Finding, ...]]:
    """What the sound of every two cameras' videos tells of their clocks, and what is odd about it.

    Nothing is listened to where no clock offsets are searched for, or the scene wants none of it. Sound of one camera alone is
    passed over in silence.
    """
    heard: dict[str, Onsets] = {}
    deaf: dict[str, str] = {}
    for name, video in _videos_to_hear(scene, readings):
        found = listen(video)
        if isinstance(found, Onsets):
            heard[name] = found
        elif found is not None:
            deaf[name] = found
    if len(heard) + len(deaf) < 2:
        return (), ()
    measured, findings = [], [notice("sound_unusable", name, why=why) for name, why in deaf.items()]
    for first, second in combinations(heard, 2):
        offset = offset_by_sound(heard[first], heard[second])
        if offset is not None:
            measured.append(MeasuredStart((first, second), -offset.lag_s, offset.sigma_s, SOUND))
            values = {"offset_s": -offset.lag_s, "sigma_s": offset.sigma_s, "significance": offset.significance}
            findings.append(notice("offset_by_sound", second, first, **values))
    return tuple(measured), tuple(findings)


def sound_to_hear(scene: Scene, readings: Sequence[CameraInput]) -> tuple[Finding, ...]:
    """What a calibration will listen to, in one notice; nothing is decoded."""
    names = [name for name, video in _videos_to_hear(scene, readings) if has_sound(video)]
    return (notice("sound_unheard", *names, place=str(scene.place)),) if len(names) > 1 else ()


def _videos_to_hear(scene: Scene, readings: Sequence[CameraInput]) -> Iterator[tuple[str, VideoInfo]]:
    """The videos whose sound, where they have any, tells something about the scene's clocks, by camera."""
    if scene.association.sound == "off" or scene.association.search_s <= 0:
        return
    for reading in readings:
        video = reading.video
        if video is None or reading.faults or reading.fps is None or video.frame_times:
            continue
        if abs(video.clock_fps / reading.fps - 1) > SAME_RATE:
            continue
        yield reading.name, video
