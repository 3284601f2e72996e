"""AlphaPose's `alphapose-results.json`: a list of all people in all pictures.

    [{"image_id": "12.jpg", "category_id": 1, "keypoints": [x, y, confidence, ...], "score": 2.9, "box": [left, top, width,
      height], "idx": 3}, ...]

Joints: COCO's 17, Halpe's 26 or 136, COCO-WholeBody's 133. `score` is of the whole person (the confidence of the box, plus the
mean and 1.25 times the largest of the joints' confidences: up to about 3). `idx` is the track: a number, or a list after the
suppression of duplicates; without a tracker it is 0 for all people. The frame is the number at the end of the picture's name.
AlphaPose names the pictures of a video `0.jpg`, `1.jpg`, ..., and Passerby counts from 1: numbers without leading zeros, if the
names have no other text, are raised by one. Other numbers stay. Pictures without people are not in the file.

Source: AlphaPose's documentation, `docs/output.md`, and its `write_json`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.interchange.formats.format import Format, Given, People
from passerby.interchange.formats.found_people import Found, frame_in, frames_of_names, identity_in, numbers_in, people_of
from passerby.interchange.formats.values import load_json

READ = ("image_id", "category_id", "keypoints", "score", "box", "bbox", "idx")
_OF_A_VIDEO = re.compile(r"(0|[1-9]\d*)\.jpg")


def read_people(path: Path, given: Given) -> People:
    """Read one camera's joints and boxes. Raises `InputError`."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder: give the file alphapose-results.json in it")
    content = load_json(path, "AlphaPose's results")
    if isinstance(content, dict):
        raise InputError(
            f"{path}: is not a list of people: if it was made with `--format open`, give the folder sep-json beside it with "
            "--format openpose; COCO annotations are --format coco"
        )
    if not isinstance(content, list):
        raise InputError(f"{path}: is not a list of people: give alphapose-results.json")
    people = [_check_entry(f"{path}: [{number}]", person) for number, person in enumerate(content)]
    for person in people:
        given.unread.keys(person, READ)
    images = [person["image_id"] for person in people]
    video = all(isinstance(image, str) and _OF_A_VIDEO.fullmatch(image) for image in images)
    frames = _frames(path, images)
    found = [
        _read_person(f"{path}: [{number}]", person, frames[person["image_id"]] + video) for number, person in enumerate(people)
    ]
    return people_of(found, str(path), raised=video)


def _check_entry(place: str, person: Any) -> dict[str, Any]:
    if not isinstance(person, dict) or "keypoints" not in person:
        raise InputError(f"{place}: has no keypoints: give AlphaPose's results")
    if type(person.get("image_id")) not in (str, int):
        raise InputError(f"{place}: image_id is {shortened(person.get('image_id'))}: the image's name or number is needed")
    return person


def _frames(path: Path, images: list[str | int]) -> dict[str | int, int]:
    """Return the frame of each image id: the number in a name, or a number itself."""
    names = [image for image in images if isinstance(image, str)]
    if len(names) not in (0, len(images)):
        raise InputError(f"{path}: some image_id are names and others numbers: give one recording")
    if not names:
        return {image: frame_in(image, f"{path}: image_id") for image in images}
    by_name = frames_of_names(names, str(path))
    return {name: by_name[name] for name in names}


def _read_person(place: str, person: dict[str, Any], frame: int) -> Found:
    box = person.get("box", person.get("bbox"))
    (score,) = numbers_in([person.get("score", 1.0)], f"{place}: score")
    return Found(
        frame,
        identity_in(person.get("idx"), f"{place}: idx"),
        float(score),
        None if box is None else numbers_in(box, f"{place}: box", 4),
        numbers_in(person["keypoints"], f"{place}: keypoints"),
    )


FORMAT = Format(
    name="alphapose",
    title="Keypoints and boxes of people as AlphaPose writes them (JSON)",
    tools=("AlphaPose",),
    target="file",
    suffixes=(".json",),
    conventions=(
        "Read only, one camera's file. 17 keypoints (COCO), 26 or 136 (Halpe) or 133 (COCO-WholeBody): COCO's 17 come first, "
        "head, neck, hips' middle and feet are kept after them, face and hands are not. idx becomes the identity, unless "
        "everybody has the same one. The frame is the number at the end of image_id; names such as 0.jpg are AlphaPose's own "
        "count of a video from 0 and are raised by one, since Passerby counts from 1."
    ),
    read_people=read_people,
)
