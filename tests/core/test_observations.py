"""Columns are checked on entry and cannot be changed afterwards."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, Boxes, Keypoints

BOXES = {"frame": [1, 2, 3], "identity": [4, 5, -1], "ltwh": [[1, 2, 30, 40]] * 3, "score": [0.5, 1, 1]}


def keypoints(**changes: object) -> Keypoints:
    values = {"frame": [1, 2], "identity": [3, 3], "xy": np.zeros((2, 17, 2)), "score": np.ones((2, 17)), **changes}
    return Keypoints(**values)  # type: ignore[arg-type]


def test_boxes_become_arrays_that_cannot_be_changed() -> None:
    given = np.array([[1.0, 2, 30, 40]] * 3)
    boxes = Boxes(**{**BOXES, "ltwh": given})  # type: ignore[arg-type]
    given[0] = 0
    assert len(boxes) == 3
    assert boxes.frame.dtype == boxes.identity.dtype == np.int64
    assert boxes.ltwh[0].tolist() == [1, 2, 30, 40]
    with pytest.raises(ValueError, match="read-only"):
        boxes.ltwh[0, 0] = 7


@pytest.mark.parametrize("rows", [np.array([2, 0]), np.array([True, False, True])])
def test_take_keeps_the_rows_together(rows: np.ndarray) -> None:
    boxes = Boxes(**BOXES).take(rows)  # type: ignore[arg-type]
    assert sorted(zip(boxes.frame.tolist(), boxes.identity.tolist(), boxes.score.tolist(), strict=True)) == [
        (1, 4, 0.5),
        (3, -1, 1.0),
    ]
    people = keypoints().take(np.array([1]))
    assert people.frame.tolist() == [2]
    assert people.joints == BODY_17


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ltwh": [[1, 2, 30, 40], [1, np.nan, 30, 40], [1, 2, 30, 40]]}, r"boxes.ltwh of row 2 is not a finite number"),
        ({"score": [1, 1, np.inf]}, "boxes.score of row 3"),
        ({"ltwh": [*2 * [[1, 2, 30, 40]], [1, 2, -3, 40]]}, r"frame 3, identity -1 has width and height \[-3.0, 40.0\]"),
        ({"ltwh": [[1, 2, 30, 0], [1, 2, 30, 40], [1, 2, 3, 40]]}, "frame 1, identity 4 .* above 0"),
        ({"frame": [1, 2]}, "differ in length"),
        # Silently cut off, parts of frames and identities would join other people.
        ({"frame": [1.5, 2, 3]}, None),
        ({"identity": [4, 5.7, -1]}, None),
        ({"frame": np.array([1, np.nan, 3])}, None),
        *(({"ltwh": np.ones(shape)}, None) for shape in ((3, 3), (4, 3), (12,))),
    ],
)
def test_bad_boxes_are_refused(changes: dict[str, object], message: str | None) -> None:
    with pytest.raises(InputError, match=message):
        Boxes(**{**BOXES, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"xy": np.full((2, 17, 2), np.nan)}, "keypoints.xy of row 1"),
        ({"score": np.where(np.arange(34).reshape(2, 17) == 20, np.nan, 1)}, "keypoints.score of row 2"),
        ({"identity": [3]}, "differ in length"),
    ],
)
def test_bad_keypoints_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        keypoints(**changes)
