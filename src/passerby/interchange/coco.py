"""COCO keypoints (JSON): the joints of people in one camera.

The frame number of an entry of `images` is its `frame`, else its `frame_id`, else the last number in its `file_name`, else its
`id`. One category names the joints (`keypoints`). Entries of `annotations` have `track_id` (the identity; absent: unknown) and
`keypoints`, three numbers a joint: x, y and either a confidence from 0 to 1 or COCO's visibility (0 not labelled, 1 hidden, 2
visible). If any third number of a file is above 1, all are visibilities; they become the confidences 0, 0.5 and 1.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.observations import UNKNOWN, Keypoints
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import FileFaults, NotParsed, parse_json, read_text

LARGEST_WHOLE = 2**53
"""Above this value, most programs that read JSON no longer distinguish whole numbers."""

HIDDEN_CONFIDENCE = 0.5
"""Confidence of a joint that an annotator placed though it was hidden."""


def read_keypoints(path: str | Path, *, doubles: bool = False) -> Keypoints:
    """Read the joints of one camera, sorted by frame and identity.

    Raises `FileFaults` (an `InputError`) that names file, annotation, value and fix for each deviation from the format above,
    for two images of one frame, and for an identity twice in one frame. With `doubles` an identity twice in one frame is no
    fault: `passerby.scene.used_rows.remove_duplicates` removes it later.
    """
    text = read_text(path, "a COCO keypoint file (JSON)")
    try:
        content = parse_json(text)
    except NotParsed as error:
        raise InputError(
            f"{path}: is not JSON ({error}): give COCO keypoints, or boxes under `tracks` or `detections`"
        ) from None
    reader = _Reader(Path(path), content, doubles)
    keypoints = reader.read()
    if keypoints is None or reader.faults:
        raise FileFaults(reader.faults)
    return keypoints


def write_keypoints(path: str | Path, keypoints: Keypoints) -> None:
    """Write joints as COCO JSON with confidences. Coordinates and confidences are rounded to three decimals."""
    frames = np.unique(keypoints.frame)
    image_of = {int(frame): number for number, frame in enumerate(frames, start=1)}
    annotations: list[dict[str, Any]] = []
    for row in np.lexsort((keypoints.identity, keypoints.frame)):
        xy, score = keypoints.xy[row], keypoints.score[row]
        found = xy[score > 0]
        annotation: dict[str, Any] = {
            "id": len(annotations) + 1,
            "image_id": image_of[int(keypoints.frame[row])],
            "category_id": 1,
            "keypoints": [round(float(value), 3) for value in np.column_stack([xy, score]).ravel()],
            "num_keypoints": len(found),
        }
        if keypoints.identity[row] != UNKNOWN:
            annotation["track_id"] = int(keypoints.identity[row])
        if len(found):
            low, high = found.min(axis=0), found.max(axis=0)
            annotation["bbox"] = [round(float(value), 3) for value in (*low, *(high - low))]
        annotations.append(annotation)
    content = {
        "images": [{"id": number, "file_name": f"{frame:06d}", "frame": frame} for frame, number in image_of.items()],
        "categories": [{"id": 1, "name": "person", "keypoints": list(keypoints.joints)}],
        "annotations": annotations,
    }
    write_text(path, json.dumps(content))


class _Reader:
    """Reader of a parsed file that gathers all faults in one pass."""

    def __init__(self, path: Path, content: Any, doubles: bool) -> None:
        self.path = path
        self.content = content
        self.doubles = doubles
        self.faults: list[str] = []

    def fault(self, place: str, what: str) -> None:
        """Add a fault: its place in the file and its description."""
        self.faults.append(f"{self.path}: {place}: {what}")

    def read(self) -> Keypoints | None:
        """Return the keypoints of the file, or None if it has faults, which are in `faults` then."""
        if not isinstance(self.content, dict):
            self.fault("top level", "an object with images, categories and annotations is needed")
            return None
        for key in ("images", "categories", "annotations"):
            if not isinstance(self.content.get(key), list):
                self.fault(key, "is missing or not a list: COCO files have images, categories and annotations")
        if self.faults:
            return None
        categories = self.categories()
        frames = self.frames()
        rows = [
            row
            for number, annotation in enumerate(self.content["annotations"])
            if (row := self.annotation(f"annotations[{number}]", annotation, categories, frames)) is not None
        ]
        used = {joints for _, _, joints, _ in rows}
        if len(used) > 1:
            self.fault("annotations", "people of several categories with different keypoints: give one category only")
        joints = next(iter(used), next(iter(categories.values()), None))
        if joints is None:
            self.fault("categories", "none names its keypoints: give the category a list `keypoints` of keypoint names")
        if self.faults or joints is None:
            return None
        table = np.array([values for *_, values in rows], dtype=np.float64).reshape(-1, len(joints), 3)
        table[..., 2] = self.confidences(table[..., 2])
        if self.faults:
            return None
        frame = np.array([row[0] for row in rows], dtype=np.int64)
        identity = np.array([row[1] for row in rows], dtype=np.int64)
        order = np.lexsort((identity, frame))
        if not self.doubles:
            self.repeats(frame, identity, table)
        return Keypoints(frame[order], identity[order], table[order, :, :2], table[order, :, 2], joints)

    def categories(self) -> dict[int, tuple[str, ...]]:
        """Return the joint names by category id. Categories without joints are left out."""
        found: dict[int, tuple[str, ...]] = {}
        for number, category in enumerate(self.content["categories"]):
            place = f"categories[{number}]"
            if not isinstance(category, dict) or not _is_whole(category.get("id")):
                self.fault(place, "needs a whole number `id`")
                continue
            names = category.get("keypoints")
            if names is None:
                continue
            if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
                self.fault(place, "keypoints must be a list of keypoint names")
            elif len(set(names)) != len(names):
                twice = next(name for name in names if names.count(name) > 1)
                self.fault(place, f"keypoint '{twice}' occurs twice among the keypoints: keypoint names must differ")
            else:
                found[category["id"]] = tuple(names)
        return found

    def frames(self) -> dict[int, int]:
        """Return the frame number by image id."""
        images = self.content["images"]
        keys = [key for key in ("frame", "frame_id") if any(isinstance(image, dict) and key in image for image in images)]
        frames: dict[int, int] = {}
        image_of: dict[int, int] = {}
        for number, image in enumerate(images):
            place = f"images[{number}]"
            if not isinstance(image, dict) or not _is_whole(image.get("id")):
                self.fault(place, "needs a whole number `id`")
                continue
            identifier: int = image["id"]
            frame: Any = image.get(keys[0]) if keys else _number_in_name(image)
            if not _is_whole(frame) or frame < 0:
                self.fault(place, f"{keys[0] if keys else 'frame'} is {shortened(frame)}: a whole number from 0 on is needed")
                continue
            if identifier in frames:
                self.fault(place, f"image id {identifier} occurs twice: image ids must differ")
            elif frame in image_of:
                self.fault(
                    place,
                    f"frame {frame} is that of image {image_of[frame]} too: give each image its own `frame`, one camera a file",
                )
            frames[identifier] = frame
            image_of[frame] = identifier
        return frames

    def annotation(
        self, place: str, annotation: Any, categories: dict[int, tuple[str, ...]], frames: dict[int, int]
    ) -> tuple[int, int, tuple[str, ...], list[float]] | None:
        """Return (frame, identity, J joint names, 3 J numbers) of an annotation; None if it has no joints or a fault."""
        if not isinstance(annotation, dict):
            self.fault(place, "is not an object")
            return None
        if "keypoints" not in annotation:
            return None
        image, category = annotation.get("image_id"), annotation.get("category_id")
        identity = annotation.get("track_id", UNKNOWN)
        values = annotation["keypoints"]
        if not _is_whole(image) or image not in frames:
            self.fault(place, f"image_id {shortened(image)} is none of the images: add the image or delete the annotation")
        elif not _is_whole(category) or category not in categories:
            self.fault(
                place, f"category_id {shortened(category)} is not a category with keypoint names: give it a list `keypoints`"
            )
        elif not _is_whole(identity) or identity < UNKNOWN:
            self.fault(place, f"track_id is {shortened(identity)}: a whole number from 0 on is needed, or none where unknown")
        elif not isinstance(values, list) or len(values) != 3 * len(categories[category]):
            count = len(values) if isinstance(values, list) else repr(values)
            joints = len(categories[category])
            self.fault(place, f"keypoints has {count} numbers; {joints} keypoints take {3 * joints} (x, y and confidence each)")
        elif not all(map(_is_finite, values)):
            wrong = next(value for value in values if not _is_finite(value))
            self.fault(
                place,
                f"keypoints holds {shortened(wrong)}: finite numbers are needed, 0, 0, 0 for a keypoint that was not found",
            )
        else:
            return frames[image], identity, categories[category], values
        return None

    def confidences(self, third: Floats) -> Floats:
        """Convert the third numbers of all joints to confidences from 0 to 1."""
        if third.size and third.max() > 1:
            wrong = third[~np.isin(third, (0, 1, 2))]
            if wrong.size:
                self.fault(
                    "annotations",
                    f"the third number of a keypoint is {wrong[0]:g}, another {third.max():g}: "
                    "give confidences from 0 to 1, or the visibilities 0, 1 and 2",
                )
            return np.asarray(np.select([third == 1, third == 2], [HIDDEN_CONFIDENCE, 1.0], 0.0))
        if third.size and third.min() < 0:
            self.fault("annotations", f"a keypoint's confidence is {third.min():g}: it must lie between 0 and 1")
        return third

    def repeats(self, frame: Any, identity: Any, table: Floats) -> None:
        """Add a fault for each person who occurs twice in one frame."""
        seen: set[tuple[int, int]] = set()
        unknown: set[tuple[int, bytes]] = set()
        for when, who, values in zip(frame.tolist(), identity.tolist(), table, strict=True):
            if who == UNKNOWN:
                key = (when, values.tobytes())
                if key in unknown:
                    self.fault("annotations", f"the same keypoints occur twice in frame {when}: delete one of the two")
                unknown.add(key)
                continue
            if (when, who) in seen:
                self.fault(
                    "annotations",
                    f"identity {who} occurs twice in frame {when}: one camera sees a person once in a frame; "
                    "delete one or give it another track_id",
                )
            seen.add((when, who))


def _is_whole(value: Any) -> bool:
    return type(value) is int and abs(value) <= LARGEST_WHOLE


def _is_finite(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def _number_in_name(image: dict[str, Any]) -> int:
    """Return the last number in the picture's file name, else the image's id."""
    name = image.get("file_name")
    numbers = re.findall(r"\d+", Path(name).stem) if isinstance(name, str) else []
    return int(numbers[-1]) if numbers else int(image["id"])
