"""A lens that is freed at an optimum: it goes where people put it, and settles there."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from passerby.core.scale_cues import ScaleCues
from passerby.solver import freed_lenses
from passerby.solver.freed_lenses import LEAST_ROUNDS, MOST_ROUNDS, refit_freed
from passerby.solver.initialisation import Fit, Initialisation, refine_in_stages, select_initial_rig
from passerby.solver.lens_scores import LensHypothesis, LensScore, score_lenses
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, without_poses

FOCAL = LensHypothesis("focal", (1,))


@cache
def fitted() -> tuple[Initialisation, Fit]:
    truth = simulated("terrace", seconds=4.0)
    options, rng = PeopleOptions(coarse_people=100), np.random.default_rng(0)
    start = Initialisation.prepare(without_poses(truth.rig), part(truth.observations), ScaleCues(), options, rng)
    return start, refine_in_stages(start, select_initial_rig(start, options, rng).state, options, rng)


def test_a_right_lens_settles_soon_and_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Freed beside its place by a little, it comes back; rounds do not go on once nothing moves."""
    start, fit = fitted()
    rounds = []

    def counted(*arguments, **named):
        rounds.append(score_lenses(*arguments, **named))
        return rounds[-1]

    monkeypatch.setattr(freed_lenses, "score_lenses", counted)
    found = refit_freed(start, fit, LensScore(FOCAL, (0.02,), (0.01,), 1.0))
    (change,) = found.changes[FOCAL]
    assert abs(change) < 3 * found.score_of(FOCAL).sd[0]
    assert found.score_of(FOCAL).gain < 2.0
    assert LEAST_ROUNDS < len(rounds) < MOST_ROUNDS
    assert (found.agreeing > 0.9).all()
