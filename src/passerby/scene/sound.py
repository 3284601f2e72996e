"""Time offsets between a scene's cameras by the sound of their videos."""

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
"""Maximum relative difference between the stated frame rate and the video's own: with a larger one, the frames have another
clock than the sound."""


def measure_by_sound(scene: Scene, readings: Sequence[CameraInput]) -> tuple[tuple[MeasuredStart, ...], tuple[Finding, ...]]:
    """Measure the time offsets between each two cameras by the sound of their videos, and return notices about them.

    No sound is read if no time offsets are searched, or if the scene switches sound off. If only one camera has sound, there is
    no notice.
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
    """Return one notice of the cameras whose sound a calibration will use; none is decoded."""
    names = [name for name, video in _videos_to_hear(scene, readings) if has_sound(video)]
    return (notice("sound_unheard", *names, place=str(scene.place)),) if len(names) > 1 else ()


def _videos_to_hear(scene: Scene, readings: Sequence[CameraInput]) -> Iterator[tuple[str, VideoInfo]]:
    """Yield the cameras and videos whose sound, if they have any, shows the offsets of the scene's clocks."""
    if scene.association.sound == "off" or scene.association.search_s <= 0:
        return
    for reading in readings:
        video = reading.video
        if video is None or reading.faults or reading.fps is None or video.frame_times:
            continue
        if abs(video.clock_fps / reading.fps - 1) > SAME_RATE:
            continue
        yield reading.name, video
