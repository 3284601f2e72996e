"""Precision and recall of identities, on cases small enough to count by hand."""

from __future__ import annotations

import numpy as np
import pytest

from metrics.identities import identity_agreement
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, Clock


def boxes(*rows: tuple[int, int, float]) -> Boxes:
    """Boxes of (frame, identity, left); everything else alike."""
    frame, identity, left = (np.array(column) for column in zip(*rows, strict=True))
    ltwh = np.column_stack([left, *np.broadcast_to([[100.0], [30.0], [80.0]], (3, len(rows)))])
    return Boxes(frame, identity, ltwh, np.ones(len(rows)))


# Two instants, three people; persons 1 and 2 in three cameras, person 3 in one.
TRUE = {
    "A": boxes((1, 1, 10), (1, 2, 200), (2, 1, 20), (2, 2, 210), (2, 3, 400)),
    "B": boxes((1, 1, 50), (1, 2, 300), (2, 1, 60), (2, 2, 310)),
    "C": boxes((1, 1, 90), (2, 2, 500)),
}
PAIRS = 4 + 2 + 2  # A-B twice at both instants, A-C and B-C once at each


def renamed(names: dict[tuple[str, int], int]) -> dict[str, Boxes]:
    """The true boxes with other identities, by camera and true identity."""
    return {
        camera: Boxes(b.frame, np.array([names.get((camera, i), i) for i in b.identity.tolist()]), b.ltwh, b.score)
        for camera, b in TRUE.items()
    }


@pytest.mark.parametrize(
    ("names", "found", "right", "precision", "recall"),
    [
        pytest.param({(c, i): 70 + 3 * i for c in TRUE for i in (1, 2, 3)}, PAIRS, PAIRS, 1.0, 1.0, id="any names"),
        # A-C claims 2 pairs, rightly; A-B claims 4 and B-C 2, all wrong.
        pytest.param({("B", 1): 2, ("B", 2): 1}, 2 + 4 + 2, 2, 2 / 8, 2 / PAIRS, id="two exchanged in one camera"),
        # A-B at two instants, A-C at one.
        pytest.param({("A", 1): 9}, PAIRS - 3, PAIRS - 3, 1.0, (PAIRS - 3) / PAIRS, id="a person split in two"),
        # At each instant A and B have two boxes of the one identity, C has one.
        pytest.param({(c, 2): 1 for c in TRUE}, 2 * (2 * 2 + 2 + 2), PAIRS, PAIRS / 16, 1.0, id="two people merged"),
        pytest.param({("C", 1): -1, ("C", 2): -1}, 4, 4, 1.0, 4 / PAIRS, id="boxes without an identity"),
    ],
)
def test_pairs_are_counted(names: dict[tuple[str, int], int], found: int, right: int, precision: float, recall: float):
    agreement = identity_agreement(renamed(names), TRUE)
    assert (agreement.pairs_true, agreement.pairs_found, agreement.pairs_right) == (PAIRS, found, right)
    assert (agreement.precision, agreement.recall) == (precision, recall)
    assert (agreement.boxes_true, agreement.boxes_without_truth) == (11, 0)
    assert agreement.boxes_identified == 11 - 2 * (-1 in names.values())
    assert agreement.to_dict()["precision"] == precision
    if -1 in names.values():
        assert identity_agreement({camera: TRUE[camera] for camera in ("A", "B")}, TRUE) == agreement, "as a camera left out"


def test_boxes_without_a_true_identity_count_neither_way():
    found = dict(TRUE)
    found["A"] = boxes((1, 1, 10), (1, 2, 200), (1, 7, 650), (2, 1, 20), (2, 2, 210), (2, 3, 400), (2, -1, 600))
    found["B"] = boxes((1, 1, 50), (1, 2, 300), (1, 7, 660), (2, 1, 60), (2, 2, 310))
    found["D"] = boxes((1, 1, 5), (1, -1, 80))
    agreement = identity_agreement(found, TRUE)
    assert (agreement.pairs_true, agreement.pairs_found, agreement.pairs_right) == (PAIRS, PAIRS, PAIRS)
    assert agreement.boxes_without_truth == 3
    unsure = identity_agreement(TRUE, renamed({("A", 1): -1}))
    assert (unsure.pairs_true, unsure.boxes_without_truth) == (PAIRS - 3, 2)


@pytest.mark.parametrize(("shift", "same"), [(0.004, True), (0.02, False)])
def test_boxes_are_the_same_within_a_hundredth_of_a_pixel(shift, same):
    moved = {camera: Boxes(b.frame, b.identity, b.ltwh + [shift, 0, 0, 0], b.score) for camera, b in TRUE.items()}
    found = identity_agreement(moved, TRUE)
    assert (found.pairs_right, found.boxes_without_truth) == ((PAIRS, 0) if same else (0, 11))


def test_without_pairs_there_is_no_share():
    nothing, unfound = identity_agreement({}, {}), identity_agreement({"A": Boxes.empty()}, TRUE)
    assert (nothing.precision, nothing.recall) == (None, None)
    assert (unfound.precision, unfound.recall) == (None, 0.0)


def test_clocks_say_which_frames_are_one_instant():
    """B started two frames late, C runs at twice the rate: person 1 is seen by all at 0.4 s, person 2 at 0.6 s."""
    clocks = {"A": Clock(5.0), "B": Clock(5.0, 0.4), "C": Clock(10.0, 0.05)}
    # Nearest to 0.4 and 0.6 s: frames 4 (0.35 s) and 5 (0.45 s) of C tie, as do 6 and 7; the later is taken.
    true = {
        "A": boxes((3, 1, 10), (4, 2, 20)),
        "B": boxes((1, 1, 30), (2, 2, 40)),
        "C": boxes((4, 2, 50), (5, 1, 60), (7, 2, 70)),
    }
    assert identity_agreement(true, true).pairs_true == 1  # by the same frame number: A's and C's box in frame 4
    found = identity_agreement(true, true, clocks)
    assert (found.pairs_true, found.pairs_found, found.pairs_right) == (6, 6, 6)
    assert identity_agreement(true, true, clocks, tolerance_s=0.04).pairs_true == 2  # A-B only: C is 0.05 s off
    assert identity_agreement(true, true, clocks, tolerance_s=0.05).pairs_true == 6
    with pytest.raises(InputError, match="camera C has true identities, but no clock"):
        identity_agreement(true, true, {"A": Clock(5.0), "B": Clock(5.0)})
    # Half a frame apart every frame has one partner.
    frames = np.arange(1, 2001)
    crowd = dict.fromkeys("AB", Boxes(frames, np.ones(2000), np.tile([5.0, 5.0, 20.0, 50.0], (2000, 1)), np.ones(2000)))
    assert identity_agreement(crowd, crowd, {"A": Clock(7.0), "B": Clock(7.0, 0.5 / 7.0)}).pairs_true in (1999, 2000)
