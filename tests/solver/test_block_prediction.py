"""Optima are compared by people who are held out: the wrong one predicts them worse, over blocks of one person each."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.scale_cues import ScaleCues
from passerby.solver.block_prediction import (
    FOLDS,
    HeldOutBlocks,
    compare_predictions,
    held_out_blocks,
    predicted_costs,
)
from passerby.solver.initialisation import Initialisation, PeopleOptions, select_initial_rig
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.refinement import Fit, refine_rig
from support.scenes.people_and_rigs import part, simulated, without_poses

SCENE = simulated("basketball")
FPS = SCENE.observations.fps or 1.0


@cache
def fitted(focal_factor: float) -> Fit:
    """The optimum by boxes, the second camera's focal length stated wrong by a factor."""
    change = np.zeros((len(SCENE.rig), 1))
    change[1] = np.log(focal_factor)
    rig: Rig = without_poses(LensUnknowns(("focal",)).rig(SCENE.rig, change))
    options, rng = PeopleOptions(max_sightings=3000, coarse_people=200), np.random.default_rng(0)
    start = Initialisation.prepare(rig, part(SCENE.observations), ScaleCues(), options, rng)
    return refine_rig(start, select_initial_rig(start, options, rng).state, options, rng)


def blocks_of(*fits: Fit) -> HeldOutBlocks:
    return held_out_blocks(fits[0].start.evidence, fits, FPS)


def test_a_block_is_one_person_for_some_seconds_and_all_folds_have_some() -> None:
    fit = fitted(1.0)
    evidence, blocks = fit.start.evidence, blocks_of(fit)
    assert set(blocks.fold) == set(range(FOLDS))
    for block in range(len(blocks.fold)):
        rows = blocks.people[blocks.of_people == block]
        assert len(set(evidence.person[rows])) == 1
        assert np.ptp(evidence.frame[rows]) <= 10 * FPS
    assert set(blocks.of_people) == set(range(len(blocks.fold)))
    assert set(blocks.sightings) <= set(fit.model.rows)


def test_the_same_optimum_gains_nothing() -> None:
    fit = fitted(1.0)
    blocks = blocks_of(fit)
    costs = predicted_costs(fit, blocks, fit)
    assert (costs > 0).all()
    assert compare_predictions(costs, costs).gain == 0


@pytest.mark.slow
def test_a_wrong_lens_predicts_people_worse() -> None:
    right, wrong = fitted(1.0), fitted(1.1)
    blocks = blocks_of(wrong, right)
    found = compare_predictions(predicted_costs(wrong, blocks, wrong), predicted_costs(right, blocks, wrong))
    assert found.sigmas > 3
    back = compare_predictions(predicted_costs(right, blocks, wrong), predicted_costs(wrong, blocks, wrong))
    assert back.gain == pytest.approx(-found.gain)


@pytest.mark.slow
def test_a_free_lens_with_its_prior_predicts_no_better_than_the_right_one() -> None:
    fit = fitted(1.0)
    loose = fit.start.with_unknowns(("focal",))
    free = replace(fit, start=loose, result=replace(fit.result, state=replace(fit.result.state, lens=loose.lens)))
    blocks = blocks_of(fit, free)
    found = compare_predictions(predicted_costs(fit, blocks, fit), predicted_costs(free, blocks, fit))
    assert found.sigmas < 2


def test_gains_are_counted_by_blocks_and_few_blocks_are_no_evidence() -> None:
    before, after = np.array([5.0, 4.0, 3.0, 6.0, 7.0, 0.0]), np.array([4.0, 2.0, 3.5, 4.0, 5.5, 0.0])
    found = compare_predictions(before, after)
    gains = np.array([1.0, 2.0, -0.5, 2.0, 1.5])
    assert found.blocks == 5
    assert found.gain == pytest.approx(gains.sum())
    assert found.sigmas == pytest.approx(gains.mean() / (gains.std(ddof=1) / np.sqrt(5)))
    assert compare_predictions(np.array([9.0, 8.0]), np.array([1.0, 1.0])).sigmas == 0
