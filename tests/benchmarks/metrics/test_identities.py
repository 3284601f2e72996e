"""Precision and recall of identities, on cases small enough to count by hand."""

from __future__ import annotations

import numpy as np
import pytest

from metrics.identities import identity_agreement
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, Clock


def boxes(*rows: tuple[int, int, float], shift: float = 0.0) -> Boxes:
    """Boxes of (frame, identity, left); everything else alike."""
    frame, identity, left = (np.array(column) for column in zip(*rows, strict=True))
    ltwh = np.column_stack([left + shift, *np.broadcast_to([[100.0], [30.0], [80.0]], (3, len(rows)))])
    return Boxes(frame, identity, ltwh, np.ones(len(rows)))


# Two instants, three people; persons 1 and 2 in three cameras, person 3 in one.
TRUE = {
    "A": boxes((1, 1, 10), (1, 2, 200), (2, 1, 20), (2, 2, 210), (2, 3, 400)),
    "B": boxes((1, 1, 50), (1, 2, 300), (2, 1, 60), (2, 2, 310)),
    "C": boxes((1, 1, 90), (2, 2, 500)),
}
PAIRS = 4 + 2 + 2  # A-B twice at both instants, A-C and B-C once at each


def renamed(true: dict[str, Boxes], names: dict[tuple[str, int], int]) -> dict[str, Boxes]:
    """The boxes with other identities, by camera and true identity."""
    return {
        camera: Boxes(b.frame, np.array([names.get((camera, i), i) for i in b.identity.tolist()]), b.ltwh, b.score)
        for camera, b in true.items()
    }


def test_the_truth_agrees_with_itself_under_any_names():
    names = {(camera, i): 70 + 3 * i for camera in TRUE for i in (1, 2, 3)}
    found = identity_agreement(renamed(TRUE, names), TRUE)
    assert (found.pairs_true, found.pairs_found, found.pairs_right) == (PAIRS, PAIRS, PAIRS)
    assert (found.precision, found.recall) == (1.0, 1.0)
    assert (found.boxes_true, found.boxes_identified, found.boxes_without_truth) == (11, 11, 0)
    assert found.to_dict()["precision"] == 1.0


def test_two_people_exchanged_in_one_camera_spoil_its_pairs():
    found = identity_agreement(renamed(TRUE, {("B", 1): 2, ("B", 2): 1}), TRUE)
    # A-C claims 2 pairs, rightly; A-B claims 4 and B-C 2, all wrong.
    assert found.pairs_right == 2
    assert found.pairs_found == 2 + 4 + 2
    assert found.precision == 2 / 8
    assert found.recall == 2 / PAIRS


def test_a_person_split_in_two_costs_recall_alone():
    found = identity_agreement(renamed(TRUE, {("A", 1): 9}), TRUE)
    assert found.precision == 1.0
    assert found.recall == (PAIRS - 3) / PAIRS  # A-B at two instants, A-C at one


def test_two_people_merged_cost_precision_alone():
    found = identity_agreement(renamed(TRUE, {(camera, 2): 1 for camera in TRUE}), TRUE)
    assert found.recall == 1.0
    # At each instant A and B have two boxes of the one identity, C has one.
    assert found.pairs_found == 2 * (2 * 2 + 2 * 1 + 2 * 1)
    assert found.precision == PAIRS / 16


def test_boxes_without_an_identity_cost_recall_and_are_no_claim():
    found = identity_agreement(renamed(TRUE, {("C", 1): -1, ("C", 2): -1}), TRUE)
    assert (found.pairs_true, found.pairs_found, found.pairs_right) == (PAIRS, 4, 4)
    assert (found.boxes_true, found.boxes_identified) == (11, 9)
    absent = {camera: TRUE[camera] for camera in ("A", "B")}
    assert identity_agreement(absent, TRUE) == found


def test_boxes_without_a_true_identity_count_neither_way():
    found = dict(TRUE)
    found["A"] = boxes((1, 1, 10), (1, 2, 200), (1, 7, 650), (2, 1, 20), (2, 2, 210), (2, 3, 400), (2, -1, 600))
    found["B"] = boxes((1, 1, 50), (1, 2, 300), (1, 7, 660), (2, 1, 60), (2, 2, 310))
    found["D"] = boxes((1, 1, 5), (1, -1, 80))
    judged = identity_agreement(found, TRUE)
    assert (judged.pairs_true, judged.pairs_found, judged.pairs_right) == (PAIRS, PAIRS, PAIRS)
    assert judged.boxes_without_truth == 3
    unsure = renamed(TRUE, {("A", 1): -1})
    assert identity_agreement(TRUE, unsure).pairs_true == PAIRS - 3
    assert identity_agreement(TRUE, unsure).boxes_without_truth == 2


@pytest.mark.parametrize(("shift", "same"), [(0.004, True), (0.02, False)])
def test_boxes_are_the_same_within_a_hundredth_of_a_pixel(shift, same):
    moved = {camera: Boxes(b.frame, b.identity, b.ltwh + [shift, 0, 0, 0], b.score) for camera, b in TRUE.items()}
    found = identity_agreement(moved, TRUE)
    assert found.pairs_right == (PAIRS if same else 0)
    assert found.boxes_without_truth == (0 if same else 11)


def test_without_pairs_there_is_no_share():
    nothing = identity_agreement({}, {})
    assert (nothing.precision, nothing.recall) == (None, None)
    unfound = identity_agreement({"A": Boxes.empty()}, TRUE)
    assert (unfound.precision, unfound.recall) == (None, 0.0)


def test_clocks_say_which_frames_are_one_instant():
    """B started two frames late, C runs at twice the rate: person 1 is seen by all at 0.4 s, person 2 at 0.6 s."""
    clocks = {"A": Clock(5.0), "B": Clock(5.0, 0.4), "C": Clock(10.0, 0.05)}
    true = {
        "A": boxes((3, 1, 10), (4, 2, 20)),
        "B": boxes((1, 1, 30), (2, 2, 40)),
        # Nearest to 0.4 and 0.6 s: frames 4 (0.35 s) and 5 (0.45 s) tie, as do 6 and 7; the later is taken.
        "C": boxes((4, 2, 50), (5, 1, 60), (7, 2, 70)),
    }
    assert identity_agreement(true, true).pairs_true == 1  # by the same frame number: A's and C's box in frame 4
    judged = identity_agreement(true, true, clocks)
    assert (judged.pairs_true, judged.pairs_found, judged.pairs_right) == (6, 6, 6)
    assert identity_agreement(true, true, clocks, tolerance_s=0.04).pairs_true == 2  # A-B only: C is 0.05 s off
    assert identity_agreement(true, true, clocks, tolerance_s=0.05).pairs_true == 6
    with pytest.raises(InputError, match="camera C has true identities, but no clock"):
        identity_agreement(true, true, {"A": Clock(5.0), "B": Clock(5.0)})


def test_half_a_frame_apart_every_frame_has_one_partner():
    clocks = {"A": Clock(7.0), "B": Clock(7.0, 0.5 / 7.0)}
    frames = np.arange(1, 2001)
    crowd = Boxes(frames, np.ones(2000), np.tile([5.0, 5.0, 20.0, 50.0], (2000, 1)), np.ones(2000))
    assert identity_agreement({"A": crowd, "B": crowd}, {"A": crowd, "B": crowd}, clocks).pairs_true in (1999, 2000)
