"""What drifts of clocks change in the frame rates, and what is too little or too unsure to change them."""

from types import SimpleNamespace

import pytest

from passerby.association.clocks.drift import Drift
from passerby.calibration.clock_skew import clock_rate_figures, correct_clock_rates
from passerby.core.observations import CameraObservations, Observations
from passerby.scene.inputs import SceneInputs
from support.scenes.people_and_rigs import ring

FPS, SPAN_S = 25.0, 100.0
RIG = ring(3)
INPUTS = SceneInputs(RIG, Observations({name: CameraObservations() for name in RIG.names}, FPS), findings=())


def estimated(**drifts):
    """Of these cameras (rate, sigma); the others are in step."""
    every = {name: Drift(*drifts.get(name, (0.0, 1e-5)), SPAN_S) for name in RIG.names}
    return SimpleNamespace(association=SimpleNamespace(drifts=every))


def rates(correction):
    return {name: clock.fps for name, clock in correction.inputs.observations.clocks.items()}


@pytest.mark.parametrize("rate", [0.04, -0.04])
def test_the_rate_is_corrected_by_what_the_clock_runs_ahead(rate):
    """A clock that counts 25 frames a second, where there are 26, shows 1.04 s each second."""
    found = correct_clock_rates(INPUTS, estimated(C2=(rate, 1e-4)))
    assert rates(found) == {"C1": FPS, "C2": pytest.approx((1 + rate) * FPS, rel=0.002), "C3": FPS}


@pytest.mark.parametrize(("rate", "sigma"), [(0.04, 0.02), (-2e-4, 1e-6)])
def test_a_drift_that_is_unsure_or_of_milliseconds_changes_no_rate(rate, sigma):
    """2e-4 is 20 ms over the recording, less than sound clocks seem to drift by."""
    assert correct_clock_rates(INPUTS, estimated(C2=(rate, sigma))) is None
    both = correct_clock_rates(INPUTS, estimated(C1=(0.01, 1e-4), C2=(rate, sigma)))
    assert rates(both)["C2"] == FPS


def test_no_rate_is_corrected_where_none_is_known():
    unknown = SceneInputs(RIG, Observations({name: CameraObservations() for name in RIG.names}), findings=())
    assert correct_clock_rates(unknown, estimated(C2=(0.04, 1e-4))) is None
    assert clock_rate_figures(unknown, unknown, estimated(C2=(0.04, 1e-4))) == {}


def test_a_fitted_rate_is_told_beside_the_stated_one_with_a_sigma_that_grows_with_that_of_the_drift():
    estimate = estimated(C2=(0.04, 1e-4))
    corrected = correct_clock_rates(INPUTS, estimate).inputs
    figures = clock_rate_figures(INPUTS, corrected, estimated(C2=(0.0, 1e-4)))
    assert {name: one.stated for name, one in figures.items()} == dict.fromkeys(RIG.names, FPS)
    assert figures["C2"].fps == corrected.observations.clocks["C2"].fps
    sure, unsure = figures["C1"].sigma / FPS, figures["C2"].sigma / figures["C2"].fps
    assert 1e-5 < sure < unsure
    assert 1e-4 < unsure < 1e-3
