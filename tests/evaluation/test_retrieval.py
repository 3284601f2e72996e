"""CMC and mAP against cases worked by hand, a published implementation, and what must hold of any case."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.evaluation import retrieval
from passerby.evaluation.retrieval import retrieval_score

DISTRACTOR = -2


def one_query(gallery, **options):
    """The score of a query of person 0 by camera 0; `gallery`: (person, camera) in the order of their distances."""
    person, camera = np.array(gallery).T
    return retrieval_score(np.arange(len(gallery))[None] / 7, np.array([0]), np.array([0]), person, camera, **options)


@pytest.mark.parametrize(
    ("gallery", "precision", "first"),
    [
        ([(1, 1), (0, 1), (2, 1)], 1 / 2, 2),
        ([(0, 1), (1, 1), (0, 2)], (1 + 2 / 3) / 2, 1),  # 0.792 by the area under trapezoids
        ([(0, 0), (1, 1), (0, 1)], 1 / 2, 2),  # the same person by the same camera is as if it were not there
        ([(1, 0), (0, 1)], 1 / 2, 2),  # somebody else by the same camera is wrong
        ([(-1, 1), (0, 1)], 1.0, 1),  # junk is as if it were not there
        ([(DISTRACTOR, 1), (0, 1)], 1 / 2, 2),  # a distractor is wrong
    ],
)
def test_by_hand(gallery, precision, first):
    score = one_query(gallery, ranks=(1, 2, 3))
    assert score.mean_average_precision == pytest.approx(precision, abs=1e-12)
    assert score.cmc == {k: float(first <= k) for k in (1, 2, 3)}
    assert (score.queries, score.left_out, score.gallery) == (1, 0, len(gallery))


def test_the_query_s_camera_and_people_who_may_be_the_same_are_passed_over_where_that_is_asked_for():
    usual, across = (one_query([(1, 0), (2, 1), (0, 1)], across=across).mean_average_precision for across in (False, True))
    assert (usual, across) == pytest.approx((1 / 3, 1 / 2))
    apart = np.array([[False, False, True], [False, False, True], [True, True, False]])
    gallery = [(1, 1), (2, 1), (DISTRACTOR, 1), (0, 1)]
    assert one_query(gallery, apart=apart).mean_average_precision == pytest.approx(1 / 3)
    assert one_query(gallery).mean_average_precision == pytest.approx(1 / 4)


def published_case():
    """60 queries and 400 pictures of 25 people by 4 cameras, two of them seen by one camera alone, and distractors."""
    rng = np.random.default_rng(1501)
    gallery_person, gallery_camera = rng.integers(0, 25, 400), rng.integers(0, 4, 400)
    query_person, query_camera = rng.integers(0, 25, 60), rng.integers(0, 4, 60)
    gallery_camera[gallery_person < 2] = 0
    query_camera[query_person < 2] = 0
    people = rng.normal(0, 1, (25, 3))
    cameras = np.vstack([np.zeros(3), 0.3 * np.eye(3)])
    query = people[query_person] + cameras[query_camera] + rng.normal(0, 0.4, (60, 3))
    gallery = people[gallery_person] + cameras[gallery_camera] + rng.normal(0, 0.4, (400, 3))
    distance = np.linalg.norm(query[:, None] - gallery[None], axis=-1)
    gallery_person = np.where(rng.random(400) < 0.1, DISTRACTOR, gallery_person)
    return distance, query_person, query_camera, gallery_person, gallery_camera


def test_the_figures_of_published_implementations():
    """By `torchreid.reid.metrics.rank.evaluate_rank` of torchreid 0.2.5, and the same by `fastreid.evaluation.rank` of fastreid
    1.4.0 (both from PyPI); they count in float32."""
    score = retrieval_score(*published_case(), ranks=(1, 5, 10, 20))
    assert [score.cmc[k] for k in (1, 5, 10, 20)] == pytest.approx(
        [0.3396226465702057, 0.7169811129570007, 0.8867924809455872, 0.9245283007621765], abs=1e-7
    )
    assert score.mean_average_precision == pytest.approx(0.30088518701215045, abs=1e-12)
    assert (score.queries, score.left_out, score.rank_1) == (53, 7, score.cmc[1])


def test_distances_are_asked_for_in_parts_which_changes_nothing(monkeypatch):
    distance, *columns = published_case()
    whole = retrieval_score(distance, *columns)
    monkeypatch.setattr(retrieval, "AT_ONCE", 1000)
    assert retrieval_score(lambda low, high: distance[low:high], *columns) == retrieval_score(distance, *columns) == whole


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_what_holds_of_any_case(seed, ties):
    rng = np.random.default_rng(seed)
    n_queries, n_gallery = rng.integers(1, 12), rng.integers(1, 30)
    distance = rng.integers(0, 5, (n_queries, n_gallery)) if ties else rng.permutation(n_queries * n_gallery)
    distance = distance.reshape(n_queries, n_gallery).astype(np.float32)
    who, where = rng.integers(0, 4, n_queries), rng.integers(0, 2, n_queries)
    shown, by = rng.integers(-2, 4, n_gallery), rng.integers(0, 3, n_gallery)
    ranks = tuple(range(1, n_gallery + 1))
    try:
        score = retrieval_score(distance, who, where, shown, by, ranks)
    except InputError:
        assert not any(((shown == w) & (by != c)).any() for w, c in zip(who, where, strict=True))
        return
    precisions, firsts = brute_force(distance, who, where, shown, by)
    assert score.mean_average_precision == pytest.approx(np.mean(precisions), abs=1e-12)
    assert list(score.cmc.values()) == pytest.approx([np.mean(np.array(firsts) <= k) for k in ranks])
    assert score.cmc[n_gallery] == 1  # everybody who counts is found in the end
    # Junk added in front of everything changes nothing, neither does another unit of distance.
    distance = np.hstack([np.full((n_queries, 1), -1.0), 3.0 * distance])
    more = retrieval_score(distance, who, where, np.append(-1, shown), np.append(0, by), ranks)
    assert more.cmc == score.cmc
    assert more.mean_average_precision == score.mean_average_precision


def brute_force(distance, who, where, shown, by):
    """The definition, query by query."""
    precisions, firsts = [], []
    for row, w, c in zip(distance, who, where, strict=True):
        found = [
            shown[column] == w
            for column in sorted(range(len(row)), key=lambda column: row[column])
            if shown[column] != -1 and not (shown[column] == w and by[column] == c)
        ]
        ranks = [rank for rank, right in enumerate(found, start=1) if right]
        if ranks:
            precisions.append(np.mean([count / rank for count, rank in enumerate(ranks, start=1)]))
            firsts.append(ranks[0])
    return precisions, firsts


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distance": np.full((1, 2), np.nan)}, "not a finite number"),
        ({"distance": np.zeros((2, 2))}, r"shape \(2, 2\)"),
        ({"query_person": np.array([-1])}, "has no person"),
        ({"ranks": (0, 5)}, "rank 0 does not exist"),
        ({"gallery_camera": np.zeros(3, np.int64)}, "are needed"),
        ({"gallery_person": np.array([1, 1])}, "none of 1 queries"),
    ],
)
def test_what_cannot_be_scored(change, message):
    zero, gallery = np.zeros(1, int), {"gallery_person": np.array([0, 1]), "gallery_camera": np.array([1, 1])}
    case = {"distance": np.zeros((1, 2)), "query_person": zero, "query_camera": zero, **gallery}
    with pytest.raises(InputError, match=message):
        retrieval_score(**(case | change))
