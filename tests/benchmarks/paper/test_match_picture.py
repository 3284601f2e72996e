"""The correspondence picture: green near the true epipolar line, red elsewhere, and small enough to keep."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from baselines import Matches
from paper.match_picture import GREEN, MOST_DRAWN, RED, as_jpeg, draw_matches, right
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose

LENS = Lens((320, 240), np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]]), np.zeros(0))
A, B = (Camera(name, LENS, Pose(np.eye(3), np.array([-x, 0.0, 0.0]))) for name, x in (("a", 0.0), ("b", 1.0)))
GREY = np.full((240, 320, 3), 128, dtype=np.uint8)


def coloured(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((picture == np.array(colour)).all(axis=2).sum())


def matches(*rows_of_b: float) -> Matches:
    """From row 120 of the first picture to these of the second: the epipolar line is row 120."""
    n = len(rows_of_b)
    return Matches(np.tile([200.0, 120.0], (n, 1)), np.column_stack([np.full(n, 100.0), rows_of_b]), np.ones(n))


def test_right_within_five_pixels() -> None:
    np.testing.assert_array_equal(right(A, B, matches(120, 124.9, 126, 60)), [True, True, False, False])


def test_colours() -> None:
    good, bad = (draw_matches((GREY, GREY), (A, B), matches(row), "x") for row in (121.0, 200.0))
    assert coloured(good, GREEN) > 50
    assert coloured(good, RED) == 0
    assert coloured(bad, RED) > 50
    assert coloured(bad, GREEN) == 0


def test_ends_stand_at_their_places() -> None:
    drawn = draw_matches((GREY, GREY), (A, B), matches(120.0), "x")
    head = drawn.shape[0] - 240
    assert tuple(drawn[head + 120, 200]) == GREEN
    assert tuple(drawn[head + 120, drawn.shape[1] - 320 + 100]) == GREEN


def test_grey_pictures_and_no_matches() -> None:
    drawn = draw_matches((GREY[..., 0], GREY), (A, B), Matches.none(), "x")
    assert coloured(drawn, GREEN) == coloured(drawn, RED) == 0


def test_right_ones_are_not_hidden_by_wrong_ones() -> None:
    """The wrong ones go through the same place, and are drawn first."""
    drawn = draw_matches((GREY, GREY), (A, B), matches(120.0, *([200.0] * (MOST_DRAWN - 1))), "x")
    head = drawn.shape[0] - 240
    assert tuple(drawn[head + 120, 200]) == GREEN
    assert coloured(drawn, RED) > 50


def test_pictures_of_different_heights_are_refused() -> None:
    with pytest.raises(InputError, match="240 and 100 rows"):
        draw_matches((GREY, GREY[:100]), (A, B), matches(120), "x")


def test_a_jpeg_keeps_to_its_size() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (600, 1500, 3)).astype(np.uint8)
    data = as_jpeg(noise, most_bytes=60_000)
    assert len(data) <= 60_000
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape[1] <= 1000
