"""Conversion of people in other tools' files, one record each, to columns; frame numbers from file names.

The frame number is the last part of a name before its ending: `cam1_000012.jpg` is frame 12. The text before the number is the
same in all names of one recording. If it differs, the frame number may be another number, or the names may be of several
recordings; this is an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.observations import UNKNOWN, Boxes, Keypoints
from passerby.interchange.formats.format import People
from passerby.interchange.formats.skeletons import find_known_joints, list_joint_counts, ordered_joints, standard_names

VISIBILITIES = (0.0, 1.0, 2.0)
HIDDEN_CONFIDENCE = 0.5
"""Confidence of a joint that an annotator placed though it was hidden, as in `passerby.interchange.coco`."""
LARGEST = 2.0**53
"""Largest permitted number. Pictures have far smaller coordinates, and larger whole numbers of JSON are not exact in numpy."""
BEYOND = "{} keypoints per person, of the face and the hands, are left out"
RAISED = "frame numbers are those of a video counted from 0, and are raised by one"
LARGEST_FRAME = 2**53
"""Above this value, a float64, in which other tools store numbers, no longer distinguishes whole numbers."""
_LAST_NUMBER = re.compile(r"(.*?)(\d+)$", re.DOTALL)


@dataclass(frozen=True, eq=False)
class Found:
    """One person in one picture, as in the file."""

    frame: int
    identity: int = UNKNOWN
    score: float = 1.0
    box: Floats | None = None
    """(4,) left, top, width, height in pixels."""
    joints: Floats | None = None
    """(3 J,) x, y and confidence of each joint. A confidence of 0 or less, or a NaN: the joint was not found."""


@dataclass
class _Notes:
    """Notes on irregularities of a file."""

    told: list[str] = field(default_factory=list)

    def count(self, number: int, one: str, many: str) -> None:
        """Add a note if `number` is not 0: `one` if it is 1, else `many`, which has a place for the number."""
        if number:
            self.told.append(one if number == 1 else many.format(number))


def people_of(
    found: Sequence[Found],
    place: str,
    *,
    names: tuple[str, ...] | None = None,
    visibilities: bool = False,
    raised: bool = False,
) -> People:
    """Convert one camera's people to boxes and joints, sorted by frame and identity.

    Args:
        found: all people, in the file's order. All have the same joints.
        place: beginning of messages.
        names: the joints' names; None: they follow from the number of joints.
        raised: whether frame numbers were raised by one, which is reported.
        visibilities: whether third numbers that are 0, 1 and 2, one of them 2, are COCO's: not labelled, hidden, visible.

    Raises:
        InputError: an unknown number of joints, people with different numbers, or a value that is not finite.

    Confidences above 1 become 1. People without a joint, flat boxes and duplicate rows are left out. If an identity occurs
    twice in a frame, the person with the higher score keeps it. The notes report all of this.
    """
    notes = _Notes([RAISED] if raised and found else [])
    found = _keep_single_identities(found, notes)
    keypoints = _keypoints([one for one in found if one.joints is not None], place, names, visibilities, notes)
    boxes = _boxes([one for one in found if one.box is not None], place, notes)
    return People(boxes, keypoints, tuple(notes.told))


def numbers_in(values: Any, place: str, length: int | None = None) -> Floats:
    """Read the numbers (N,) of a list in a JSON file. NaN is permitted: some tools write it for joints that were not found.

    Raises `InputError` if the value is not a list of numbers, if one is infinite, and if their count is not `length`.
    """
    if not isinstance(values, list):
        raise InputError(f"{place} is {shortened(values)}: a list of numbers is needed")
    if length is not None and len(values) != length:
        raise InputError(f"{place} has {len(values)} numbers: {length} are needed")
    for value in values:
        if type(value) not in (int, float) or abs(value) > LARGEST:
            raise InputError(f"{place} holds {shortened(value)}: finite numbers are needed")
    return np.array(values, dtype=np.float64)


def identity_in(value: Any, place: str) -> int:
    """Read an identity in a JSON file: a whole number, equal numbers in nested lists, or nothing.

    Return `UNKNOWN` for a number below 0, for several different numbers, and for nothing. Raises `InputError` for other values.
    """
    several: set[int] = set()
    waiting = [value]
    while waiting:
        item = waiting.pop()
        if isinstance(item, list):
            waiting.extend(item)
        elif item is not None:
            if type(item) not in (int, float) or not abs(item) <= LARGEST or item != item // 1:
                raise InputError(f"{place} is {shortened(value)}: a whole number is needed, or nothing")
            several.add(int(item))
    return max(several.pop(), UNKNOWN) if len(several) == 1 else UNKNOWN


def frame_in(value: Any, place: str) -> int:
    """Read a frame number in a JSON file. Raises `InputError` for values that are not whole numbers from 0 on."""
    if type(value) is not int or not 0 <= value <= LARGEST:
        raise InputError(f"{place} is {shortened(value)}: a whole number from 0 on is needed")
    return value


def _keep_single_identities(found: Sequence[Found], notes: _Notes) -> list[Found]:
    """Make identities unique in each frame: the person with the highest score keeps it. If all people have the same identity,
    no tracker assigned it, and it is removed.
    """
    best: dict[tuple[int, int], int] = {}
    doubled: set[int] = set()
    for row, one in enumerate(found):
        if one.identity == UNKNOWN:
            continue
        key = one.frame, one.identity
        other = best.get(key)
        if other is None:
            best[key] = row
            continue
        better = row if one.score > found[other].score else other
        best[key] = better
        doubled.add(row + other - better)
    if doubled and len({one.identity for one in found}) == 1:
        notes.told.append(f"everybody has the identity {found[0].identity}: the people were not tracked, and have none")
        return [_drop_identity(one) for one in found]
    notes.count(
        len(doubled),
        "one identity occurs twice in a frame: the person with the lower score has none now",
        "{} times an identity occurs twice in a frame: the person with the lower score has none now",
    )
    return [_drop_identity(one) if row in doubled else one for row, one in enumerate(found)]


def _drop_identity(one: Found) -> Found:
    return Found(one.frame, UNKNOWN, one.score, one.box, one.joints)


def _keypoints(found: list[Found], place: str, names: tuple[str, ...] | None, visibilities: bool, notes: _Notes) -> Keypoints:
    """Convert the joints of people who have any."""
    rows = [one.joints for one in found if one.joints is not None]
    if not rows:
        return Keypoints.empty()
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise InputError(
            f"{place}: some people have {lengths[0]} numbers of keypoints and others {lengths[-1]}: give one recording"
        )
    names = _names(lengths[0], names, place)
    kept = ordered_joints(names)
    table = np.array(rows).reshape(len(rows), -1, 3)
    notes.count(table.shape[1] - len(names), "one keypoint per person has no name and is left out", BEYOND)
    table = table[:, [names.index(name) for name in kept]]
    lost = np.isnan(table).any(axis=2) | (np.nan_to_num(table[..., 2]) <= 0)
    table[lost] = 0.0
    score = _confidences(table[..., 2], visibilities, notes)
    frame, identity = _as_integers([one.frame for one in found]), _as_integers([one.identity for one in found])
    order = np.lexsort((identity, frame))
    order = order[(score[order] > 0).any(axis=1)]
    empty = len(found) - len(order)
    notes.count(empty, "one person without a keypoint is left out", "{} people without a keypoint are left out")
    order = _drop_repeated(order, np.column_stack([frame, identity, table.reshape(len(table), -1)]), "people", notes)
    return Keypoints(frame[order], identity[order], table[order, :, :2], score[order], kept)


def _names(length: int, given: tuple[str, ...] | None, place: str) -> tuple[str, ...]:
    """Return the joints' names for `length` numbers a person. Raises `InputError`."""
    names = find_known_joints(length // 3) if given is None else standard_names(given)
    if given is not None and length != 3 * len(given):
        raise InputError(f"{place}: keypoints have {length} numbers, but the category has {len(given)} keypoints of 3 each")
    if names is None or length % 3:
        raise InputError(
            f"{place}: {length} numbers per person (x, y and confidence of each keypoint): keypoints are {list_joint_counts()}"
        )
    return names


def _confidences(third: Floats, visibilities: bool, notes: _Notes) -> Floats:
    """Convert the third numbers (N, J) of joints to confidences from 0 to 1."""
    if visibilities and third.size and third.max() == 2 and np.isin(third, VISIBILITIES).all():
        return np.asarray(np.select([third == 1, third == 2], [HIDDEN_CONFIDENCE, 1.0], 0.0))
    above = int(np.count_nonzero(third > 1))
    most = float(third.max(initial=0.0))
    notes.count(
        above,
        f"one keypoint has the confidence {most:.3g}: it becomes 1",
        f"{{}} keypoints have confidences up to {most:.3g}: they become 1",
    )
    return np.minimum(third, 1.0)


def _boxes(found: list[Found], place: str, notes: _Notes) -> Boxes:
    """Convert the boxes of people who have one."""
    if not found:
        return Boxes.empty()
    ltwh = np.array([one.box for one in found])
    score = np.array([one.score for one in found], dtype=np.float64)
    broken = np.flatnonzero(~np.isfinite(ltwh).all(axis=1) | ~np.isfinite(score))
    if len(broken):
        one = found[int(broken[0])]
        raise InputError(
            f"{place}: a box of frame {one.frame} is {ltwh[broken[0]].tolist()}, score {one.score}: not finite numbers"
        )
    frame, identity = _as_integers([one.frame for one in found]), _as_integers([one.identity for one in found])
    order = np.lexsort((identity, frame))
    order = order[(ltwh[order, 2:] > 0).all(axis=1)]
    notes.count(len(found) - len(order), "one flat box is left out", "{} flat boxes are left out")
    order = _drop_repeated(order, np.column_stack([frame, identity, ltwh, score]), "boxes", notes)
    return Boxes(frame[order], identity[order], ltwh[order], score[order])


def _drop_repeated(order: Any, rows: Floats, what: str, notes: _Notes) -> Any:
    """Return the rows of `order` without those whose values repeat an earlier row."""
    kept: dict[bytes, int] = {}
    for row in order.tolist():
        kept.setdefault(rows[row].tobytes(), row)
    notes.count(len(order) - len(kept), f"one of the {what} occurs twice", f"{{}} of the {what} occur twice")
    return np.array(list(kept.values()), dtype=np.int64)


def _as_integers(values: list[int]) -> Any:
    return np.array(values, dtype=np.int64)


def frames_of_names(names: Iterable[str], place: str) -> Mapping[str, int]:
    """Return the frame of each name, with or without a file's ending.

    Args:
        names: names of pictures or files, with their folders if these must be equal.
        place: beginning of messages.

    Raises:
        InputError: a name does not end with a number; names differ in more than the number; two names have the same number.
    """
    found: dict[str, int] = {}
    name_of: dict[int, str] = {}
    first: tuple[str, str] | None = None
    for name in names:
        if name in found:
            continue
        path = PurePosixPath(name.replace("\\", "/"))
        match = _LAST_NUMBER.match(path.stem)
        if match is None or int(match[2]) > LARGEST_FRAME:
            raise InputError(f"{place}: {shortened(name)} does not end with a frame number: name images as in cam1_000012.jpg")
        before = f"{path.parent}/{match[1]}"
        if first is not None and before != first[0]:
            raise InputError(
                f"{place}: {shortened(first[1])} and {shortened(name)} differ in more than the number at their end: "
                "give one camera's recording"
            )
        first = first or (before, name)
        frame = int(match[2])
        if frame in name_of:
            raise InputError(
                f"{place}: {shortened(name_of[frame])} and {shortened(name)} are both frame {frame}: give one camera's "
                "recording"
            )
        found[name], name_of[frame] = frame, name
    return found
