"""Corrections of the input: in which order, and how often at most."""

from __future__ import annotations

from dataclasses import replace

import pytest

from passerby.association.result import Association
from passerby.calibration.estimation import Estimate
from passerby.calibration.repairs import Correction, Repair, Repaired, apply_repairs
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.scene.inputs import SceneInputs

NOBODY = Observations({})
INPUTS = SceneInputs(Rig(()), NOBODY, ())


class Fault:
    """A fault that shows until it has been corrected so many times; each correction leaves its name in the findings."""

    def __init__(self, name: str, times: float) -> None:
        self.name, self.times = name, times

    def __call__(self, inputs: SceneInputs, estimate: Estimate) -> Correction | None:
        assert estimate.solution.method == "".join(inputs.findings), "the estimate is of these inputs"
        if inputs.findings.count(self.name) >= self.times:
            return None
        return Correction(replace(inputs, findings=(*inputs.findings, self.name)))


def repaired(*repairs: Repair) -> tuple[Repaired, int]:
    estimates = []

    def estimator(inputs: SceneInputs) -> Estimate:
        estimates.append(inputs)
        return Estimate(Solution("".join(inputs.findings), inputs.rig, "accepted"), Association(NOBODY, NOBODY, {}))

    return apply_repairs(INPUTS, estimator, repairs), len(estimates)


def test_sound_inputs_are_estimated_once():
    found, estimates = repaired(Repair(Fault("a", 0), 5), Repair(Fault("b", 0), 5))
    assert (found.inputs, found.corrections, estimates) == (INPUTS, (), 1)


def test_the_first_repair_is_asked_again_after_each_correction():
    found, estimates = repaired(Repair(Fault("a", 2), 5), Repair(Fault("b", 1), 5))
    assert found.inputs.findings == ("a", "a", "b")
    assert found.estimate.solution.method == "aab"
    assert [one.inputs.findings for one in found.corrections] == [("a",), ("a", "a"), ("a", "a", "b")]
    assert estimates == 4


@pytest.mark.parametrize(("most_a", "most_b"), [(0, 3), (2, 0), (6, 4)])
def test_estimates_are_bounded(most_a: int, most_b: int):
    endless = float("inf")
    found, estimates = repaired(Repair(Fault("a", endless), most_a), Repair(Fault("b", endless), most_b))
    assert found.inputs.findings == ("a",) * most_a + ("b",) * most_b
    assert estimates == 1 + most_a + most_b
