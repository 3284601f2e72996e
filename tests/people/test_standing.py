"""Who stands, from the heights that are seen."""

import numpy as np
import pytest

from passerby.people.standing import standing_instants, standing_share


def seen(rng: np.random.Generator, share: float, count: int, spread: float = 0.02) -> np.ndarray:
    return share + spread * rng.normal(size=count)


@pytest.mark.parametrize(("crouching", "reaching"), [(0.0, 0.0), (0.6, 0.0), (0.0, 0.1)])
def test_standing_is_the_highest_frequent_height(crouching: float, reaching: float) -> None:
    """Even of somebody who crouches most of the time (the mean would be 17 % off), or reaches up now and then."""
    rng = np.random.default_rng(0)
    down, arms = int(400 * crouching), int(400 * reaching)
    ratio = np.concatenate([seen(rng, 0.97, 400 - down - arms), rng.uniform(0.55, 0.8, down), seen(rng, 1.17, arms)])
    assert standing_share(ratio) == pytest.approx(0.97, abs=0.015)


def test_the_grid_holds_one_height_alone() -> None:
    assert standing_share(np.array([1.0])) == pytest.approx(1.0, abs=0.005)
    assert np.isfinite(standing_share(np.array([5.0, 7.0])))


def test_each_person_is_judged_by_their_own_height_and_who_reaches_does_not_stand() -> None:
    """A small person who stands and a tall one who bends look alike to a common height."""
    rng = np.random.default_rng(2)
    parts = [(1.55, 60), (1.9, 40), (1.9 * 0.815, 20), (1.9 * 1.2, 10)]
    extent = np.concatenate([share * seen(rng, 1, count, 0.008) for share, count in parts])
    found = standing_instants(extent, np.full(130, 1.72), np.repeat([0, 1], [60, 70]))
    assert found[:60].mean() > 0.95
    assert found[60:100].mean() > 0.95
    assert found[100:120].mean() < 0.05
    assert found[120:].mean() < 0.05


def test_somebody_seen_a_few_times_is_judged_by_everyone() -> None:
    rng = np.random.default_rng(4)
    extent = 1.72 * np.concatenate([seen(rng, 0.95, 200, 0.01), [0.95, 0.7]])
    person = np.concatenate([np.zeros(200, int), [1, 1]])
    assert standing_instants(extent, np.full(202, 1.72), person)[-2:].tolist() == [1, 0]
    assert standing_instants(np.array([1.72, 1.0]), np.full(2, 1.72), np.zeros(2, int)).tolist() == [1, 0]
    assert len(standing_instants(np.zeros(0), np.zeros(0), np.zeros(0, int))) == 0
