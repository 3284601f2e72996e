"""Where joints fix how cameras are pitched, a detector that errs by a pixel does not move the ground."""

from dataclasses import replace

import pytest

from passerby.core.observations import Observations
from passerby.evaluation.metrics import compare
from passerby.people.model import JOINED_FOOT_SHIFT_SD, Priors
from support.scenes.people_and_rigs import simulated, solve

LOW_PX = 1.0


def with_low_edges(observations: Observations) -> Observations:
    """All boxes with lower edges that lie a pixel too low."""
    cameras = {}
    for name, seen in observations.cameras.items():
        ltwh = seen.boxes.ltwh.copy()
        ltwh[:, 3] += LOW_PX
        cameras[name] = replace(seen, boxes=replace(seen.boxes, ltwh=ltwh))
    return replace(observations, cameras=cameras)


@pytest.mark.slow
def test_edges_that_lie_a_pixel_low_leave_foot_shift_and_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = simulated("basketball", 40.0, 12, missing=0.1, joint_noise_px=1.5)
    observed = with_low_edges(scene.observations)
    firm = solve(scene.rig, observed)
    monkeypatch.setattr("passerby.solver.initialisation.JOINED_FOOT_SHIFT_SD", Priors().foot_shift_sd)
    loose = solve(scene.rig, observed)
    expected = Priors().foot_shift
    assert firm.figures.foot_shift is not None
    assert loose.figures.foot_shift is not None
    assert abs(firm.figures.foot_shift - expected) < 4 * JOINED_FOOT_SHIFT_SD < abs(loose.figures.foot_shift - expected)
    ground, without = (compare(solution.rig, scene.rig).ground_error_mm for solution in (firm, loose))
    assert ground is not None
    assert without is not None
    assert ground < 0.9 * without
