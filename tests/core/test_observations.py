"""Columns of boxes and keypoints, who is seen together, who holds a pixel, and heights and lengths in a wrong unit."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, Boxes, CameraObservations, Keypoints, Observations
from passerby.core.overlap import Shared, count_shared_observations, find_connected_groups, person_instants
from passerby.core.pointing import find_nearest_frame, find_pointed, people_in_frame
from passerby.core.scale_cues import METRES, PersonHeight, combine_heights, find_wrong_unit

BOXES = {"frame": [1, 2, 3], "identity": [4, 5, -1], "ltwh": [[1, 2, 30, 40]] * 3, "score": [0.5, 1, 1]}


def boxes_of(**changes: object) -> Boxes:
    return Boxes(**{**BOXES, **changes})  # type: ignore[arg-type]


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
    for rows in (np.array([2, 0]), np.array([True, False, True])):
        taken = boxes.take(rows)
        columns = sorted(zip(taken.frame.tolist(), taken.identity.tolist(), taken.score.tolist(), strict=True))
        assert columns == [(1, 4, 0.5), (3, -1, 1.0)]
    people = keypoints().take(np.array([1]))
    assert (people.frame.tolist(), people.joints) == ([2], BODY_17)


@pytest.mark.parametrize(
    ("make", "changes", "message"),
    [
        (boxes_of, {"ltwh": [[1, 2, 30, 40], [1, np.nan, 3, 4], [1, 2, 30, 40]]}, "boxes.ltwh of row 2 is not a finite number"),
        (boxes_of, {"score": [1, 1, np.inf]}, "boxes.score of row 3"),
        (boxes_of, {"ltwh": [*2 * [[1, 2, 30, 40]], [1, 2, -3, 40]]},
         r"frame 3, identity -1 has width and height \[-3.0, 40.0\]"),
        (boxes_of, {"ltwh": [[1, 2, 30, 0], [1, 2, 30, 40], [1, 2, 3, 40]]}, "frame 1, identity 4 .* above 0"),
        (boxes_of, {"frame": [1, 2]}, "differ in length"),
        # Silently cut off, parts of frames and identities would join other people.
        (boxes_of, {"frame": [1.5, 2, 3]}, None),
        (boxes_of, {"identity": [4, 5.7, -1]}, None),
        (boxes_of, {"frame": np.array([1, np.nan, 3])}, None),
        *((boxes_of, {"ltwh": np.ones(shape)}, None) for shape in ((3, 3), (4, 3), (12,))),
        (keypoints, {"xy": np.full((2, 17, 2), np.nan)}, "keypoints.xy of row 1"),
        (keypoints, {"score": np.where(np.arange(34).reshape(2, 17) == 20, np.nan, 1)}, "keypoints.score of row 2"),
        (keypoints, {"identity": [3]}, "differ in length"),
    ],
)  # fmt: skip
def test_bad_columns_are_refused(make, changes, message) -> None:
    with pytest.raises(InputError, match=message):
        make(**changes)


def crowd(cameras: int, rows: int, rng: np.random.Generator) -> Observations:
    """Boxes of random people (some unknown) at random frames; cameras of even and of odd number see different people."""
    seen = {}
    for number in range(cameras):
        who = 2 * rng.integers(0, 6, rows) + number % 2
        who[rng.random(rows) < 0.1] = -1
        boxes = Boxes(rng.integers(1, 20, rows), who, np.tile([1.0, 2.0, 3.0, 4.0], (rows, 1)), np.ones(rows))
        seen[f"C{number}"] = CameraObservations(boxes)
    return Observations(seen)


def test_shared_people_and_sightings_are_as_defined() -> None:
    observations = crowd(7, 40, np.random.default_rng(3))
    found = count_shared_observations(observations)
    rows = {name: {tuple(row) for row in person_instants(seen).tolist()} for name, seen in observations.cameras.items()}
    assert list(found) == list(rows)
    for first, others in found.items():
        assert list(others) == [name for name in rows if name != first]
        for second, shared in others.items():
            common = rows[first] & rows[second]
            assert shared == Shared(len({who for _, who in common}), len(common))
    empty = Observations({name: CameraObservations() for name in ("A", "B")})
    assert count_shared_observations(empty) == {"A": {"B": Shared(0, 0)}, "B": {"A": Shared(0, 0)}}
    assert find_connected_groups(found) == [["C0", "C2", "C4", "C6"], ["C1", "C3", "C5"]]


NEAR, FAR, ALONE = [100.0, 100.0, 80.0, 200.0], [140.0, 90.0, 40.0, 100.0], [400.0, 50.0, 50.0, 120.0]


def seen(ltwh=(NEAR, FAR, ALONE), frame=11):
    return CameraObservations(Boxes(np.full(len(ltwh), frame), np.arange(len(ltwh)), np.array(ltwh), np.ones(len(ltwh))))


@pytest.mark.parametrize(("at", "row"), [((110.0, 250.0), 0), ((150.0, 95.0), 1), ((425.0, 100.0), 2), ((300.0, 300.0), None)])
def test_a_pixel_belongs_to_the_box_that_holds_it(at, row):
    found = find_pointed(seen(), 11, at)
    assert found == (None if row is None else ("boxes", row))
    assert find_pointed(seen(), 12, at) is None
    for order in ((NEAR, FAR), (FAR, NEAR)):  # of two that overlap it is the one that reaches lowest
        camera, both = seen(order), (160.0, 150.0)
        assert len(people_in_frame(camera, 11).holding(both)) == 2
        assert find_pointed(camera, 11, both) == ("boxes", order.index(NEAR))
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


@pytest.mark.parametrize(
    ("unit", "times", "sigma"),
    [("millimetres", 983.0, 0.05), ("centimetres", 106.0, 0.05), ("inches", 37.5, 0.05), ("feet", 3.4, 0.05),
     ("yards", 1 / 0.9144, 0.01)],
)  # fmt: skip
def test_a_unit_is_recognised_beside_the_error_of_peoples_heights(unit, times, sigma):
    wrong = find_wrong_unit(np.log(times), sigma)
    assert wrong.unit == unit
    assert f"multiply them by {METRES[unit]:g}" in wrong.in_words


@pytest.mark.parametrize("times", [0.5, 0.72, 1.0, 1 / 0.9144, 1.3, 2.0])
def test_metres_of_unusual_people_are_metres(times):
    """A class of children, or boxes that end at the knees: no unit is wrong. Yards need a scale that is well known."""
    assert find_wrong_unit(np.log(times), 0.045) is None
    gross = find_wrong_unit(np.log(9.0), 0.05)  # of no unit, and wrong all the same
    assert gross.unit is None
    assert "9 times as long" in gross.in_words
