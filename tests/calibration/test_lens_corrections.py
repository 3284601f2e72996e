"""Corrections of lenses: which estimate stands, and what is reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.association.result import Association
from passerby.calibration import lens_corrections
from passerby.calibration.estimation import Estimate
from passerby.calibration.lens_corrections import MOST_CORRECTIONS, LensOutcome, correct_lenses
from passerby.calibration.pipeline import calibrate
from passerby.calibration.repairs import Correction, Repaired
from passerby.core.cameras import Pose, Rig
from passerby.core.measuring import common_ground, measured_change
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


def estimated(rig: Rig, verdict: str = "accepted", posed: int = 3, corrections: Sequence[Correction] = ()) -> Repaired:
    cameras = [replace(camera, pose=Pose(np.eye(3), np.zeros(3)) if c < posed else None) for c, camera in enumerate(rig)]
    solution = PeopleSolution("people", Rig(tuple(cameras)), verdict)  # type: ignore[arg-type]
    inputs = SceneInputs(rig, NOBODY, ())
    return Repaired(inputs, Estimate(solution, Association(NOBODY, NOBODY, {})), tuple(corrections))


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


def corrected(after: float | None = 0.01, before: float | None = 0.02, **faults: int | str) -> LensOutcome:
    """The outcome where people who are held out disagree so much with the estimates after and before."""

    def disagreement(estimate: Estimate) -> float | None:
        return before if estimate.solution.rig["C2"].lens.focal == STATED["C2"].lens.focal else after

    return correct_lenses(estimated(STATED), lambda inputs: estimated(inputs.rig, **faults), disagreement)  # type: ignore[arg-type]


def test_a_corrected_lens_is_that_of_the_rig_and_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = wrong_lens(monkeypatch)
    found = corrected()
    assert [(one.code, one.severity, one.cameras) for one in found.findings] == [("lens_corrected", "notice", ("C2",))]
    assert found.findings[0].values["focal"]["found_px"] == pytest.approx(STATED["C2"].lens.focal / 1.1)
    lens = found.repaired.estimate.solution.rig["C2"].lens
    assert lens.focal == pytest.approx(STATED["C2"].lens.focal / 1.1)
    assert lens.focal_sd == pytest.approx(0.01)
    assert [(one.code, one.cameras) for one in asked] == [("focal", (1,))]


@pytest.mark.parametrize(
    ("after", "before", "faults"),
    [(0.03, 0.02, {}), (0.01, 0.02, {"verdict": "refused"}), (0.01, 0.02, {"posed": 2})],
)
def test_a_correction_that_makes_it_worse_is_dropped_with_a_doubt(
    monkeypatch: pytest.MonkeyPatch, after: float, before: float, faults: dict[str, int | str]
) -> None:
    wrong_lens(monkeypatch)
    found = corrected(after, before, **faults)
    assert [(one.code, one.severity, one.values["why"]) for one in found.findings] == [("lens_doubtful", "doubt", "not_better")]
    assert found.repaired.estimate.solution.rig["C2"].lens.focal == STATED["C2"].lens.focal


def test_where_nothing_can_be_held_out_a_correction_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong_lens(monkeypatch)
    assert [one.code for one in corrected(None, None).findings] == ["lens_corrected"]


@pytest.mark.parametrize(("decision", "code"), [("notice", "lens_differs"), ("doubt", "lens_doubtful")])
def test_what_is_not_corrected_is_not_estimated_again(monkeypatch: pytest.MonkeyPatch, decision: str, code: str) -> None:
    wrong_lens(monkeypatch, decision)
    found = correct_lenses(estimated(STATED), lambda _: pytest.fail("estimated again"), lambda _: None)
    assert [one.code for one in found.findings] == [code]


def test_corrections_are_bounded_and_the_last_contradiction_is_a_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong_lens(monkeypatch, times=np.inf)
    found = corrected(None, None)
    assert [one.code for one in found.findings] == ["lens_doubtful"] + ["lens_corrected"] * MOST_CORRECTIONS
    focal = STATED["C2"].lens.focal
    for one in found.findings[1:]:  # each says what became of the lens in the end
        assert one.values["focal"]["stated_px"] == pytest.approx(focal)
        assert one.values["focal"]["found_px"] == pytest.approx(focal / 1.1**MOST_CORRECTIONS)


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
    change = measured_change(truth.rig, found.rig, common_ground(truth.rig))
    assert change is not None
    assert change.points.median_mm < 25
    by_name = {one.name: one for one in found.figures.cameras}  # type: ignore[union-attr]
    for name in ("C1", "C3", "C4"):
        assert abs(by_name[name].focal_change) < 4 * by_name[name].focal_change_sigma
