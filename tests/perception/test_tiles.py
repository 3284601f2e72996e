"""Tiles cover a picture, and what is found in several of them is each person once."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.perception.pictures import Frame
from passerby.perception.tiles import ENOUGH_SCALE, MOST_MAGNIFICATION, hinted, is_untruncated, merge, tile_windows
from passerby.perception.yolox import YoloxDetector, YoloxOptions
from support.networks.yolox import bright_file, network

NETWORK = (416, 416)


def boxes(*rows):
    """From left, top, width, height to left, top, right, bottom."""
    ltwh = np.array(rows, dtype=float).reshape(-1, 4)
    return np.concatenate([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]], axis=1)


@pytest.mark.parametrize(
    ("picture", "count"), [((416, 520), 0), ((480, 640), 2), ((576, 768), 4), ((720, 1280), 6), ((1920, 1080), 6)]
)
def test_number_of_tiles_by_the_size_of_the_picture(picture, count):
    assert len(tile_windows(picture, NETWORK)) == count
    # The cost is bounded for pictures however large.
    assert len(tile_windows((4320, 7680), NETWORK)) == len(tile_windows((2160, 3840), NETWORK)) <= 8
    assert len(tile_windows((4320, 7680), (64, 64))) <= 20


@given(
    height=st.integers(80, 4500),
    width=st.integers(80, 4500),
    tiling=st.one_of(st.just("auto"), st.tuples(st.integers(1, 5), st.integers(1, 5))),
)
def test_tiles_cover_the_picture_and_stay_in_it(height, width, tiling):
    tiles = tile_windows((height, width), NETWORK, tiling)
    if not tiles:
        return
    for start, length, whole in ((0, 2, width), (1, 3, height)):
        spans = sorted({(tile[start], tile[start] + tile[length]) for tile in tiles})
        assert (spans[0][0], spans[-1][1]) == (0, whole)
        assert all(second[0] <= first[1] for first, second in pairwise(spans))
    if tiling != "auto":
        assert len(tiles) == tiling[0] * tiling[1]


@given(left=st.floats(0, 1880), top=st.floats(0, 880), height=st.floats(20, 200), picture=st.just((1080, 1920)))
def test_whoever_is_small_is_whole_in_a_tile(left, top, height, picture):
    width = 0.4 * height
    person = boxes([min(left, 1920 - width), min(top, 1080 - height), width, height])
    whole = 0
    for tile in tile_windows(picture, NETWORK):
        scale = min(416 / tile[2], 416 / tile[3])
        assert scale >= min(ENOUGH_SCALE, MOST_MAGNIFICATION * 416 / 1920)
        inside = (person[0, :2] >= tile[:2]).all() and (person[0, 2:] <= np.add(tile[:2], tile[2:])).all()
        whole += int(inside and is_untruncated(person, tile, picture, (scale, scale))[0])
    assert whole >= 1


def test_boxes_cut_by_an_inner_border_go_and_those_at_the_pictures_border_stay():
    tile, picture = (500, 0, 600, 700), (1000, 1100)
    found = boxes(
        [600, 100, 50, 150],  # free
        [501, 100, 50, 150],  # at the left inner border
        [600, 548, 50, 150],  # at the lower inner border
        [600, 540, 50, 150],  # legs cut, but its lower edge found 10 pixels too high
        [1050, 0, 50, 150],  # at the picture's upper right corner
    )
    assert is_untruncated(found, tile, picture, (0.6, 0.6)).tolist() == [True, False, False, False, True]


@pytest.mark.parametrize(
    ("found", "score", "kept"),
    [
        ([[100, 100, 40, 100], [102, 101, 40, 100], [300, 100, 40, 100]], [0.6, 0.8, 0.5], [1, 2]),
        ([[100, 100, 40, 100], [102, 150, 36, 50], [103, 101, 36, 40]], [0.8, 0.5, 0.5], [0]),
        ([[100, 100, 40, 100], [102, 150, 36, 50], [103, 101, 36, 40]], [0.8, 0.9, 0.9], [0]),
        ([[100, 100, 60, 180], [110, 95, 34, 100], [140, 105, 60, 180]], [0.9, 0.5, 0.7], [0, 1, 2]),
        (np.zeros((0, 4)), [], []),
    ],
    ids=["the most certain", "legs and heads go", "sure ones too", "a person behind another stays", "nobody"],
)
def test_each_person_is_left_once(found, score, kept):
    assert sorted(merge(boxes(*found), np.array(score), 0.55).tolist()) == kept


def test_an_unsure_box_around_two_people_takes_none_of_them():
    found = boxes([100, 100, 90, 160], [102, 102, 60, 100], [128, 158, 60, 100])
    assert set(merge(found, np.array([0.3, 0.8, 0.9]), 0.55)) >= {1, 2}


@given(st.permutations(range(5)))
def test_the_order_of_boxes_decides_nothing(order):
    found = boxes([100, 100, 40, 100], [102, 101, 40, 100], [102, 150, 36, 50], [300, 9, 40, 100], [300, 9, 40, 101])
    score = np.array([0.6, 0.8, 0.5, 0.7, 0.7])
    rows = list(order)
    assert found[rows][merge(found[rows], score[rows], 0.55)].tolist() == found[merge(found, score, 0.55)].tolist()


def test_hinted_tiles():
    tiles = ((0, 0, 100, 100), (80, 0, 100, 100), (160, 0, 100, 100))
    assert (hinted(tiles, np.array([[90.0, 50.0]])), hinted(tiles, np.zeros((0, 2)))) == (tiles[:2], ())


def bright_picture(*centres):
    """512 x 512, black but for squares of 32 pixels: 4 pixels of the network's input, 10 in an automatic tile."""
    picture = np.zeros((512, 512, 3), dtype=np.uint8)
    for x, y in centres:
        picture[y - 16 : y + 16, x - 16 : x + 16, 0] = 255
    return Frame(1, 0.0, picture)


def found_in(path, frame, score, tiles):
    return YoloxDetector(network(path), YoloxOptions(score=score, tiles=tiles))(frame)


def test_a_person_too_small_for_the_whole_picture_is_found_in_a_tile(tmp_path):
    path = bright_file(tmp_path / "bright.onnx", 6.0, 12.0)
    frame = bright_picture((96, 100))
    # In the whole picture a quarter of a cell is bright at most, in a tile more than a third of one or more cells.
    assert len(found_in(path, frame, 0.3, "none")) == 0
    for tiles in ("auto", (3, 3)):
        found = found_in(path, frame, 0.3, tiles)
        assert 1 <= len(found) <= 4
        assert np.allclose(found.ltwh[:, :2] + found.ltwh[:, 2:] / 2, (96, 100), atol=28)
        # The box of 12 pixels of the input would be 96 pixels tall in the whole picture.
        assert (found.ltwh[:, 3] < 70).all()
    # Where nothing hints at small people no tile is looked at.
    frame.picture[:] //= 10
    assert len(found_in(path, frame, 0.03, (3, 3))) >= 1
    assert len(found_in(path, frame, 0.03, "auto")) == 0
