"""How many rounds the adjustment goes, by what it learns of the boxes."""

import numpy as np
import pytest

from passerby.core.scale_cues import ScaleCues
from passerby.solver.initialisation import Initialisation, select_initial_rig
from passerby.solver.people import PeopleOptions
from passerby.solver.refinement import refine_rig
from support.scenes.people_and_rigs import part, simulated, without_poses


@pytest.mark.slow
@pytest.mark.parametrize(("box_noise", "more"), [(0.0, False), (0.2, True)])
def test_rounds_go_on_while_the_noise_grows(box_noise: float, more: bool) -> None:
    """Two rounds are two where boxes are exact, and more where noise (a fifth of the height) is underrated at first."""
    truth = simulated("terrace", seconds=6.0, box_noise=box_noise)
    options, rng = PeopleOptions(coarse_people=100, rounds=2), np.random.default_rng(0)
    start = Initialisation.prepare(without_poses(truth.rig), part(truth.observations), ScaleCues(), options, rng)
    rounds = refine_rig(start, select_initial_rig(start, options, rng).state, options, rng).rounds
    assert (len(rounds) > 2) == more
    assert len(rounds) < 8


def test_nobody_is_renamed_by_the_first_rough_rig() -> None:
    truth = simulated("terrace", seconds=6.0, identity_swaps=0.2)
    options, rng = PeopleOptions(coarse_people=100, rounds=2), np.random.default_rng(0)
    start = Initialisation.prepare(without_poses(truth.rig), part(truth.observations), ScaleCues(), options, rng)
    rounds = refine_rig(start, select_initial_rig(start, options, rng).state, options, rng).rounds
    assert rounds[0].renamed == 0
    assert all(one.renamed > 0 for one in rounds[1:])
