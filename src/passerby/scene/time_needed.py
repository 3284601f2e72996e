"""How long a calibration will take, roughly, from what its files say; nothing is decoded for it."""

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
"""What a frame takes to be decoded, for each million pixels; this and all below in seconds of one core. Decoding and background
subtraction: the demo's videos; networks and keypoints: about what `CROPS_PER_S` tells of small ones; boxes: five scenes of 4
to 7 cameras. Rough figures do: another computer may be twice as fast, or half."""
WATCHED_S = {True: (0.02, 0.03), False: (0.03, 0.05)}
"""What it takes to find people in an image and to describe them, and more for each million pixels: by background subtraction,
or by a network as small as YOLOX-nano."""
CROP_S = 0.03
"""The keypoints of one person."""
USED_S = 2 * STRETCH_S, 8 * STRETCH_S
"""Of a long recording: usually, and where people are few, or seldom in two cameras at once."""
BOX_S, MOST_BOXES, STARTING_S = 6e-4, 30_000, 2.0
"""The solver's time for a box, up to so many, and the start of the program."""
BOXES_OF_IMAGE = 3.0
"""That are expected in an image before it is looked at."""
OF_UNKNOWN_LENSES = 2.5
"""Unknown lenses take so many times longer."""
RANGE = 2.5
"""Shorter and longer by this factor."""


def foresee_time(scene: Scene, readings: Sequence[CameraInput], perception: Mapping[str, Any]) -> tuple[float, float] | None:
    """The shortest and the longest time that a calibration may take on this computer, seconds; None where a video's length is
    not known.

    Args:
        scene: the scene.
        readings: its cameras; faults do not matter.
        perception: what the videos would be watched with, as of `perception.plan.foresee`.
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
    """Of one video, by one core."""
    megapixels = math.prod(info.size) / 1e6
    of_image, of_megapixel = WATCHED_S[perception.get("detector") == BACKGROUND]
    crops = 0.0 if perception.get("keypoints", NONE) == NONE else CROPS_AT_LEAST + CROPS_PER_S * seconds
    decoded = seconds * info.average_fps * megapixels * DECODED_S
    return decoded + pictures * (of_image + of_megapixel * megapixels) + crops * CROP_S


def _is_unknown(reading: CameraInput) -> bool:
    """Whether nothing is known of a camera's lens."""
    lens = reading.lens
    return lens is not None and lens.uncalibrated
