"""People who move alike: cameras whose registrations have runners-up that are as good."""

import numpy as np
import pytest

from passerby.association.ambiguity import AMBIGUOUS, ambiguity, ambiguous_cameras
from passerby.association.graph import Edge, ViewGraph
from passerby.association.ground.registration import Registration

NAMES = ("C1", "C2", "C3", "C4")


def edge(a: int, b: int, runner_up: float, score: float = 100.0, *, used: bool = True) -> Edge:
    none = np.zeros(0, dtype=np.int64)
    guess = Registration(1 + 0j, 0j, 0.0, score, 100, 0.8, 0j, none, none, np.zeros(0))
    return Edge(a, b, guess, runner_up, 1.0, used)


def graph(*edges: Edge) -> ViewGraph:
    return ViewGraph(edges, ((0, 1, 2, 3),), np.zeros(4))


def test_shares_are_weighed_by_what_registrations_score() -> None:
    shares = ambiguity(graph(edge(0, 1, 0.9, 300.0), edge(0, 2, 0.1, 100.0), edge(1, 2, 0.5, 100.0)), 4)
    np.testing.assert_allclose(shares[:3], [(270 + 10) / 400, (270 + 50) / 400, (10 + 50) / 200])
    assert np.isnan(shares[3])


def test_one_doubt_names_the_cameras_and_how_well_the_others_fit() -> None:
    (found,) = ambiguous_cameras(graph(edge(0, 1, 0.98), edge(2, 3, 0.2)), NAMES)
    assert (found.code, found.severity, found.cameras) == ("arrangement_ambiguous", "doubt", ("C1", "C2"))
    assert found.values == {"runner_up": 0.98}


@pytest.mark.parametrize(
    "edges",
    [
        [edge(0, 1, 0.98), edge(0, 2, 0.1), edge(1, 2, 0.1)],
        [edge(0, 1, 2.0, used=False), edge(2, 3, AMBIGUOUS)],
        [Edge(0, 1, None, 2.0, 0.0, True), edge(2, 3, AMBIGUOUS)],
    ],
    ids=["a clear third camera makes up for it", "not used", "not registered"],
)
def test_nothing_is_doubtful(edges: list[Edge]) -> None:
    assert ambiguous_cameras(graph(*edges), NAMES) == []
