"""Two grounds that are laid on each other: what fits costs nothing, and what does not costs what it misses by."""

import numpy as np
import pytest
import scipy.optimize

from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Observations
from passerby.solver import focal_search
from passerby.solver.evidence import gather_evidence
from passerby.solver.lens_unknowns import LENS_PARTS, LensUnknowns
from support.scenes.people_and_rigs import observe, ring

TURN, SHIFT = np.exp(2.3j), 17.0 - 9.0j


def places(rng: np.random.Generator, count: int = 150) -> np.ndarray:
    """On the ground, x + iy, near and far."""
    return rng.uniform(2, 30, count) * np.exp(1j * rng.uniform(-0.5, 0.5, count))


def misfit(x: np.ndarray, y: np.ndarray) -> float:
    return focal_search._misfit(x, y, *np.random.default_rng(0).integers(len(x), size=(2, 300)))


def sigma(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.hypot(*(focal_search._FLOOR_M + focal_search._SHARE * np.abs(z) for z in (x, y)))


@pytest.mark.parametrize("wrong", [15, 75])
def test_the_cost_is_the_least_that_any_turn_and_shift_leaves(wrong: int) -> None:
    """Of places that are known the worse the farther they are, a tenth or a half of them quite wrong."""
    rng = np.random.default_rng(2)
    x = places(rng)
    y = TURN * x + SHIFT
    y += sigma(x, y) * (rng.normal(size=len(x)) + 1j * rng.normal(size=len(x)))
    some = rng.permutation(len(x))[:wrong]
    y[some] += 20 * (rng.normal(size=wrong) + 1j * rng.normal(size=wrong))

    def cost(way: np.ndarray) -> float:
        moved = np.exp(1j * way[0]) * x + way[1] + 1j * way[2]
        return float(np.log1p((np.abs(moved - y) / sigma(x, y)) ** 2).sum())

    best = scipy.optimize.minimize(cost, [np.angle(TURN), SHIFT.real, SHIFT.imag], method="Nelder-Mead", tol=1e-8)
    assert misfit(x, y) == pytest.approx(best.fun, rel=1e-3)


def test_a_minority_that_agrees_on_another_way_does_not_win() -> None:
    """Two of five people are taken for each other throughout, and look as if the cameras stood on one spot."""
    x = places(np.random.default_rng(5))
    y, other = TURN * x + SHIFT, np.arange(len(x)) % 5 < 2
    y[other] = np.conj(TURN) * x[other]
    missed = np.log1p((np.abs(TURN * x + SHIFT - y) / sigma(x, y)) ** 2)
    assert misfit(x, y) == pytest.approx(float(missed.sum()), rel=0.02)


def test_places_that_are_nowhere_cost_as_much_as_those_that_miss_by_far() -> None:
    """Where few are somewhere, all of them cost as much."""
    x = places(np.random.default_rng(3), 40)
    y = TURN * x + SHIFT
    y[:5], x[5:8] = np.nan, 1.01 * focal_search._FARTHEST_M
    assert misfit(x, y) == pytest.approx(8 * focal_search._NOWHERE)
    for somewhere, cost in ((3, 40 * focal_search._NOWHERE), (30, 10 * focal_search._NOWHERE)):
        assert misfit(np.where(np.arange(40) < somewhere, x[::-1], np.nan), y[::-1]) == pytest.approx(cost)


def test_every_two_focal_lengths_are_compared_by_the_people_that_both_saw() -> None:
    """The second of three grounds of one camera fits the first of the other; the last could not be levelled."""
    rng = np.random.default_rng(4)
    x = places(rng, 60)
    order = rng.permutation(60)
    y = (TURN * x + SHIFT)[order]
    one = focal_search._Grounds(np.array([-0.2, 0.0, 0.2]), [x * np.exp(0.3), x, None])
    squeezed, mirrored = y.real * 1.6 + 1j * y.imag, np.conj(y)
    other = focal_search._Grounds(np.array([0.0, 0.3, 0.4]), [y, squeezed, mirrored])
    cost = focal_search.pair_costs(one, other, order, np.arange(60), rng)
    assert cost.shape == (3, 3)
    assert cost[1, 0] == pytest.approx(0.0, abs=1e-9)
    assert (cost[[0, 0, 0, 1, 1], [0, 1, 2, 1, 2]] > 5).all()
    assert cost[2] == pytest.approx(60 * focal_search._NOWHERE)


def test_cameras_that_share_too_few_people_keep_their_guesses() -> None:
    rng = np.random.default_rng(6)
    true = Rig(ring(5).cameras[:2])
    stated = Rig(tuple(Camera(camera.name, Lens.unknown(camera.lens.size)) for camera in true))
    for count, searched in ((3, False), (40, True)):
        ground = rng.uniform(-1.5, 1.5, (count, 2))
        seen = observe(true, ground, np.full(count, 1.72), np.arange(count), np.zeros(count, int))
        evidence = gather_evidence(stated, Observations(seen), rng)
        assert len(evidence.sightings) == 2 * count
        found = focal_search.search_focals(evidence, stated, LensUnknowns(LENS_PARTS), 1.72, rng)
        assert [camera.lens.start_sd == focal_search.FOUND_SD for camera in found] == [searched] * 2
        assert [camera.lens is before.lens for camera, before in zip(found, stated, strict=True)] == [not searched] * 2
