"""Rough estimate of the time that a calibration will take, from the metadata of its files; no video is decoded for it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

from passerby.common.parallel import BYTE_S, MAX_PROCESSES, PAIR_S
from passerby.perception.plan import BACKGROUND, CROPS_AT_LEAST, CROPS_PER_S, NONE
from passerby.perception.stretches import STRETCH_S
from passerby.perception.video import VideoInfo
from passerby.scene.camera_input import CameraInput
from passerby.scene.pointing import is_pointed_at
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import picture_rate

DECODED_S = 0.005
"""Time to decode a frame, per million pixels. This and all times below are in seconds of one core. Sources: for decoding and
background subtraction, the demo's videos; for networks and keypoints, about the figures of `CROPS_PER_S` for small ones; for
boxes, five scenes of 4 to 7 cameras. Rough figures suffice: another computer may be twice as fast, or half as fast."""
WATCHED_S = {True: (0.02, 0.03), False: (0.03, 0.05)}
"""Time to detect people in an image and to compute their appearance, and additional time per million pixels. True: background
subtraction; False: a network as small as YOLOX-nano."""
CROP_S = 0.03
"""Time to detect the keypoints of one person."""
USED_S = 2 * STRETCH_S, 8 * STRETCH_S
"""Used part of a long recording: usually, and if people are few, or rarely in two cameras at once."""
BOX_S, MOST_BOXES, STARTING_S = 6e-4, 30_000, 2.0
"""The solver's time per box, the number of boxes above which it stays constant, and the start of the program."""
BOXES_OF_IMAGE = 3.0
"""Expected number of boxes in an image that has not been processed yet."""
OF_UNKNOWN_LENSES = 2.5
"""Factor of the time for unknown lenses."""
RANGE = 2.5
"""Factor between the estimate and the shortest, and the longest, time."""


def foresee_time(scene: Scene, readings: Sequence[CameraInput], perception: Mapping[str, Any]) -> tuple[float, float] | None:
    """Estimate the shortest and the longest time of a calibration on this computer, seconds.

    None if the length of a video is unknown.

    Args:
        scene: the scene.
        readings: its cameras; faults do not matter.
        perception: the models that would process the videos, as `perception.plan.foresee` returns them.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    together = min(cores, MAX_PROCESSES)
    times = [0.0, 0.0]
    boxes = [float(sum(len(one.boxes) + len(one.keypoints) for one in readings))] * 2
    filmed = [one for one in readings if one.awaiting]
    usual = (math.inf, math.inf) if is_pointed_at(scene, filmed) else USED_S
    for reading in filmed:
        info = reading.video
        if info is None:
            continue
        if not info.seconds:
            return None
        for k, used_s in enumerate(usual):
            seconds = min(info.seconds, used_s)
            pictures = seconds * picture_rate(scene, reading, info, by_network=perception.get("detector") != BACKGROUND)
            times[k] += _watching_s(info, seconds, pictures, perception) / min(together, len(filmed))
            boxes[k] += BOXES_OF_IMAGE * pictures
    pairs = 0.0 if scene.association.given else len(readings) * (len(readings) - 1) / 2 * PAIR_S
    apart = (pairs + scene.size_bytes * BYTE_S) / together
    longer = OF_UNKNOWN_LENSES if any(_is_unknown(one) for one in readings) else 1.0
    shortest, longest = (
        seen + longer * (apart + min(number, MOST_BOXES) * BOX_S) for seen, number in zip(times, boxes, strict=True)
    )
    return STARTING_S + shortest / RANGE, STARTING_S + longest * RANGE


def _watching_s(info: VideoInfo, seconds: float, pictures: float, perception: Mapping[str, Any]) -> float:
    """Estimate the time to process one video with one core, seconds."""
    megapixels = math.prod(info.size) / 1e6
    of_image, of_megapixel = WATCHED_S[perception.get("detector") == BACKGROUND]
    crops = 0.0 if perception.get("keypoints", NONE) == NONE else CROPS_AT_LEAST + CROPS_PER_S * seconds
    decoded = seconds * info.average_fps * megapixels * DECODED_S
    return decoded + pictures * (of_image + of_megapixel * megapixels) + crops * CROP_S


def _is_unknown(reading: CameraInput) -> bool:
    """Return whether a camera's lens was not calibrated."""
    lens = reading.lens
    return lens is not None and lens.uncalibrated
