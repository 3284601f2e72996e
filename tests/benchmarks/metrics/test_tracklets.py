"""Scores of tracklets, counted by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metrics.tracklets import score_tracklets
from passerby.common.errors import InputError
from passerby.core.observations import Boxes


def person(identity: int, frames: range, left: float = 0.0) -> Boxes:
    """A box of 40 by 100 pixels that stays where it is."""
    n = len(frames)
    return Boxes(np.array(frames), np.full(n, identity), np.tile([left, 0.0, 40.0, 100.0], (n, 1)), np.ones(n))


def together(*parts: Boxes) -> Boxes:
    return Boxes(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("frame", "identity", "ltwh", "score")))


TWO = together(person(1, range(1, 11)), person(2, range(1, 11), 200.0))


def test_the_truth_itself() -> None:
    shuffled = TWO.take(np.random.default_rng(0).permutation(len(TWO)))
    found = score_tracklets(replace(shuffled, identity=7 - shuffled.identity), TWO)
    assert (found.idf1, found.idp, found.idr, found.mota, found.purity) == (1.0, 1.0, 1.0, 1.0, 1.0)
    assert (found.switches, found.fragments, found.tracklets, found.people) == (0, 0, 2, 2)
    assert found.to_dict()["idf1"] == 1.0
    # Boxes of nobody do not count.
    noise = person(-1, range(1, 11), 300.0)
    assert score_tracklets(together(TWO, noise), together(TWO, noise)) == score_tracklets(TWO, TWO)


ONE = person(1, range(1, 11))
EXCHANGED = replace(TWO, identity=np.where(TWO.frame < 7, TWO.identity, 3 - TWO.identity))


@pytest.mark.parametrize(
    ("found", "truth", "scores", "counts"),
    [
        # 6 of 10 boxes are followed by the longer part.
        pytest.param(together(person(5, range(1, 5)), person(6, range(5, 11))), ONE,
                     {"idf1": 12 / 20, "mota": 1 - 1 / 10, "purity": 1.0}, (1, 0, 2), id="broken in two"),
        pytest.param(EXCHANGED, TWO, {"idf1": 24 / 40, "mota": 1 - 2 / 20, "purity": 12 / 20}, (2, 0, 2), id="exchanged"),
        pytest.param(ONE.take((ONE.frame < 4) | (ONE.frame > 7)), ONE,
                     {"idf1": 12 / 16, "idp": 1.0, "idr": 0.6, "mota": 0.6}, (0, 1, 1), id="lost and found again"),
        pytest.param(together(TWO, person(3, range(1, 6), 400.0)), TWO,
                     {"idf1": 40 / 45, "idp": 20 / 25, "mota": 1 - 5 / 20, "purity": 1.0}, (0, 0, 3), id="of nobody"),
    ],
)  # fmt: skip
def test_tracklets_that_go_wrong(found: Boxes, truth: Boxes, scores: dict[str, float], counts: tuple[int, int, int]) -> None:
    score = score_tracklets(found, truth)
    assert {name: getattr(score, name) for name in scores} == pytest.approx(scores)
    assert (score.switches, score.fragments, score.tracklets) == counts


def test_the_matching_is_the_best_of_all_not_the_best_pair_first() -> None:
    """One tracklet follows 6 boxes of somebody and 5 of somebody else, another one 4 of the first: 5 + 4 agree, not 6 + 0."""
    truth = together(person(1, range(1, 11)), person(2, range(11, 16), 200.0))
    found = together(person(8, range(1, 7)), person(9, range(7, 11)), person(8, range(11, 16), 200.0))
    assert score_tracklets(found, truth).idf1 == pytest.approx(2 * 9 / 30)


@pytest.mark.parametrize(
    ("shift", "iou", "agrees"), [(10.0, 0.5, True), (20.0, 0.5, False), (20.0, 0.3, True), (0.0, 1.0, True)]
)
def test_boxes_agree_that_overlap_enough(shift: float, iou: float, agrees: bool) -> None:
    """Shifted by a quarter of the width two boxes overlap by 0.6 of their union, by half of it by 0.33."""
    found = score_tracklets(person(5, range(1, 11), shift), person(1, range(1, 11)), iou)
    assert found.idf1 == (1.0 if agrees else 0.0)
    assert found.mota == (1.0 if agrees else -1.0)
    assert found.purity == (1.0 if agrees else None)


def test_who_is_followed_is_followed_on_beside_a_better_box() -> None:
    truth = person(1, range(1, 11))
    better = person(6, range(5, 11))
    found = score_tracklets(together(person(5, range(1, 11), 10.0), better), truth)
    assert found.switches == 0
    assert found.mota == pytest.approx(1 - 6 / 10)
    alone = score_tracklets(together(person(5, range(1, 5), 10.0), better), truth)
    assert alone.switches == 1


def test_one_tracklet_follows_one_person_at_a_time() -> None:
    """Two were followed by it one after the other; now both are near its box."""
    truth = together(person(1, range(1, 4)), person(2, range(4, 7), 5.0), person(1, range(7, 9)), person(2, range(7, 9), 5.0))
    found = score_tracklets(person(5, range(1, 9)), truth)
    assert found.mota == pytest.approx(1 - 2 / 10)
    assert found.switches == 0


def test_nothing_is_no_score() -> None:
    nothing = score_tracklets(Boxes.empty(), Boxes.empty())
    assert (nothing.idf1, nothing.idp, nothing.idr, nothing.mota, nothing.purity) == (None,) * 5
    missed = score_tracklets(Boxes.empty(), TWO)
    assert (missed.idf1, missed.idp, missed.idr, missed.mota) == (0.0, None, 0.0, 0.0)
    assert score_tracklets(TWO, Boxes.empty()).idf1 == 0.0


def test_nobody_is_in_a_frame_twice() -> None:
    double = together(TWO, person(2, range(3, 5), 400.0))
    with pytest.raises(InputError, match="frame 3 has the found identity 2 twice"):
        score_tracklets(double, TWO)
    with pytest.raises(InputError, match="frame 3 has the true identity 2 twice"):
        score_tracklets(TWO, double)


@pytest.mark.parametrize("iou", [0.0, 1.1, float("nan")])
def test_an_overlap_out_of_range(iou: float) -> None:
    with pytest.raises(InputError, match="iou"):
        score_tracklets(TWO, TWO, iou)
