"""OpenPose's folders of JSON, one file a frame, as `--write_json` makes them; other tools write the same format.

    {"people": [{"person_id": [-1], "pose_keypoints_2d": [x, y, confidence, x, y, confidence, ...]}, ...]}

Joints: BODY_25 or BODY_25B (25), BODY_135 or COCO (18), and those of other tools: COCO's own 17, Halpe's 26 (Pose2Sim,
RTMLib) or 136, BlazePose's 33, COCO-WholeBody's 133. 25 joints are read as BODY_25; a calibration detects from the images if
they are BODY_25B. Confidence 0 is a joint that was not found. `person_id` is -1 without tracking. The frame is the
number at the end of a file's name, before `_keypoints`. OpenPose counts the frames of a video from 0, in twelve digits, and
Passerby from 1: such numbers are raised by one. The numbers in other names, as of single pictures, stay unchanged.

OpenPose's documentation, `doc/02_output.md`; pixels have (0, 0) at the first pixel's centre.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.core.observations import Keypoints
from passerby.interchange.formats.format import Format, Given, People, Unread
from passerby.interchange.formats.found_people import Found, frames_of_names, identity_in, numbers_in, people_of
from passerby.interchange.formats.values import load_json

ENDING = "_keypoints"
_OF_A_VIDEO = re.compile(r"(?:^|.*\D)\d{12}" + ENDING)
SCALED = 1.0
"""Largest coordinate with `--keypoint_scale 3` and `4`. Coordinates in pixels are larger."""


def read_people(path: Path, given: Given) -> People:
    """Read one camera's joints. A file without people is a picture without people. Raises `InputError`."""
    if not path.is_dir():
        raise InputError(f"{path}: is a file: give the folder of --write_json, which has one file per frame")
    files = sorted(file for file in path.iterdir() if file.suffix.lower() == ".json" and not file.name.startswith("."))
    if not files:
        raise InputError(f"{path}: holds no JSON file: give the folder of --write_json, which has one file per frame")
    video = all(_OF_A_VIDEO.fullmatch(file.stem) for file in files)
    found = [one for file, frame in _frames(path, files).items() for one in _people(file, frame + video, given.unread)]
    people = people_of(found, str(path), raised=video)
    _check_pixels(path, people.keypoints)
    return people


def _frames(path: Path, files: list[Path]) -> Mapping[Path, int]:
    """Return the frame number of each file."""
    names = {file: f"{file.stem.removesuffix(ENDING)}.json" for file in files}
    frames = frames_of_names(names.values(), str(path))
    return {file: frames[name] for file, name in names.items()}


def _people(file: Path, frame: int, unread: Unread) -> list[Found]:
    """Read all people in one file."""
    content = load_json(file, "a frame of OpenPose")
    people = content.get("people") if isinstance(content, dict) else None
    if not isinstance(people, list):
        raise InputError(f"{file}: has no list `people`: is it another kind of file? Move it out of the folder")
    unread.keys(content, ("people", "version"))
    found = []
    for number, person in enumerate(people):
        place = f"{file}: people[{number}]"
        if not isinstance(person, dict) or "pose_keypoints_2d" not in person:
            raise InputError(f"{place}: has no pose_keypoints_2d: run OpenPose with body keypoints")
        joints = numbers_in(person["pose_keypoints_2d"], f"{place}: pose_keypoints_2d")
        if not len(joints):  # only a face or a hand was found
            continue
        unread.keys(person, ("pose_keypoints_2d", "person_id"))
        identity = identity_in(person.get("person_id"), f"{place}: person_id")
        found.append(Found(frame, identity, float(np.nansum(joints[2::3])), joints=joints))
    return found


def _check_pixels(path: Path, keypoints: Keypoints) -> None:
    """Check that coordinates are pixels. Raises `InputError`."""
    found = np.abs(keypoints.xy[keypoints.score > 0])
    if found.size and found.max() <= SCALED:
        raise InputError(
            f"{path}: no coordinate is above {found.max():.3g}: run OpenPose with --keypoint_scale 0, which gives pixels"
        )


FORMAT = Format(
    name="openpose",
    title="Keypoints of people as OpenPose writes them, one JSON file per frame",
    tools=("OpenPose", "RTMLib", "Pose2Sim", "Sports2D"),
    target="folder",
    conventions=(
        "Read only, one camera's folder. BODY_25, BODY_25B, BODY_135 or COCO (18 keypoints), also COCO's 17, Halpe's 26 and "
        "136, BlazePose's 33 and COCO-WholeBody's 133: COCO's 17 come first, neck, hips' middle, head and feet are kept after "
        "them, face and hands are not. Confidence 0 is a keypoint that was not found. The frame is the number at the end of a "
        "file's name; twelve digits before _keypoints are OpenPose's own count of a video from 0 and are raised by one, since "
        "Passerby counts from 1."
    ),
    read_people=read_people,
)
