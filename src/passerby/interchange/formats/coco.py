"""COCO JSON: annotations (`images`, `annotations`, `categories`) or a detector's results (a list), with boxes, joints or both.

    {"images": [{"id": 1, "file_name": "cam1_000012.jpg"}], "categories": [{"id": 1, "name": "person", "keypoints": [...]}],
     "annotations": [{"image_id": 1, "category_id": 1, "bbox": [left, top, width, height], "keypoints": [x, y, v, ...],
                      "score": 0.9, "track_id": 3, "iscrowd": 0}]}
    [{"image_id": 12, "category_id": 1, "bbox": [...], "keypoints": [...], "score": 0.9}, ...]

The third number of a joint is a confidence. If all third numbers of a file are 0, 1 or 2, and one is 2, they are COCO's
visibilities (not labelled, hidden, visible), which become the confidences 0, 0.5 and 1. The identity is `track_id`, also below
`attributes`, as in CVAT; an annotation's `id` is no identity. An image's frame is its `frame`, else its `frame_id`, else the
number at the end of its `file_name`, else its `id`; in results it is `image_id`, a number or a name. Frame numbers stay
unchanged: COCO does not define their first number. Of several categories, people are those called person, or 1 in results;
crowds (`iscrowd`) are not people.

https://cocodataset.org/#format-data and #format-results. The origin (0, 0) of pixels is the corner of the first pixel in COCO's
documentation, and its centre in most tools: coordinates are read unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.interchange.formats.format import Format, Given, People
from passerby.interchange.formats.found_people import Found, frame_in, frames_of_names, identity_in, numbers_in, people_of
from passerby.interchange.formats.values import load_json

READ = (
    "id",
    "image_id",
    "category_id",
    "bbox",
    "keypoints",
    "num_keypoints",
    "score",
    "iscrowd",
    "area",
    "track_id",
    "attributes",
)
PERSON = 1
"""COCO's category of people."""


def read_people(path: Path, given: Given) -> People:
    """Read one camera's boxes and joints. Raises `InputError`."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder: give the JSON file in it")
    content = load_json(path, "COCO annotations or results")
    listed = content if isinstance(content, list) else content.get("annotations") if isinstance(content, dict) else None
    for annotation in listed if isinstance(listed, list) else []:
        given.unread.keys(annotation if isinstance(annotation, dict) else {}, READ)
    if isinstance(content, dict):
        given.unread.keys(content, ("images", "annotations", "categories", "info", "licenses"))
    if isinstance(content, list):
        return _read_list(path, "", content, _frames_of_results(path, content), {PERSON: None}, ())
    if not isinstance(content, dict) or not isinstance(content.get("annotations"), list):
        raise InputError(f"{path}: has neither annotations nor is it a list of results: give COCO JSON")
    frames = _frames_of_images(path, content.get("images"))
    people, notes = _categories(path, content.get("categories"))
    return _read_list(path, "annotations", content["annotations"], frames, people, notes)


def _read_list(
    path: Path,
    key: str,
    annotations: list[Any],
    frames: Mapping[int | str, int],
    people: Mapping[int, tuple[str, ...] | None],
    notes: tuple[str, ...],
) -> People:
    """Read the people of a list of annotations; `people` has the categories of people, with the names of their joints."""
    found: list[Found] = []
    used: set[int] = set()
    others = crowds = 0
    for number, annotation in enumerate(annotations):
        place = f"{path}: {key}[{number}]"
        if not isinstance(annotation, dict):
            raise InputError(f"{place}: is not an object: give COCO JSON")
        category = annotation.get("category_id", PERSON)
        if type(category) is not int or category not in people:
            others += 1
        elif annotation.get("iscrowd"):
            crowds += 1
        else:
            used.add(category)
            found.append(_read_person(place, annotation, frames))
    names = {people[category] for category in used if people[category] is not None}
    if len(names) > 1:
        raise InputError(f"{path}: several categories of people have different keypoints: keep one of them")
    made = people_of(found, str(path), names=next(iter(names), None), visibilities=True)
    left = [
        f"{count} {what} left out" for count, what in ((others, "of other categories than people"), (crowds, "crowds")) if count
    ]
    return People(made.boxes, made.keypoints, (*notes, *left, *made.notes))


def _read_person(place: str, annotation: dict[str, Any], frames: Mapping[int | str, int]) -> Found:
    image: Any = annotation.get("image_id")
    if type(image) not in (int, str) or image not in frames:
        raise InputError(f"{place}: image_id {shortened(image)} is none of the images: add the image or delete the annotation")
    attributes = annotation.get("attributes")
    track = annotation.get("track_id", attributes.get("track_id") if isinstance(attributes, dict) else None)
    box, joints = annotation.get("bbox"), annotation.get("keypoints")
    (score,) = numbers_in([annotation.get("score", 1.0)], f"{place}: score")
    return Found(
        frames[image],
        identity_in(track, f"{place}: track_id"),
        float(score),
        None if not box else numbers_in(box, f"{place}: bbox", 4),
        None if not joints else numbers_in(joints, f"{place}: keypoints"),
    )


def _frames_of_results(path: Path, results: list[Any]) -> Mapping[int | str, int]:
    """Return the frame of each image_id of a list of results."""
    images = [result.get("image_id") for result in results if isinstance(result, dict)]
    names = [image for image in images if isinstance(image, str)]
    if names and len(names) != len(images):
        raise InputError(f"{path}: some image_id are names and others numbers: give one recording")
    if names:
        by_name = frames_of_names(names, str(path))
        return {name: by_name[name] for name in names}
    frames = [frame_in(image, f"{path}: image_id") for image in images if image is not None]
    return {frame: frame for frame in frames}


def _frames_of_images(path: Path, images: Any) -> Mapping[int | str, int]:
    """Return the frame of each image's id."""
    if not isinstance(images, list):
        raise InputError(f"{path}: images is missing or not a list: COCO annotations have images")
    for number, image in enumerate(images):
        if not isinstance(image, dict) or type(image.get("id")) not in (int, str):
            raise InputError(f"{path}: images[{number}]: needs an `id`")
    key = next((key for key in ("frame", "frame_id", "file_name", "id") if any(key in image for image in images)), "id")
    if key == "file_name":
        named = [image.get("file_name") for image in images]
        if not all(isinstance(name, str) for name in named):
            raise InputError(f"{path}: some images have a file_name and others none: give all their `frame`")
        by_name = frames_of_names(named, f"{path}: images")
    frames: dict[int | str, int] = {}
    image_of: dict[int, int | str] = {}
    for number, image in enumerate(images):
        identifier = image["id"]
        frame = by_name[image["file_name"]] if key == "file_name" else image.get(key)
        frame = frame_in(frame, f"{path}: images[{number}]: {key}")
        if identifier in frames:
            raise InputError(f"{path}: images[{number}]: image id {shortened(identifier)} occurs twice: image ids must differ")
        if frame in image_of:
            raise InputError(
                f"{path}: images[{number}]: frame {frame} is that of image {shortened(image_of[frame])} too: give one "
                "camera's recording"
            )
        frames[identifier], image_of[frame] = frame, identifier
    return frames


