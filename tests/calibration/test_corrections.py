"""Corrections of the input: in which order, how often at most, and which of them are dropped."""

from dataclasses import replace
from typing import Any

import pytest

from passerby.association.result import Association
from passerby.calibration import calibrate
from passerby.calibration.camera_motion import MotionCorrection
from passerby.calibration.clock_skew import ClockRateCorrection
from passerby.calibration.lens_corrections import LensExamination
from passerby.calibration.readings import ClockCorrection
from passerby.calibration.run import CalibrationRun, Correction, Corrections, Estimate
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.findings.finding import notice
from passerby.hypotheses.observations import ReadCamera
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import ring, without_poses

RIG: Rig = without_poses(ring(3))
NOBODY = Observations({})
INPUTS = SceneInputs(RIG, NOBODY, ())
ENDLESS = float("inf")


class Ended(Exception):
    """The corrections are over."""


def scene_of(*refined: str) -> Scene:
    cameras = {name: {"tracks": f"{name}.txt", "intrinsics": "rig.toml"} for name in RIG.names}
    return Scene.model_validate({"scene": {"name": "s", "fps": 5.0}, "cameras": cameras, "solver": {"refine": list(refined)}})


def corrected(
    monkeypatch: pytest.MonkeyPatch, faults: dict[str, float], *, worse: str = "", refined: tuple[str, ...] = ("clock_rate",)
) -> tuple[Corrections, Estimate, list[str]]:
    """The corrections, the estimate that stands, and all estimates, where each fault shows until it is corrected so often.

    Each correction adds its letter to the findings of the inputs; an estimate's method is these letters. After a correction
    whose letter is in `worse` the estimate is worse.
    """
    estimates: list[str] = []

    def estimate(run: CalibrationRun, inputs: SceneInputs) -> Estimate:
        letters = "".join(one.code for one in inputs.findings)
        estimates.append(letters)
        return Estimate(Solution(letters, inputs.rig, "accepted"), Association(NOBODY, NOBODY, {}))

    def read(inputs: SceneInputs, estimated: Estimate) -> list[ReadCamera]:
        assert estimated.solution.method == "".join(one.code for one in inputs.findings), "the estimate is of these inputs"
        return []

    def correct(letter: str, inputs: SceneInputs, estimated: Estimate | None = None) -> SceneInputs | None:
        if estimated is not None:
            read(inputs, estimated)
        letters = "".join(one.code for one in inputs.findings)
        if letters.count(letter) >= faults.get(letter, 0):
            return None
        return replace(inputs, findings=(*inputs.findings, notice(letter)))

    def looking(letter: str, kind: Any, *rest: Any) -> Any:
        def look(*args: Any) -> Correction | None:
            inputs = correct(letter, *(one for one in args if isinstance(one, (SceneInputs, Estimate))))
            return None if inputs is None else kind(inputs, *rest)

        return look

    def end(motions: Any, corrections: Corrections, estimated: Estimate) -> None:
        raise Ended(corrections, estimated)

    monkeypatch.setattr(calibrate, "estimate_rig", estimate)
    monkeypatch.setattr(calibrate, "correct_clock_rates", looking("r", ClockRateCorrection))
    monkeypatch.setattr(calibrate, "read_cameras", read)
    monkeypatch.setattr(calibrate, "correct_late_clock", looking("c", ClockCorrection, None))
    monkeypatch.setattr(calibrate, "correct_motion", looking("m", MotionCorrection, None))
    monkeypatch.setattr(calibrate, "examine_stated_lenses", lambda *_: (None, LensExamination()))
    monkeypatch.setattr(calibrate, "is_worse", lambda after, before, *_: after.solution.method[-1] in worse)
    monkeypatch.setattr(calibrate, "measure_motions", end)
    with pytest.raises(Ended) as ended:
        calibrate.correct_inputs(CalibrationRun(scene_of(*refined), PeopleOptions()), INPUTS)
    return (*ended.value.args, estimates)  # type: ignore[return-value]


def test_faults_are_sought_in_one_order_and_from_the_first_again_after_each_correction(monkeypatch: pytest.MonkeyPatch) -> None:
    corrections, estimate, estimates = corrected(monkeypatch, {"m": 1, "c": 1, "r": 2})
    assert estimates == ["", "r", "rr", "rrc", "rrcm"]
    assert estimate.solution.method == "rrcm"
    assert [type(one) for one in corrections.made] == [*2 * [ClockRateCorrection], ClockCorrection, MotionCorrection]
    # Sound inputs are estimated once, and clock rates are corrected only where the scene asks for it.
    for faults, refined in (({}, ("clock_rate",)), ({"r": 2}, ())):
        corrections, _, estimates = corrected(monkeypatch, faults, refined=refined)
        assert (corrections.made, estimates) == ((), [""])


def test_a_tentative_correction_that_makes_it_worse_is_dropped_and_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    corrections, estimate, estimates = corrected(monkeypatch, {"c": 2, "m": 1}, worse="cm")
    assert estimates == ["", "c", "m"]
    assert estimate.solution.method == "m"  # what a camera saw from elsewhere is left out in any case
    assert ([type(one) for one in corrections.dropped], len(corrections.made)) == ([ClockCorrection], 1)


def test_estimates_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    _, estimate, estimates = corrected(monkeypatch, {"r": ENDLESS, "c": ENDLESS, "m": ENDLESS})
    rates, clocks, motions = (estimate.solution.method.count(letter) for letter in "rcm")
    assert 0 < rates <= 6
    assert 0 < clocks <= 3
    assert motions == len(RIG)
    assert len(estimates) == 1 + rates + clocks + motions
