"""The correspondence picture: green near the true epipolar line, red elsewhere, and small enough to keep."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from baselines import Matches
from paper.match_picture import GREEN, MOST_DRAWN, RED, as_jpeg, draw_matches, epipolar_distances, right
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


def test_distances_are_pixels_to_the_epipolar_line() -> None:
    """Side by side every epipolar line is a row: in the middle of the picture a match is as far off as its rows differ."""
    at = np.array([[140.0, 120.0], [180.0, 120.0], [160.0, 120.0]])
    to = np.array([[100.0, 120.0], [160.0, 125.0], [160.0, 80.0]])
    np.testing.assert_allclose(epipolar_distances(A, B, at, to), [0, 5, 40], atol=0.3)
    np.testing.assert_array_equal(right(A, B, matches(120, 124.9, 126, 60)), [True, True, False, False])
    with pytest.raises(InputError, match="camera b has no pose"):
        epipolar_distances(A, replace(B, pose=None), np.zeros((1, 2)), np.zeros((1, 2)))


def test_a_distortion_bends_the_line_and_not_the_answer() -> None:
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]), np.array([-0.3, 0.1, 0.001, 0.002]))
    a, b = replace(A, lens=lens), replace(B, lens=lens)
    places = np.random.default_rng(0).uniform((-2, -1.5, 4), (2, 1.5, 9), (50, 3))
    at, to = a.project(places), b.project(places)
    assert epipolar_distances(a, b, at, to).max() < 0.05
    assert epipolar_distances(a, b, at, to + (0, 12)).min() > 5


def test_lines_are_green_or_red_and_end_at_their_places() -> None:
    good, bad = (draw_matches((GREY, GREY), (A, B), matches(row), "x") for row in (121.0, 200.0))
    assert coloured(good, GREEN) > 50
    assert coloured(good, RED) == 0
    assert coloured(bad, RED) > 50
    assert coloured(bad, GREEN) == 0
    # Right ones are not hidden by wrong ones, which go through the same place and are drawn first.
    many = matches(120.0, *([200.0] * (MOST_DRAWN - 1)))
    for drawn, reds in ((draw_matches((GREY, GREY), (A, B), found, "x"), len(found) > 1) for found in (matches(120.0), many)):
        head = drawn.shape[0] - 240
        assert tuple(drawn[head + 120, 200]) == GREEN
        assert tuple(drawn[head + 120, drawn.shape[1] - 320 + 100]) == GREEN
        assert (coloured(drawn, RED) > 50) == reds
    none = draw_matches((GREY[..., 0], GREY), (A, B), Matches.none(), "x")
    assert coloured(none, GREEN) == coloured(none, RED) == 0
    with pytest.raises(InputError, match="240 and 100 rows"):
        draw_matches((GREY, GREY[:100]), (A, B), matches(120), "x")


def test_a_jpeg_keeps_to_its_size() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (600, 1500, 3)).astype(np.uint8)
    data = as_jpeg(noise, most_bytes=60_000)
    assert len(data) <= 60_000
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape[1] <= 1000
