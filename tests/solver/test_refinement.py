"""The steps of the descent's rounds, and the comparison of optima by people who are held out."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.people.model import HEIGHT_PER_CENTRE, Noise, Priors
from passerby.solver import adjustment_problem
from passerby.solver.block_prediction import FOLDS, HeldOutBlocks, compare_predictions, held_out_blocks, predicted_costs
from passerby.solver.initialisation import PeopleOptions, select_initial_rig
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.optimizer.least_squares import Cauchy, Term
from passerby.solver.refinement import Fit, refine_rig
from support.scenes.exact_sightings import poses_of, standing
from support.scenes.fits import fitted, started
from support.scenes.people_and_rigs import LENS, part, ring, simulated

HEIGHTS = np.array([1.6, 1.9])
GROUND = np.array([[0.5, -0.4], [-1.0, 0.8], [0.2, 1.5]])
PERSON = np.array([0, 1, 1])


def state_of(rig: Rig) -> adjustment_problem.RigState:
    R, centre = poses_of(rig)
    return adjustment_problem.RigState.start(R, centre, HEIGHTS, Priors(), np.zeros((0, 3)), np.zeros((len(rig), 0)))


@pytest.mark.parametrize("bent", [1.0, 0.5])
def test_people_where_rays_meet_are_expected_as_large_as_seen_or_as_the_body_is_long(bent: float) -> None:
    """Of noisy boxes the body counts, of sure ones what was seen, and between the mean of logarithms by their variances."""
    rig = ring(4)
    seen = standing(rig, GROUND, HEIGHTS[PERSON])
    upright = seen.extent_px.copy()
    shorter = replace(seen, extent_px=bent * upright)
    middles = np.column_stack([GROUND, 0.5 * HEIGHTS[PERSON]])
    for share in (1e-6, adjustment_problem.POSTURE_SD, 1e6):
        found = adjustment_problem._expected_extents(shorter, PERSON, state_of(rig), middles, Noise(box_px=0.0, height=share))
        by_posture = share**2 / (share**2 + adjustment_problem.POSTURE_SD**2)
        np.testing.assert_allclose(found, upright * bent ** (1 - by_posture), rtol=0.02)
    sure = adjustment_problem._expected_extents(shorter, PERSON, state_of(rig), middles, Noise(box_px=1e-6, height=0.0))
    np.testing.assert_allclose(sure, bent * upright, rtol=1e-6)
    # Pixels that all boxes are off by count for more of a small box.
    pixels = Noise(box_px=adjustment_problem.POSTURE_SD * float(np.median(upright)) / HEIGHT_PER_CENTRE, height=0.0)
    if bent != 1:
        part = np.log(adjustment_problem._expected_extents(shorter, PERSON, state_of(rig), middles, pixels) / shorter.extent_px)
        assert np.corrcoef(part, upright)[0, 1] < -0.9


def test_rays_of_a_clock_that_is_wrong_go_where_they_would_have_been_seen() -> None:
    rng = np.random.default_rng(1)
    pixels = rng.uniform([100, 100], [1100, 600], (20, 2))
    velocity, seconds = rng.normal(0, 30, (20, 2)), rng.uniform(-0.2, 0.2, 20)
    ray = LENS.bearings(pixels)
    found = adjustment_problem._on_time(ray, LENS.tangents(ray), velocity, seconds)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    np.testing.assert_allclose(LENS.project_rays(found), pixels - velocity * seconds[:, None], atol=0.05)
    np.testing.assert_allclose(adjustment_problem._on_time(ray, LENS.tangents(ray), velocity, np.zeros(20)), ray, atol=1e-12)
    np.testing.assert_array_equal(adjustment_problem._on_time(ray, LENS.tangents(ray), None, seconds), ray)


def test_half_of_what_a_joint_is_off_by_is_learnt_from_the_own_camera() -> None:
    """A joint that is hard to find in all cameras, more so in one; another that is seen there too seldom to tell."""
    rng = np.random.default_rng(2)
    noise = {(0, 0): 1.0, (1, 0): 1.0, (0, 1): 2.0, (1, 1): 4.0, (0, 2): 3.0, (1, 2): 9.0}
    count = dict.fromkeys(noise, 2000) | {(1, 2): 3}
    camera, kind = (np.repeat([key[k] for key in noise], [count[key] for key in noise]) for k in range(2))
    residual = np.repeat(list(noise.values()), [count[key] for key in noise])[:, None] * rng.normal(size=(len(kind), 2))
    n = len(kind)
    joints = SimpleNamespace(camera=camera, point=np.arange(n), sigma_px=np.full(n, 1e3))
    model: Any = SimpleNamespace(
        problem=SimpleNamespace(n_cameras=2, joints=joints, noise=Noise(floor_px=1e-6)), joint_kind=kind
    )
    normal: Any = SimpleNamespace(families=[None, SimpleNamespace(V=np.tile(1e9 * np.eye(3), (n, 1, 1)))])
    term = Term(residual, Cauchy(1e6), by_block=np.ones((n, 2, 3)), block=np.arange(n))
    learnt = adjustment_problem._learn_joints(model, term, normal)
    sigma = learnt.joint * learnt.kinds / Noise().joint
    # Where both cameras are alike it is the truth itself.
    assert sigma[0, 0] == pytest.approx(1.0, rel=0.05)
    np.testing.assert_allclose(sigma[:, 0] / sigma[0, 0], [1.0, 1.0], rtol=0.05)
    assert sigma[1, 1] / sigma[0, 1] == pytest.approx(np.sqrt(4.0 / 2.0), rel=0.05)
    np.testing.assert_allclose(sigma[:, 2], [3.0, 3.0], rtol=0.05)


def test_the_scale_is_the_best_even_where_the_adjustment_ends_early() -> None:
    """From a rig that is a quarter too small: one step for each round, damped by thousands of sightings."""
    truth = simulated("terrace", seconds=6.0)
    options = PeopleOptions(coarse_people=100, rounds=1, max_iterations=1)
    rng = np.random.default_rng(0)
    start = started(truth.rig, part(truth.observations), options, rng=rng)
    rough = select_initial_rig(start, options, rng).state
    small = replace(rough, centre=0.75 * rough.centre, heights=0.75 * rough.heights)
    fit = refine_rig(start, small, options, rng)
    at, below, above = (
        sum(term.cost() for term in fit.model.problem.terms(fit.result.state.scaled(scale), jacobians=False))
        for scale in (1.0, 0.99, 1.01)
    )
    assert at < min(below, above)
    assert np.mean(fit.result.state.heights) == pytest.approx(PERSON_HEIGHT_M, rel=0.02)


SCENE = simulated("basketball")
FPS = SCENE.observations.fps or 1.0


@cache
def fit_of(focal_factor: float) -> Fit:
    """The optimum by boxes, the second camera's focal length stated wrong by a factor."""
    change = np.zeros((len(SCENE.rig), 1))
    change[1] = np.log(focal_factor)
    rig = LensUnknowns(("focal",)).rig(SCENE.rig, change)
    return fitted(rig, part(SCENE.observations), PeopleOptions(max_sightings=3000, coarse_people=200))


