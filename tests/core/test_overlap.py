"""Who is seen together, against the definition."""

from __future__ import annotations

import numpy as np

from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.core.overlap import Shared, count_shared_observations, find_connected_groups, person_instants


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
