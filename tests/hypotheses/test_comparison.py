"""Alternatives compared by held-out blocks: what counts as evidence, and what alternatives cost beforehand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.core.cameras import Camera, Rig
from passerby.core.scale_cues import ScaleCues
from passerby.hypotheses.alternatives import lens_alternatives
from passerby.hypotheses.case import Case, blocks_of
from passerby.hypotheses.comparison import LOG_ODDS, Comparison, Refit, may_convince, screen
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people import PeopleSolution, solve_people
from support.scenes.people_and_rigs import LENS, part, ring, simulated, without_poses


@cache
def solved(factor: float = 1.0) -> PeopleSolution:
    """A short scene with the second focal length stated wrongly by a factor."""
    truth = simulated("terrace", seconds=8.0)
    logs = np.zeros((len(truth.rig), 1))
    logs[1] = np.log(factor)
    rig = without_poses(LensUnknowns(("focal",)).rig(truth.rig, logs))
    solution = solve_people(rig, part(truth.observations), ScaleCues(), rng=np.random.default_rng(0))
    assert isinstance(solution, PeopleSolution)
    return solution


@given(st.lists(st.floats(-20, 20), min_size=2, max_size=60), st.integers(1, 5))
def test_evidence_is_never_above_the_gain_and_changes_its_sign_with_it(gains: list[float], scale: int) -> None:
    better, worse = np.zeros(len(gains)), scale * np.array(gains)
    found, turned = Comparison.of(better, worse), Comparison.of(worse, better)
    assert found.gain == pytest.approx(sum(worse), abs=1e-9)
    assert found.log_evidence <= found.gain + 1e-9
    assert turned.gain == pytest.approx(-found.gain, abs=1e-9)
    assert min(found.log_evidence, turned.log_evidence) <= 0


def test_gains_that_scatter_are_worth_less() -> None:
    steady, rng = np.full(40, 0.5), np.random.default_rng(1)
    scattered = steady + rng.permutation(np.repeat([-6.0, 6.0], 20))
    sure, unsure = (Comparison.of(np.zeros(40), steady + noise) for noise in (rng.normal(0, 0.1, 40), scattered - steady))
    assert sure.log_evidence == pytest.approx(sure.gain)
    assert unsure.log_evidence < 0.25 * unsure.gain


def test_what_would_count_where_it_was_held_out_is_never_screened_out() -> None:
    rng, prior = np.random.default_rng(2), -3.0
    screened = 0
    for _ in range(300):
        gains = rng.normal(rng.uniform(-1, 4), rng.uniform(0.2, 6), rng.integers(2, 80))
        found = Comparison.of(np.zeros(len(gains)), gains)
        worth = may_convince(np.zeros(len(gains)), gains, prior)
        screened += not worth
        assert worth or found.log_evidence + prior <= LOG_ODDS
    assert 50 < screened < 250


@pytest.mark.parametrize("count", [4, 100])
def test_prior_odds_are_those_of_a_site_however_many_cameras_it_has(count: int) -> None:
    rig = Rig(tuple(Camera(f"C{n}", LENS) for n in range(count)))
    odds = sum(np.exp(one.log_prior) for one in lens_alternatives(rig))
    assert odds == pytest.approx(sum(np.exp(one.log_prior) for one in lens_alternatives(ring(2))))
    assert 0 < odds < 0.2


def test_one_linearisation_foretells_the_refit() -> None:
    base = Case.of(solved(1.06))
    base = base.fitted()
    alternatives = [one for one in lens_alternatives(base.stated) if one.code == "focal"]
    best = max(screen(base, alternatives), key=lambda one: one.gain)
    assert best.cameras == ("C2",)
    freed = base.with_problem(best.alternative.apply(base.problem, base.stated)).fitted()
    assert best.change == pytest.approx(freed.state.lens[1, 0], abs=0.015)
    costs = [sum(term.cost() for term in one.problem.terms(one.state, jacobians=False)) for one in (base, freed)]
    assert best.gain == pytest.approx(costs[0] - costs[1], rel=0.3)


def test_every_block_is_predicted_once_from_the_others() -> None:
    """A block costs more where it is held out than where it is fitted, on the whole, and none is left out."""
    base = Case.of(solved())
    base = base.fitted()
    every = np.ones(base.n_blocks, dtype=bool)
    held_out, in_sample = Refit.of(base).predicted, base.predicted(base, every)
    assert held_out.shape == (base.n_blocks,)
    assert (held_out > 0).all()
    assert held_out.sum() > in_sample.sum()
    np.testing.assert_allclose(held_out, in_sample, rtol=0.5)


def test_where_lenses_are_refined_nothing_is_compared() -> None:
    solution = solved()
    assert solution.start is not None
    assert Case.of(replace(solution, start=None)) is None
    assert Case.of(replace(solution, start=replace(solution.start, unknowns=LensUnknowns(("focal",))))) is None


@pytest.mark.parametrize(("seconds", "stretches"), [(3, 1), (10, 1), (19, 2), (57, 6)])
def test_blocks_have_at_most_ten_seconds(seconds: int, stretches: int) -> None:
    instant, person = np.repeat(np.arange(7, 7 + 5 * seconds), 3), np.tile([4, 1, 9], 5 * seconds)
    block, count = blocks_of(instant, person, 5.0)
    assert count == 3 * stretches
    for one in range(count):
        own = block == one
        assert len(set(person[own])) == 1
        assert np.ptp(instant[own]) < 50
