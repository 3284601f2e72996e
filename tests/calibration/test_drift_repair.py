"""Clocks that drift: told in every mode, and set right by the people where that is asked for."""

from functools import cache

import pytest

import passerby
from passerby.association.clocks.drift import Drift
from passerby.calibration.calibration import Calibration
from passerby.calibration.clock_skew import relative_to_first
from passerby.evaluation.metrics import compare
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

pytestmark = pytest.mark.system

FPS = 5.0


@cache
def scene(*, unrelated_ids: bool = False) -> SimulatedScene:
    return simulate(SimulationOptions(seconds=30.0, people=6, box_noise=0.02, seed=2, unrelated_ids=unrelated_ids))


def calibrated(simulated: SimulatedScene, rates: dict[str, float], association: dict[str, object], *refine: str) -> Calibration:
    boxes = {name: simulated.observations[name].boxes for name in simulated.rig.names}
    fps = dict.fromkeys(simulated.rig.names, FPS) | rates
    return passerby.calibrate_observations(simulated.rig, boxes, fps=fps, association=association, solver={"refine": refine})


STATED = FPS * 25 / 24


@pytest.mark.parametrize(
    ("association", "unrelated"),
    [({"mode": "given"}, False), ({"mode": "given", "max_offset_s": 1.0}, False), ({"mode": "combined"}, True)],
    ids=["in step", "searched", "found"],
)
def test_a_clock_that_drifts_is_set_right(association, unrelated):
    simulated = scene(unrelated_ids=unrelated)
    calibration = calibrated(simulated, {"C3": STATED}, association, "clock_rate")
    assert calibration.verdict == "accepted", calibration.reasons
    (told,) = [finding for finding in calibration.findings if "was estimated" in finding]
    assert told.startswith("the frame rate of C3 was estimated: ")
    assert "instead of the stated 5.20833" in told
    fitted = calibration.figures.clock_rates["C3"]
    assert fitted.stated == STATED
    assert fitted.fps == pytest.approx(FPS, abs=min(3 * fitted.sigma, 0.02))
    assert calibration.association.clocks["C3"].fps == fitted.fps
    assert calibration.to_dict()["cameras"][2]["fps"] == fitted.fps
    judged = compare(calibration.rig, simulated.rig).similarity
    assert judged.mean_position_mm < 35  # measured 22; 39 with the drift
    assert judged.mean_orientation_deg < 0.2


def test_identities_given_and_no_clock_searched_for_a_drift_is_told():
    calibration = calibrated(scene(), {"C3": STATED}, {"mode": "given"})
    assert calibration.verdict == "doubtful"
    (told,) = [reason for reason in calibration.reasons if "drifts" in reason]
    assert told.startswith("the clock of C3 drifts by 1.")
    assert told.endswith('check fps, or estimate it: under [solver] set refine = ["clock_rate"]')


def test_clocks_in_step_stay_as_stated():
    plain, fitted = (calibrated(scene(), {}, {"mode": "given"}, *refine) for refine in ((), ("clock_rate",)))
    assert fitted.verdict == plain.verdict == "accepted"
    assert not fitted.findings
    assert {rate.fps for rate in fitted.figures.clock_rates.values()} == {FPS}
    assert plain.figures.clock_rates is None


@pytest.mark.smoke
def test_of_two_clocks_the_first_is_believed():
    drifts = relative_to_first({"C1": Drift(0.02, 0.001, 30.0), "C2": Drift(-0.02, 0.001, 30.0)})
    assert drifts["C1"].rate == 0
    assert drifts["C2"].rate == -0.04
