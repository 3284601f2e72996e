from __future__ import annotations

import numpy as np
import pytest

from metrics.detections import score_boxes
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes


def boxes(*rows: tuple[int, float, float, float, float]) -> Boxes:
    """Boxes from frame, left, top, width, height."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return Boxes(table[:, 0].astype(np.int64), np.full(len(table), UNKNOWN), table[:, 1:], np.ones(len(table)))


def test_errors_are_found_less_true_edges_in_heights_of_the_true_box() -> None:
    truth = boxes((1, 100, 100, 40, 100))
    score = score_boxes([(boxes((1, 98, 105, 43, 99)), truth)])
    assert score.errors.tolist() == pytest.approx(np.array([[-0.02, 0.05, 0.01, 0.04]]))
    assert score.bias.tolist() == pytest.approx([-0.02, 0.05, 0.01, 0.04])
    assert (score.share_off(0.04), score.share_off(0.06)) == (1.0, 0.0)


def test_boxes_agree_within_a_frame_and_camera_only() -> None:
    here, elsewhere = boxes((1, 0, 0, 40, 100)), boxes((2, 0, 0, 40, 100))
    assert score_boxes([(here, elsewhere)]).agreeing == 0
    assert score_boxes([(here, boxes()), (boxes(), here)]).agreeing == 0
    assert score_boxes([(here, here), (elsewhere, elsewhere)]).agreeing == 2


def test_a_box_stands_for_one_person_and_the_best_fitting_one() -> None:
    truth = boxes((1, 0, 0, 40, 100), (1, 10, 0, 40, 100))
    score = score_boxes([(boxes((1, 9, 0, 40, 100)), truth)])
    assert (score.recall, score.precision, score.agreeing) == (0.5, 1.0, 1)
    assert score.errors[0].tolist() == pytest.approx([-0.01, 0.0, -0.01, 0.0])


def test_recall_and_precision_count_every_box() -> None:
    truth = boxes((2, 200, 0, 40, 100), (1, 0, 0, 40, 100))
    found = boxes((1, 1, 0, 40, 100), (1, 500, 0, 40, 100), (2, 600, 0, 40, 100), (3, 0, 0, 40, 100))
    score = score_boxes([(found, truth)])
    assert (score.true, score.found, score.recall, score.precision) == (2, 4, 0.5, 0.25)


def test_spread_is_the_scatter_of_most_boxes() -> None:
    rng = np.random.default_rng(0)
    truth = boxes(*((frame, 100.0, 100.0, 40.0, 100.0) for frame in range(1, 2001)))
    moved = np.array(truth.ltwh)
    moved[:, 1] += rng.normal(3.0, 2.0, len(moved))
    moved[:100, 1] -= 20.0
    score = score_boxes([(Boxes(truth.frame, truth.identity, moved, truth.score), truth)])
    assert score.bias[1] == pytest.approx(0.03, abs=0.003)
    assert score.spread[1] == pytest.approx(0.02, abs=0.003)
    assert score.spread[0] == 0


def test_nothing_found_is_told_apart_from_nothing_there() -> None:
    nobody, somebody = boxes(), boxes((1, 0, 0, 40, 100))
    missed, invented = score_boxes([(nobody, somebody)]), score_boxes([(somebody, nobody)])
    assert (missed.recall, missed.precision, missed.share_off(0.1)) == (0.0, None, None)
    assert (invented.recall, invented.precision) == (None, 0.0)
    assert np.isnan(missed.bias).all()
    assert np.isnan(missed.spread).all()


@pytest.mark.parametrize("iou", [0.0, -1.0, 1.1, float("nan")])
def test_an_overlap_out_of_range_is_refused(iou: float) -> None:
    with pytest.raises(InputError, match="iou"):
        score_boxes([], iou)
