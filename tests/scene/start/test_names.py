"""Cameras' names can be foretold, are valid, and find their lens or none."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.scene.scene import CAMERA_NAME
from passerby.scene.start.recordings import camera_names, match_names


@pytest.mark.parametrize(
    ("texts", "names"),
    [
        (["walk_cam1_1080p", "walk_cam2_1080p"], ["cam1", "cam2"]),
        (["2024-05-01 north", "2024-05-01 gate"], ["north", "gate"]),
        # A bare number is no sensible name; its word stays.
        (["cam_1", "cam_2"], ["cam_1", "cam_2"]),
        (["hd_00_00", "hd_00_01"], ["hd_00_00", "hd_00_01"]),
        (["walk_cam_1_x", "walk_cam_2_x"], ["cam_1", "cam_2"]),
        (["1_video", "2_video"], ["1_video", "2_video"]),
        (["Cam 1 (left)", "Cam 2 (right)"], ["1 left", "2 right"]),
        (["a/b?", "a:b"], ["b", "b-2"]),
        (["A", "a", "a-2"], ["A", "a-3", "a-2"]),
        (["metadata", "x"], ["metadata camera", "x"]),
        (["...", "Türkamera 2"], ["camera", "Türkamera 2"]),
        (["walk_cam1_1080p"], ["walk_cam1_1080p"]),
    ],
)
def test_names(texts, names):
    assert camera_names(texts) == names


@settings(max_examples=60)
@given(st.lists(st.text(min_size=1, max_size=12), min_size=1, max_size=6))
def test_names_are_valid_and_differ(texts):
    names = camera_names(texts)
    assert all(CAMERA_NAME.fullmatch(name) and name != "metadata" for name in names)
    assert len({name.casefold() for name in names}) == len(texts)


@pytest.mark.parametrize(
    ("cameras", "others", "pairs"),
    [
        (["north", "gate"], [["gate"], ["north"]], {0: 1, 1: 0}),
        (["cam1", "cam2"], [["int_cam02_img"], ["int_cam01_img"]], {0: 1, 1: 0}),
        (["A", "B"], [["cam_0", "A"], ["cam_1", "B"]], {0: 0, 1: 1}),
        (["cam1", "north"], [["C1"], ["north"]], {0: 0, 1: 1}),
        # Counted from 1 here, from 0 there: which is which cannot be told.
        (["cam1", "cam2"], [["x1"], ["y1"], ["x2"]], {}),
        (["cam1", "cam2"], [["lens"]], {}),
    ],
)
def test_matching(cameras, others, pairs):
    assert match_names(cameras, others) == pairs


def test_numbers_of_any_length_match():
    long = "9" * 5000
    assert match_names([f"left {long}", "left 2"], [[f"cam{long}"], ["cam002"]]) == {0: 0, 1: 1}