def blocks_of(*fits: Fit) -> HeldOutBlocks:
    return held_out_blocks(fits[0].start.evidence, fits, FPS)


def test_a_block_is_one_person_for_some_seconds_and_all_folds_have_some() -> None:
    fit = fit_of(1.0)
    evidence, blocks = fit.start.evidence, blocks_of(fit)
    assert set(blocks.fold) == set(range(FOLDS))
    for block in range(len(blocks.fold)):
        rows = blocks.people[blocks.of_people == block]
        assert len(set(evidence.person[rows])) == 1
        assert np.ptp(evidence.frame[rows]) <= 10 * FPS
    assert set(blocks.of_people) == set(range(len(blocks.fold)))
    assert set(blocks.sightings) <= set(fit.model.rows)
    costs = predicted_costs(fit, blocks, fit)
    assert (costs > 0).all()
    assert compare_predictions(costs, costs).gain == 0, "the same optimum gains nothing"


@pytest.mark.slow
def test_a_wrong_lens_predicts_people_worse_and_a_free_one_no_better_than_the_right_one() -> None:
    right, wrong = fit_of(1.0), fit_of(1.1)
    blocks = blocks_of(wrong, right)
    found = compare_predictions(predicted_costs(wrong, blocks, wrong), predicted_costs(right, blocks, wrong))
    assert found.sigmas > 3
    back = compare_predictions(predicted_costs(right, blocks, wrong), predicted_costs(wrong, blocks, wrong))
    assert back.gain == pytest.approx(-found.gain)
    loose = right.start.with_unknowns(("focal",))
    free = replace(right, start=loose, result=replace(right.result, state=replace(right.result.state, lens=loose.lens)))
    blocks = blocks_of(right, free)
    found = compare_predictions(predicted_costs(right, blocks, right), predicted_costs(free, blocks, right))
    assert found.sigmas < 2


def test_gains_are_counted_by_blocks_and_few_blocks_are_no_evidence() -> None:
    before, after = np.array([5.0, 4.0, 3.0, 6.0, 7.0, 0.0]), np.array([4.0, 2.0, 3.5, 4.0, 5.5, 0.0])
    found = compare_predictions(before, after)
    gains = np.array([1.0, 2.0, -0.5, 2.0, 1.5])
    assert found.blocks == 5
    assert found.gain == pytest.approx(gains.sum())
    assert found.sigmas == pytest.approx(gains.mean() / (gains.std(ddof=1) / np.sqrt(5)))
    assert compare_predictions(np.array([9.0, 8.0]), np.array([1.0, 1.0])).sigmas == 0
