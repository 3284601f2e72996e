"""The steps of the descent's rounds: what people are expected to look like, and what is learnt from residuals."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.scale_cues import ScaleCues
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.people.model import HEIGHT_PER_CENTRE, Noise, Priors
from passerby.solver.adjustment_problem import (
    MIN_FOR_NOISE,
    POSTURE_SD,
    RigState,
    _expected_extents,
    _learn_joints,
    _on_time,
)
from passerby.solver.initialisation import Initialisation, PeopleOptions, select_initial_rig
from passerby.solver.optimizer.least_squares import Cauchy, Term
from passerby.solver.refinement import refine_rig
from support.scenes.exact_sightings import poses_of, standing
from support.scenes.people_and_rigs import LENS, part, ring, simulated, without_poses

HEIGHTS = np.array([1.6, 1.9])
GROUND = np.array([[0.5, -0.4], [-1.0, 0.8], [0.2, 1.5]])
PERSON = np.array([0, 1, 1])


def state_of(rig: Rig) -> RigState:
    R, centre = poses_of(rig)
    return RigState.start(R, centre, HEIGHTS, Priors(), np.zeros((0, 3)), np.zeros((len(rig), 0)))


@pytest.mark.parametrize("bent", [1.0, 0.5])
def test_who_stands_where_rays_meet_is_expected_as_large_as_seen_or_as_the_body_is_long(bent: float) -> None:
    """Of noisy boxes the body counts, of sure ones what was seen, and between the mean of logarithms by their variances."""
    rig = ring(4)
    seen = standing(rig, GROUND, HEIGHTS[PERSON])
    upright = seen.extent_px.copy()
    shorter = replace(seen, extent_px=bent * upright)
    middles = np.column_stack([GROUND, 0.5 * HEIGHTS[PERSON]])
    for share in (1e-6, POSTURE_SD, 1e6):
        found = _expected_extents(shorter, PERSON, state_of(rig), middles, Noise(box_px=0.0, height=share))
        by_posture = share**2 / (share**2 + POSTURE_SD**2)
        np.testing.assert_allclose(found, upright * bent ** (1 - by_posture), rtol=0.02)
    sure = _expected_extents(shorter, PERSON, state_of(rig), middles, Noise(box_px=1e-6, height=0.0))
    np.testing.assert_allclose(sure, bent * upright, rtol=1e-6)
    # Pixels that all boxes are off by count for more of a small box.
    pixels = Noise(box_px=POSTURE_SD * float(np.median(upright)) / HEIGHT_PER_CENTRE, height=0.0)
    if bent != 1:
        part = np.log(_expected_extents(shorter, PERSON, state_of(rig), middles, pixels) / shorter.extent_px)
        assert np.corrcoef(part, upright)[0, 1] < -0.9


def test_rays_of_a_clock_that_is_wrong_go_where_they_would_have_been_seen() -> None:
    rng = np.random.default_rng(1)
    pixels = rng.uniform([100, 100], [1100, 600], (20, 2))
    velocity, seconds = rng.normal(0, 30, (20, 2)), rng.uniform(-0.2, 0.2, 20)
    ray = LENS.bearings(pixels)
    found = _on_time(ray, LENS.tangents(ray), velocity, seconds)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    np.testing.assert_allclose(LENS.project_rays(found), pixels - velocity * seconds[:, None], atol=0.05)
    np.testing.assert_allclose(_on_time(ray, LENS.tangents(ray), velocity, np.zeros(20)), ray, atol=1e-12)
    np.testing.assert_array_equal(_on_time(ray, LENS.tangents(ray), None, seconds), ray)


def test_half_of_what_a_joint_is_off_by_is_learnt_from_the_own_camera() -> None:
    """A joint that is hard to find in all cameras, more so in one; another that is seen there too seldom to tell."""
    rng = np.random.default_rng(2)
    noise = {(0, 0): 1.0, (1, 0): 1.0, (0, 1): 2.0, (1, 1): 4.0, (0, 2): 3.0, (1, 2): 9.0}
    count = dict.fromkeys(noise, 2000) | {(1, 2): MIN_FOR_NOISE - 1}
    camera, kind = (np.repeat([key[k] for key in noise], [count[key] for key in noise]) for k in range(2))
    residual = np.repeat(list(noise.values()), [count[key] for key in noise])[:, None] * rng.normal(size=(len(kind), 2))
    n = len(kind)
    joints = SimpleNamespace(camera=camera, point=np.arange(n), sigma_px=np.full(n, 1e3))
    model: Any = SimpleNamespace(
        problem=SimpleNamespace(n_cameras=2, joints=joints, noise=Noise(floor_px=1e-6)), joint_kind=kind
    )
    normal: Any = SimpleNamespace(families=[None, SimpleNamespace(V=np.tile(1e9 * np.eye(3), (n, 1, 1)))])
    term = Term(residual, Cauchy(1e6), by_block=np.ones((n, 2, 3)), block=np.arange(n))
    learnt = _learn_joints(model, term, normal)
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
    start = Initialisation.prepare(without_poses(truth.rig), part(truth.observations), ScaleCues(), options, rng)
    rough = select_initial_rig(start, options, rng).state
    small = replace(rough, centre=0.75 * rough.centre, heights=0.75 * rough.heights)
    fit = refine_rig(start, small, options, rng)
    at, below, above = (
        sum(term.cost() for term in fit.model.problem.terms(fit.result.state.scaled(scale), jacobians=False))
        for scale in (1.0, 0.99, 1.01)
    )
    assert at < min(below, above)
    assert np.mean(fit.result.state.heights) == pytest.approx(PERSON_HEIGHT_M, rel=0.02)
