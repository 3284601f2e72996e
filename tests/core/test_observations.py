"""Columns are checked on entry and cannot be changed afterwards."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, Boxes, CameraObservations, Keypoints, Observations

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
        (
            {"ltwh": [[1, 2, 30, 40], [1, 2, 30, 40], [1, 2, -3, 40]]},
            r"frame 3, identity -1 has width and height \[-3.0, 40.0\]",
        ),
        ({"ltwh": [[1, 2, 30, 0], [1, 2, 30, 40], [1, 2, 3, 40]]}, "frame 1, identity 4 .* above 0"),
        ({"frame": [1, 2]}, "differ in length"),
    ],
)
def test_bad_boxes_are_refused(changes: dict[str, object], message: str) -> None:
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


def test_nothing_seen_is_sound() -> None:
    seen = Observations({"A": CameraObservations()})
    assert len(seen["A"].boxes) == len(seen["A"].keypoints) == 0
    assert seen["A"].keypoints.xy.shape == (0, 17, 2)
    assert Keypoints.empty(("a", "b")).score.shape == (0, 2)


@pytest.mark.parametrize("wrong", [{"frame": [1.5, 2, 3]}, {"identity": [4, 5.7, -1]}, {"frame": np.array([1, np.nan, 3])}])
def test_parts_of_frames_and_identities_are_refused(wrong: dict[str, object]) -> None:
    """Silently cut off, they would join other people."""
    with pytest.raises(InputError):
        Boxes(**{**BOXES, **wrong})  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(3, 3), (4, 3), (12,)])
def test_columns_of_the_wrong_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError):
        Boxes(**{**BOXES, "ltwh": np.ones(shape)})  # type: ignore[arg-type]
