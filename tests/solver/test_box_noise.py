"""Boxes that are off by pixels rather than by a share of their size: what is learnt of them, and what is said of the result."""

from functools import cache

import numpy as np
import pytest

from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.evaluation.metrics import Comparison, compare
from passerby.solver.occlusion import weight_truncated_boxes
from support.scenes.people_and_rigs import part, simulated, solve
from support.tiers import thinned

PER_PX = np.sqrt(1 / 6)
"""Standard deviation of a box's centre where both of its corners are off by up to one pixel either way."""


@cache
def solved(preset: str, corner_noise_px: float) -> tuple[Solution, Comparison]:
    truth = simulated(preset, corner_noise_px=corner_noise_px)
    seen: Observations = part(truth.observations)
    solution = solve(truth.rig, seen)
    return solution, compare(solution.rig, truth.rig)


@pytest.mark.slow
@thinned("preset", ["terrace", "basketball"])
def test_noise_as_large_as_a_third_of_the_people_leaves_the_rig_good(preset: str) -> None:
    # The paper fails from 20 px on (Xu et al., CVPR 2021, table 3: 1692 mm and 28.5 degrees, 3093 mm and 49.2 degrees).
    _, found = solved(preset, 20.0)
    assert not found.missing
    assert found.similarity.mean_position_mm < 100
    assert found.similarity.mean_orientation_deg < 0.5


@pytest.mark.slow
def test_pixels_that_every_box_is_off_by_are_learnt() -> None:
    # Edges that are off evenly pass for broken ones in part, so that a little less is learnt: 5.3 to 8.4 px over six scenes.
    noise = solved("basketball", 20.0)[0].figures.noise
    assert 0.6 < noise.box_px / (20 * PER_PX) < 1.1
    clean = solved("basketball", 0.0)[0].figures.noise
    assert clean.box_px < 1.0


@pytest.mark.slow
@thinned("preset", ["terrace", "basketball"])
def test_boxes_that_hardly_show_people_are_not_relied_upon(preset: str) -> None:
    solution, found = solved(preset, 50.0)
    assert found.similarity.mean_orientation_deg > 0.5
    assert solution.verdict == "doubtful"
    assert any("of their own height" in reason for reason in solution.reasons)


def test_edges_as_noisy_as_broken_ones_do_not_all_pass_for_broken() -> None:
    rng = np.random.default_rng(0)
    judged = weight_truncated_boxes(rng.normal(0, 0.3, 2000), rng.normal(0, 0.3, 2000))
    assert judged.broken < 0.1
    assert np.median(judged.weight) > 0.7
