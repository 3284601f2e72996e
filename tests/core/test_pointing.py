"""Who holds a pixel: the nearest of the people there, at the nearest frame."""

import numpy as np
import pytest

from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.core.pointing import find_nearest_frame, find_pointed, people_in_frame
from passerby.core.scale_cues import PersonHeight, combine_heights

NEAR, FAR, ALONE = [100.0, 100.0, 80.0, 200.0], [140.0, 90.0, 40.0, 100.0], [400.0, 50.0, 50.0, 120.0]


def seen(ltwh=(NEAR, FAR, ALONE), frame=11):
    return CameraObservations(Boxes(np.full(len(ltwh), frame), np.arange(len(ltwh)), np.array(ltwh), np.ones(len(ltwh))))


@pytest.mark.parametrize(("at", "row"), [((110.0, 250.0), 0), ((150.0, 95.0), 1), ((425.0, 100.0), 2), ((300.0, 300.0), None)])
def test_the_box_that_holds_the_pixel(at, row):
    found = find_pointed(seen(), 11, at)
    assert found == (None if row is None else ("boxes", row))
    assert find_pointed(seen(), 12, at) is None


@pytest.mark.parametrize("order", [(NEAR, FAR), (FAR, NEAR)])
def test_of_two_who_overlap_it_is_the_one_whose_box_reaches_lowest(order):
    camera = seen(order)
    at = (160.0, 150.0)
    assert len(people_in_frame(camera, 11).holding(at)) == 2
    assert find_pointed(camera, 11, at) == ("boxes", order.index(NEAR))
    # Of two that reach equally low it is the smallest.
    assert find_pointed(seen([NEAR, [120.0, 200.0, 40.0, 100.0]]), 11, (130.0, 250.0)) == ("boxes", 1)


def test_people_without_boxes_are_found_by_their_keypoints():
    xy = np.zeros((2, 17, 2))
    xy[0, 5:9] = [[100, 100], [140, 100], [100, 200], [140, 200]]
    score = np.zeros((2, 17))
    score[0, 5:9] = 1.0
    score[1, 0] = 1.0  # one keypoint encloses nothing
    camera = CameraObservations(keypoints=Keypoints(np.full(2, 11), np.arange(2), xy, score))
    assert find_pointed(camera, 11, (120.0, 208.0)) == ("keypoints", 0)
    assert find_pointed(camera, 11, (120.0, 212.0)) is None
    assert find_pointed(camera, 11, (0.0, 0.0)) is None


def test_the_nearest_frame_with_people():
    camera = CameraObservations(Boxes(np.array([1, 6, 11, 16, 60]), np.zeros(5), np.tile(NEAR, (5, 1)), np.ones(5)))
    # A quarter of a second is 6.25 frames.
    for frame, fps, found in ((8.0, 25.0, 6), (9.0, 25.0, 11), (35.0, 25.0, None), (65.0, None, 60), (66.0, None, None),
                              (66.0, 25.0, 60), (float("nan"), 25.0, None)):  # fmt: skip
        assert find_nearest_frame(camera, frame, fps) == found
    assert find_nearest_frame(CameraObservations(), 1.0, 25.0) is None


def test_heights_of_one_person_are_combined():
    alone = PersonHeight(2, 1.6, 0.02)
    both, other = combine_heights([PersonHeight(7, 1.80, 0.01, "one"), alone, PersonHeight(7, 1.84, 0.01, "two")])
    assert (other, both.identity, both.place) == (alone, 7, "one and two")
    assert (both.metres, both.sd_m) == pytest.approx((1.82, np.hypot(0.01, 0.02)))
    (same,) = combine_heights([alone, alone])
    assert (same.metres, same.sd_m) == pytest.approx((1.6, 0.02))
    (unequal,) = combine_heights([PersonHeight(7, 1.80, 0.01), PersonHeight(7, 1.90, 0.1)])
    assert unequal.metres == pytest.approx(1.80, abs=0.002)
