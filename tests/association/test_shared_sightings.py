"""People at an instant, by the cameras that may see them together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.association.associate import Tracklets, _seeing_one, compared_pairs
from passerby.association.graph import Edge, ViewGraph
from passerby.association.ground.ray_affinity import RayTracks
from passerby.association.sampling import STEP_S
from passerby.association.shared_sightings import joined_sightings
from passerby.core.cameras import Pose
from passerby.core.observations import Boxes, CameraObservations, Observations

CHAIN = [("A", "B"), ("B", "C"), ("E", "D")]


def seen(**rows: list[tuple[int, int]]) -> Observations:
    """Cameras that see (frame, identity)."""
    return Observations({name: CameraObservations(boxes(own)) for name, own in rows.items()})


def boxes(rows: list[tuple[int, int]]) -> Boxes:
    frame, identity = (np.array([row[k] for row in rows], dtype=np.int64) for k in (0, 1))
    n = len(rows)
    return Boxes(frame, identity, np.tile([10.0, 10.0, 20.0, 50.0], (n, 1)), np.ones(n))


def rows_of(observations: Observations) -> dict[str, list[tuple[int, int]]]:
    """The rows of each camera again."""
    return {
        name: list(zip(own.boxes.frame.tolist(), own.boxes.identity.tolist(), strict=True))
        for name, own in observations.cameras.items()
    }


BOTH = [(1, 7), (1, 8)]


@pytest.mark.parametrize(
    ("rows", "kept"),
    [
        ({"A": [(1, 7)], "B": [(1, 7)], "C": [(1, 7)], "D": [(2, 7)], "E": [(2, 7)]}, {}),
        ({"A": [(1, 7)], "B": [(1, 7)], "C": BOTH, "D": BOTH, "E": BOTH}, {"C": [(1, 7)], "D": [(1, 8)], "E": [(1, 8)]}),
        ({"A": [(1, 7), (2, 7)], "C": [(1, 7)]}, {"C": []}),
        ({"A": [], "B": []}, {}),
    ],
    ids=["a chain stays together", "in two places: where more cameras see them", "nothing joins two", "nobody"],
)
def test_a_person_stays_where_most_cameras_that_are_joined_see_them(rows: dict, kept: dict) -> None:
    assert rows_of(joined_sightings(seen(**rows), CHAIN)) == rows | kept


sightings = st.dictionaries(
    st.sampled_from("ABCDE"), st.lists(st.tuples(st.integers(0, 2), st.integers(1, 3)), unique=True, max_size=6), min_size=2
)


@given(sightings)
def test_whom_two_cameras_have_in_common_is_joined_by_pairs(rows: dict[str, list[tuple[int, int]]]) -> None:
    """The largest part of each person-instant is kept whole, and nothing else of it."""
    found = rows_of(joined_sightings(seen(**rows), CHAIN))
    for key in {key for own in rows.values() for key in own}:
        before = {name for name, own in rows.items() if key in own}
        after = {name for name, own in found.items() if key in own}
        parts = []
        for chain in ("ABC", "ED"):
            part: set[str] = set()
            for name in chain:
                if name in before:
                    part.add(name)
                elif part:
                    parts.append(part)
                    part = set()
            parts.append(part)
        assert after in parts
        assert len(after) == max(len(part) for part in parts)


def test_of_many_cameras_registered_pairs_are_compared_and_the_candidates_of_cameras_without_any() -> None:
    edges = tuple(Edge(a, b, None, 0.0, 0.0, used) for a, b, used in ((0, 1, True), (1, 2, True), (0, 2, False), (2, 3, False)))
    graph = ViewGraph(edges, ((0, 1, 2), (3,)), np.zeros(4))
    assert list(compared_pairs(graph, 4, {(0, 2), (0, 3), (2, 3)})) == [(0, 1), (0, 3), (1, 2), (2, 3)]
    assert len(compared_pairs(graph, 4, None)) == 6


def test_who_is_seen_as_one_by_cameras_at_one_time_has_their_say() -> None:
    """Cameras 0 and 1 see person 7 at the same steps of the common clock, camera 2 sees them before; camera 3 has no pose."""

    def track(steps: list[int], tracklet: int) -> RayTracks:
        n, pose = len(steps), Pose(np.eye(3), np.zeros(3))
        return RayTracks(np.array(steps), np.full(n, tracklet), np.zeros((n, 3)), np.zeros((n, 3)), np.ones(n), pose)

    first = np.array([0, 2, 3, 4, 5])  # camera 0 has two tracklets, the others one each
    tracklets = Tracklets(first, np.zeros(5), np.ones(5), (np.zeros(0, np.int64), np.zeros(0, np.int64)))
    tracks = [track([10, 11, 12], 1), track([0, 1, 2], 0), track([5, 6], 0), None]
    late, in_step = np.array([0.0, 10 * STEP_S, 0.0, 0.0]), np.zeros(4)
    for offset_s, who, pairs in ((late, [3, 7], [(0, 1)]), (in_step, [3, 7], []), (late, [7, 3], [])):
        assert _seeing_one(tracklets, tracks, offset_s, np.array([*who, 7, 7, 7])) == pairs
