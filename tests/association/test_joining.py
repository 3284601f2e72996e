"""Tracklets joined to people: small cases, and what must hold of all."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.association.correlation_clustering import cluster_tracklets, find_overlaps

NEVER = -1e9
"""Weight of two tracklets that cannot be one person."""


Edge = tuple[int, int, float]


def joined(n: int, *edges: tuple[int, int, float]) -> list[int]:
    first, second, weight = (np.array(column) for column in zip(*edges, strict=True)) if edges else (np.zeros(0),) * 3
    return cluster_tracklets(n, first.astype(np.int64), second.astype(np.int64), weight.astype(np.float64)).tolist()


SQUARE = [(0, 1, 5.0), (2, 3, 5.0), (1, 2, 2.0)]
"""0 with 1 and 2 with 3 join first; then the sum between the two groups decides."""


@pytest.mark.parametrize(
    ("edges", "people"),
    [
        ([], [0, 1, 2]),
        ([(0, 3, 0.1), (1, 2, -0.1)], [0, 1, 2, 0]),
        (SQUARE, [0, 0, 0, 0]),
        ([*SQUARE, (0, 3, -2.5)], [0, 0, 1, 1]),
        ([*SQUARE, (0, 3, -1.5)], [0, 0, 0, 0]),
        # Tracklet 1 fits both 0 and 2, who are two people: the stronger joins first.
        ([(0, 1, 1.0), (1, 2, 3.0), (0, 2, NEVER)], [0, 1, 1]),
        ([(0, 1, 3.0), (1, 2, 1.0), (0, 2, NEVER)], [0, 0, 1]),
        # Edges that stand twice are added, and loops say nothing.
        ([(0, 1, 1.0), (1, 0, -2.0)], [0, 1]),
        ([(0, 1, -1.0), (1, 0, 2.0), (0, 0, NEVER)], [0, 0]),
        # Never reaches through a chain; one cut is enough, at the weakest link.
        ([(0, 5, NEVER), *((i, i + 1, 10.0 - i) for i in range(5))], [0, 0, 0, 0, 0, 1]),
    ],
)  # fmt: skip
def test_small_cases(edges: list[Edge], people: list[int]) -> None:
    assert joined(len(people), *edges) == people


EDGES = st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8), st.floats(-10, 10)), max_size=40)
PAIRS = st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)).filter(lambda pair: pair[0] != pair[1]), max_size=12)


@given(edges=EDGES, never=PAIRS)
def test_never_is_never_broken(edges: list[Edge], never: list[tuple[int, int]]) -> None:
    group = joined(9, *edges, *((i, j, NEVER) for i, j in never))
    assert len(group) == 9
    for i, j in never:
        assert group[i] != group[j]


@given(edges=EDGES)
def test_no_two_groups_are_left_that_gain_by_joining(edges: list[Edge]) -> None:
    """And groups are numbered by their first members; the order of the edges does not matter for equal sums."""
    group = joined(9, *edges)
    between = np.zeros((9, 9))
    for i, j, weight in edges:
        if group[i] != group[j]:
            between[group[i], group[j]] += weight
            between[group[j], group[i]] += weight
    assert between.max() < 1e-9
    assert list(dict.fromkeys(group)) == list(range(max(group) + 1))


@given(sizes=st.lists(st.integers(1, 4), min_size=1, max_size=5), seed=st.integers(0, 1000))
def test_clear_people_are_found_as_they_are(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    person = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    first, second = np.triu_indices(len(person), 1)
    weight = np.where(person[first] == person[second], 1.0, -1.0) * rng.uniform(0.1, 5.0, len(first))
    group = cluster_tracklets(len(person), first, second, weight)
    np.testing.assert_array_equal(group[:, None] == group, person[:, None] == person)


@given(
    spans=st.lists(st.tuples(st.integers(0, 20), st.integers(0, 12)), max_size=14), slack=st.sampled_from([0.0, 0.3, 1.5, 4.0])
)
def test_overlaps_are_those_that_brute_force_finds(spans: list[tuple[int, int]], slack: float) -> None:
    start = np.array([begin for begin, _ in spans], dtype=np.float64)
    end = start + np.array([length for _, length in spans], dtype=np.float64)
    i, j = find_overlaps(start, end, slack)
    found = list(zip(i.tolist(), j.tolist(), strict=True))
    wanted = {(m, n) for n in range(len(spans)) for m in range(n) if min(end[m], end[n]) - max(start[m], start[n]) > slack}
    assert (len(found), set(found)) == (len(set(found)), wanted)
