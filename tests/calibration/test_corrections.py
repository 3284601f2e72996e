"""Corrections of the input: in which order, how often at most, which of them are dropped; and what is held against what."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from passerby.association.clocks.drift import Drift
from passerby.association.result import Association
from passerby.calibration import association_run, calibrate
from passerby.calibration.association_run import AssociationOptions, AssociationRun, share_of_same_pairs
from passerby.calibration.camera_motion import MotionCorrection
from passerby.calibration.clock_skew import ClockRateCorrection, clock_rate_figures, correct_clock_rates, relative_to_first
from passerby.calibration.lens_corrections import LensExamination
from passerby.calibration.readings import ClockCorrection
from passerby.calibration.run import CalibrationRun, Correction, Corrections, Estimate
from passerby.calibration.unrecorded import unrecorded_instants
from passerby.core.cameras import Lens, Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.core.pointing import PointedPerson
from passerby.core.solution import Solution
from passerby.findings.finding import notice
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import ring, without_poses

RIG: Rig = without_poses(ring(3))
NOBODY = Observations({})
FPS, SPAN_S = 25.0, 100.0
POSED = ring(3)


class Ended(Exception):
    """The corrections are over."""


def letters(inputs: SceneInputs) -> str:
    return "".join(one.code for one in inputs.findings)


def corrected(
    patch: pytest.MonkeyPatch, faults: dict[str, float], *, worse: str = "", refined: tuple[str, ...] = ("clock_rate",)
) -> tuple[Corrections, Estimate, list[str]]:
    """The corrections, the estimate that stands, and all estimates, where each fault shows until it is corrected so often.

    Each correction adds its letter to the findings of the inputs; an estimate's method is these letters. After a correction
    whose letter is in `worse` the estimate is worse.
    """
    estimates: list[str] = []

    def estimate(run: CalibrationRun, inputs: SceneInputs) -> Estimate:
        estimates.append(letters(inputs))
        return Estimate(Solution(letters(inputs), inputs.rig, "accepted"), Association(NOBODY, NOBODY, {}))

    def looking(letter: str, kind: Any, *rest: Any) -> Any:
        def look(*args: Any) -> Correction | None:
            (inputs,) = (one for one in args if isinstance(one, SceneInputs))
            for one in args:
                assert not isinstance(one, Estimate) or one.solution.method == letters(inputs), (
                    "the estimate is of these inputs"
                )
            if letters(inputs).count(letter) >= faults.get(letter, 0):
                return None
            return kind(replace(inputs, findings=(*inputs.findings, notice(letter))), *rest)

        return look

    def end(motions: Any, corrections: Corrections, estimated: Estimate) -> None:
        raise Ended(corrections, estimated)

    for name, stand_in in {
        "estimate_rig": estimate,
        "correct_clock_rates": looking("r", ClockRateCorrection),
        "read_cameras": lambda *_: [],
        "correct_late_clock": looking("c", ClockCorrection, None),
        "correct_motion": looking("m", MotionCorrection, None),
        "examine_stated_lenses": lambda *_: (None, LensExamination()),
        "is_worse": lambda after, before, *_: after.solution.method[-1] in worse,
        "measure_motions": end,
    }.items():
        patch.setattr(calibrate, name, stand_in)
    cameras = {name: {"tracks": f"{name}.txt", "intrinsics": "rig.toml"} for name in RIG.names}
    scene = Scene.model_validate({"scene": {"name": "s"}, "cameras": cameras, "solver": {"refine": list(refined)}})
    with pytest.raises(Ended) as ended:
        calibrate.correct_inputs(CalibrationRun(scene, PeopleOptions()), SceneInputs(RIG, NOBODY, ()))
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
    _, estimate, estimates = corrected(monkeypatch, {"r": np.inf, "c": np.inf, "m": np.inf})
    rates, clocks, motions = (estimate.solution.method.count(letter) for letter in "rcm")
    assert 0 < rates <= 6
    assert 0 < clocks <= 3
    assert motions == len(RIG)
    assert len(estimates) == 1 + rates + clocks + motions


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


def test_no_rate_is_corrected_where_none_is_known_and_of_two_clocks_the_first_is_believed():
    unknown = SceneInputs(RIG, Observations({name: CameraObservations() for name in RIG.names}), findings=())
    assert correct_clock_rates(unknown, estimated(C2=(0.04, 1e-4))) is None
    assert clock_rate_figures(unknown, unknown, estimated(C2=(0.04, 1e-4))) == {}
    drifts = relative_to_first({"C1": Drift(0.02, 0.001, 30.0), "C2": Drift(-0.02, 0.001, 30.0)})
    assert (drifts["C1"].rate, drifts["C2"].rate) == (0, -0.04)


def test_a_fitted_rate_is_reported_beside_the_stated_one_with_a_sigma_that_grows_with_that_of_the_drift():
    estimate = estimated(C2=(0.04, 1e-4))
    corrected = correct_clock_rates(INPUTS, estimate).inputs
    figures = clock_rate_figures(INPUTS, corrected, estimated(C2=(0.0, 1e-4)))
    assert {name: one.stated for name, one in figures.items()} == dict.fromkeys(RIG.names, FPS)
    assert figures["C2"].fps == corrected.observations.clocks["C2"].fps
    sure, unsure = figures["C1"].sigma / FPS, figures["C2"].sigma / figures["C2"].fps
    assert 1e-5 < sure < unsure
    assert 1e-4 < unsure < 1e-3


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [
        ([0, 0, 1, 1], [5, 5, 3, 3], 1.0),
        ([0, 0, 0, 0], [0, 1, 2, 3], 0.0),
        ([0, 0, 1, 1], [0, 0, 0, 0], 2 / 6),
        ([0, 0, 0, 1], [0, 0, 1, 1], 1 / 4),
    ],
)
def test_groupings_are_as_alike_as_the_pairs_that_both_have_of_those_that_either_has(before, after, share):
    one, other = share_of_same_pairs(np.array(before), np.array(after)), share_of_same_pairs(np.array(after), np.array(before))
    assert one == other == pytest.approx(share)


def test_a_lens_that_was_found_is_that_of_a_registered_camera_alone(monkeypatch):
    """And only where it was not known before."""
    monkeypatch.setattr(association_run, "with_lenses_of", lambda cameras, rig, height_m: [])
    unknown, found = Lens.unknown((1280, 720)), Lens.unknown((1280, 720), focal_px=900.0)
    poses = [camera.pose for camera in POSED]
    before = Rig(tuple(c if n == 2 else type(c)(c.name, unknown) for n, c in enumerate(POSED)))
    solved = Rig(tuple(type(c)(c.name, found, None if n == 1 else poses[n]) for n, c in enumerate(POSED)))
    run = AssociationRun(before, [], SimpleNamespace(), None, AssociationOptions()).with_lenses(solved)
    assert [camera.lens.focal for camera in run.rig] == [900.0, unknown.focal, POSED["C3"].lens.focal]
    assert [camera.lens.uncalibrated for camera in run.rig] == [True, True, False]


def test_heights_are_those_of_the_people_at_the_pixels_by_the_identities_that_are_written():
    """People are numbered from 0 within, and from 1 in what is written; a camera may be one of another group."""
    ltwh = np.array([[100.0, 100.0, 50.0, 120.0], [400.0, 100.0, 50.0, 120.0]])
    seen = CameraObservations(Boxes(np.array([3, 3]), np.array([0, 1]), ltwh, np.ones(2)))
    cameras = [SimpleNamespace(seen=one) for one in (CameraObservations(), seen, CameraObservations())]
    at = {"C2": (425.0, 160.0), "U1": (425.0, 160.0)}
    pointed = tuple(PointedPerson(n, name, 3, pixel, 1.9, 0.01) for n, (name, pixel) in enumerate(at.items(), start=1))
    run = AssociationRun(POSED, cameras, SimpleNamespace(), None, AssociationOptions(pointed=pointed))
    none = np.zeros(0, np.int64)
    known = run.known([(none, none), (np.array([8, 5]), none), (none, none)])
    assert [(one.identity, one.metres) for one in known.people] == [(6, 1.9)]
    assert [(one.code, one.cameras) for one in known.findings] == [("pointed_person_unmatched", ("U1",))]


def boxes(frame: list[int]) -> Boxes:
    return Boxes(np.array(frame), np.ones(len(frame), int), np.full((len(frame), 4), 50.0), np.ones(len(frame)))


def associated(clocks: dict[str, Clock], grid: dict[str, Clock]) -> Association:
    """A saw somebody's box at instants 1 to 20, B somebody's joints at 31 to 40."""
    joints = Keypoints(np.arange(31, 41), np.ones(10, int), np.full((10, 1, 2), 50.0), np.ones((10, 1)), ("head",))
    cameras = {"A": CameraObservations(boxes(list(range(1, 21)))), "B": CameraObservations(Boxes.empty(), joints)}
    instants = Observations(cameras, 5.0, grid)
    return Association(instants, instants, clocks)


def test_instants_within_a_gap_are_those_between_the_frames_at_its_ends() -> None:
    """Those frames themselves were recorded; at instants at which no person was seen, nothing is said of a gap."""
    found = unrecorded_instants({"A": [(5.0, 9.0), (18.0, 33.0)], "B": [(90.0, 95.0)]}, associated({}, {}))
    assert {name: instants.tolist() for name, instants in found.items()} == {"A": [6, 7, 8, 19, 20, 31, 32], "B": []}
    # B has 25 frames a second, where the instants are 5 a second, and began 1 s later: instant 31, after 6 s, is frame 126.
    grid, clocks = {"B": Clock(5.0)}, {"B": Clock(25.0, 1.0)}
    assert unrecorded_instants({"B": [(125.0, 132.0)]}, associated(clocks, grid))["B"].tolist() == [31, 32]
    nobody = Observations({"A": CameraObservations()})
    some, none = associated({}, {}), Association(nobody, nobody, {})
    for spans, seen in (([], some), ([(3.0, 4.0)], some), ([(1.0, 9.0)], none)):
        assert unrecorded_instants({"A": spans}, seen)["A"].tolist() == []
