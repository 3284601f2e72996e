"""Corrections of lenses: which estimate stands, and what is reported."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from passerby.association.result import Association
from passerby.calibration import held_out, lens_corrections
from passerby.calibration.calibrate import calibrate
from passerby.calibration.lens_corrections import MOST_CORRECTIONS, LensExamination, examine_stated_lenses
from passerby.calibration.run import Corrections, Estimate
from passerby.core.cameras import Pose, Rig
from passerby.core.measuring import find_common_ground, measure_change
from passerby.core.observations import CameraObservations, Observations
from passerby.hypotheses.alternatives import Alternative
from passerby.hypotheses.lenses import FittedAlternative, FoundLenses, LensResult
from passerby.interchange.rig_toml import write_rig
from passerby.scene.inputs import SceneInputs
from passerby.simulation import write_scene
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people import PeopleSolution
from support.scenes.people_and_rigs import ring, simulated, without_poses

STATED = without_poses(ring(3))
NOBODY = Observations({name: CameraObservations() for name in STATED.names})


def estimated(rig: Rig) -> Estimate:
    cameras = [replace(camera, pose=Pose(np.eye(3), np.zeros(3))) for camera in rig]
    return Estimate(PeopleSolution("people", Rig(tuple(cameras)), "accepted"), Association(NOBODY, NOBODY, {}))


def wrong_lens(monkeypatch: pytest.MonkeyPatch, decision: str = "correct", times: float = 1) -> list[Alternative]:
    """The second focal length is found to be 10 % too long, so many times; what is not to be tried again."""
    alternative = Alternative("focal", (1,), ("focal",), -3.0)
    asked: list[Alternative] = []
    change = np.zeros((3, 4))
    change[1, 0] = -np.log(1.1)

    def examine(solution: PeopleSolution, corrected: Sequence[Alternative] = ()) -> LensResult:
        asked[:] = corrected
        if len(corrected) >= times:
            return LensResult("nothing")
        found = FoundLenses(alternative, STATED, change, np.full((3, 4), 0.01), None)
        return LensResult(decision, (), (FittedAlternative(alternative, None, None),), found)  # type: ignore[arg-type]

    monkeypatch.setattr(lens_corrections, "examine_lenses", examine)
    return asked


def corrected(*, worse: bool = False) -> tuple[Rig, LensExamination]:
    """The lenses and what is found of them in the end, where a correction makes the estimate `worse` or not."""
    inputs, corrections = SceneInputs(STATED, NOBODY, ()), Corrections()
    while True:
        correction, found = examine_stated_lenses(inputs, estimated(inputs.rig), corrections, 1.72, ())
        if correction is None:
            return inputs.rig, found
        assert correction.tentative
        if worse:
            corrections = replace(corrections, dropped=(*corrections.dropped, correction))
        else:
            corrections = replace(corrections, made=(*corrections.made, correction))
            inputs = correction.inputs


def test_a_corrected_lens_is_that_of_the_rig_and_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = wrong_lens(monkeypatch)
    rig, found = corrected()
    assert [(one.code, one.severity, one.cameras) for one in found.findings] == [("lens_corrected", "notice", ("C2",))]
    assert found.findings[0].values["focal"]["found_px"] == pytest.approx(STATED["C2"].lens.focal / 1.1)
    lens = rig["C2"].lens
    assert (lens.focal, lens.focal_sd) == pytest.approx((STATED["C2"].lens.focal / 1.1, 0.01))
    assert [(one.code, one.cameras) for one in asked] == [("focal", (1,))]


def test_what_makes_it_worse_or_is_not_corrected_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong_lens(monkeypatch)
    rig, found = corrected(worse=True)
    assert [(one.code, one.severity, one.values["why"]) for one in found.findings] == [("lens_doubtful", "doubt", "not_better")]
    assert rig["C2"].lens.focal == STATED["C2"].lens.focal
    for decision, code in (("notice", "lens_differs"), ("doubt", "lens_doubtful")):
        wrong_lens(monkeypatch, decision)
        correction, found = examine_stated_lenses(SceneInputs(STATED, NOBODY, ()), estimated(STATED), Corrections(), 1.72, ())
        assert correction is None
        assert [one.code for one in found.findings] == [code]


@pytest.mark.parametrize(("uneven", "stands"), [((True, True), False), ((False, True), True), ((True, False), True)])
def test_a_lens_is_not_why_the_ground_is_uneven_where_it_stays_so(
    monkeypatch: pytest.MonkeyPatch, uneven: tuple[bool, bool], stands: bool
) -> None:
    """`uneven`: after and before the correction."""
    wrong_lens(monkeypatch)
    inputs = SceneInputs(STATED, NOBODY, ())
    correction, _ = examine_stated_lenses(inputs, estimated(STATED), Corrections(), 1.72, ())
    assert correction is not None
    shapes = iter(uneven)
    monkeypatch.setattr(lens_corrections, "shape_of", lambda *_: SimpleNamespace(sure=next(shapes)))
    assert correction.explains(estimated(correction.inputs.rig), estimated(STATED), 1.72) == stands
    if not stands:  # the sigmas hold how differently the rig would measure with that lens
        monkeypatch.setattr(lens_corrections, "shape_of", lambda *_: SimpleNamespace(sure=True))
        _, found = examine_stated_lenses(inputs, estimated(STATED), Corrections(dropped=(correction,)), 1.72, ())
        assert (found.findings, found.result.decision) == ((), "unsettled")


def test_corrections_are_bounded_and_the_last_contradiction_is_a_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong_lens(monkeypatch, times=np.inf)
    _, found = corrected()
    assert [one.code for one in found.findings] == ["lens_doubtful"] + ["lens_corrected"] * MOST_CORRECTIONS
    focal = STATED["C2"].lens.focal
    for one in found.findings[1:]:  # each says what became of the lens in the end
        assert one.values["focal"]["stated_px"] == pytest.approx(focal)
        assert one.values["focal"]["found_px"] == pytest.approx(focal / 1.1**MOST_CORRECTIONS)


@pytest.mark.parametrize(
    ("after", "before", "worse"),
    [((0.03, 3), (0.02, 3), True), ((0.01, 3), (0.02, 3), False), ((0.01, 2), (0.02, 3), True), ((None, 3), (None, 3), False)],
    ids=["disagrees more", "disagrees less", "a camera is lost", "nothing can be held out"],
)
def test_an_estimate_is_worse_that_lost_a_camera_or_disagrees_more_with_people_held_out(
    monkeypatch: pytest.MonkeyPatch, after: tuple[float | None, int], before: tuple[float | None, int], worse: bool
) -> None:
    estimates = []
    for _, posed in (after, before):
        one = estimated(STATED)
        cameras = [replace(camera, pose=camera.pose if c < posed else None) for c, camera in enumerate(one.solution.rig)]
        estimates.append(replace(one, solution=replace(one.solution, rig=Rig(tuple(cameras)))))
    shares = iter([after[0], before[0]])

    def hold_out(*_: object) -> object:
        share = next(shares)
        return None if share is None else SimpleNamespace(figures=SimpleNamespace(held_out=SimpleNamespace(median_share=share)))

    monkeypatch.setattr(held_out, "hold_out", hold_out)
    assert held_out.is_worse(*estimates, 1.72, 0) == worse
    refused = replace(estimates[0], solution=replace(estimates[0].solution, verdict="refused"))
    assert held_out.is_worse(refused, estimates[1], 1.72, 0)


@pytest.mark.system
def test_a_wrong_focal_length_is_corrected_and_the_rig_accepted(tmp_path: Path) -> None:
    truth = simulated("basketball")
    write_scene(truth, tmp_path)
    stated = LensUnknowns(("focal",)).rig(truth.rig, np.log([[1.0], [1.1], [1.0], [1.0]]))
    write_rig(tmp_path / "intrinsics.toml", without_poses(stated))
    found = calibrate(tmp_path / "scene.toml")
    assert found.verdict == "accepted"
    (notice,) = (one for one in found.diagnostics if one.code == "lens_corrected")
    assert notice.cameras == ("C2",)
    assert found.rig["C2"].lens.focal == pytest.approx(truth.rig["C2"].lens.focal, rel=0.02)
    change = measure_change(truth.rig, found.rig, find_common_ground(truth.rig))
    assert change is not None
    assert change.points.median_mm < 25
    by_name = {one.name: one for one in found.figures.cameras}  # type: ignore[union-attr]
    for name in ("C1", "C3", "C4"):
        assert abs(by_name[name].focal_change) < 4 * by_name[name].focal_change_sigma