def _categories(path: Path, categories: Any) -> tuple[Mapping[int, tuple[str, ...] | None], tuple[str, ...]]:
    """Return the categories of people with their joints' names (None if not stated), and notes on irregularities."""
    if categories is None or categories == []:
        return {PERSON: None}, ()
    if not isinstance(categories, list):
        raise InputError(f"{path}: categories is not a list: COCO annotations have a list of categories")
    found: dict[int, tuple[str, ...] | None] = {}
    people = set()
    for number, category in enumerate(categories):
        if not isinstance(category, dict) or type(category.get("id")) is not int:
            raise InputError(f"{path}: categories[{number}]: needs a whole number `id`")
        found[category["id"]] = _joint_names(f"{path}: categories[{number}]", category.get("keypoints"))
        if str(category.get("name", "")).casefold() in ("person", "people", "pedestrian", "human"):
            people.add(category["id"])
    if people:
        return {identifier: found[identifier] for identifier in people}, ()
    if len(found) == 1:
        return found, (f"the only category, {shortened(categories[0].get('name'))}, is assumed to be people",)
    raise InputError(f"{path}: none of the categories is called person: call that of people so")


def _joint_names(place: str, names: Any) -> tuple[str, ...] | None:
    """Convert names of joints to lower case with `_`: `left_eye` for `Left Eye`. None if there are none."""
    if not names:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
        raise InputError(f"{place}: keypoints must be a list of keypoint names")
    plain = tuple("_".join(name.casefold().replace("-", " ").replace("_", " ").split()) for name in names)
    if len(set(plain)) != len(plain):
        raise InputError(f"{place}: a keypoint occurs twice among the keypoints: keypoint names must differ")
    return plain


FORMAT = Format(
    name="coco",
    title="Boxes and keypoints of people as COCO annotations or results (JSON)",
    tools=("MMPose", "Detectron2", "CVAT", "Label Studio", "pycocotools"),
    target="file",
    suffixes=(".json",),
    conventions=(
        "Read only, one camera's file. Boxes are left, top, width, height; keypoints x, y and a confidence or COCO's "
        "visibility. The identity is track_id (also below attributes), never an annotation's id. An image's frame is its "
        "frame, else frame_id, else the number at the end of file_name, else its id; in a list of results it is image_id. "
        "Categories other than person, and crowds, are left out with a note."
    ),
    read_people=read_people,
)
