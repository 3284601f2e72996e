"""Lenses: which correction of a stated one stands, where priors come from, and scenes without intrinsics."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from passerby.association.result import Association
from passerby.calibration import held_out, lens_corrections
from passerby.calibration.calibrate import calibrate
from passerby.calibration.lens_corrections import LensExamination, examine_stated_lenses
from passerby.calibration.lens_priors import with_lens_priors
from passerby.calibration.run import Corrections, Estimate
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.data_sheet import sd_of_field
from passerby.core.figures import adjusted
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures
from passerby.core.measuring import find_common_ground, measure_change
from passerby.core.observations import CameraObservations, Observations
from passerby.evaluation.metrics import compare
from passerby.hypotheses.alternatives import Alternative
from passerby.hypotheses.lenses import FittedAlternative, FoundLenses, LensResult
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
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
    assert [one.code for one in found.findings] == ["lens_doubtful"] + ["lens_corrected"] * 3
    focal = STATED["C2"].lens.focal
    for one in found.findings[1:]:  # each says what became of the lens in the end
        assert one.values["focal"]["stated_px"] == pytest.approx(focal)
        assert one.values["focal"]["found_px"] == pytest.approx(focal / 1.1**3)


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


FOCAL = FocalFigures(
    stated_px=700.0, refined_px=710.0, sigma_px=20.0, people_sigma_px=40.0, far=False, told=True, prior_sigma_px=70.0,
    people_share=0.25,
)  # fmt: skip
POINT = PrincipalPointFigures(
    stated_px=(320.0, 240.0),
    refined_px=(321.0, 240.0),
    sigma_px=(6.0, 6.0),
    people_sigma_px=(50.0, None),
    far=False,
    told=False,
)
FIGURES = {"A": LensFigures(focal=FOCAL, principal_point=POINT, distortion=DistortionFigures(refined=-0.1, sigma=0.05))}


def of(lens):
    return with_lens_priors(FIGURES, Rig((Camera("A", lens),)))["A"]


def test_the_priors_of_a_lens_are_assumed_searched_for_or_stated():
    """A data sheet is weighed against people whatever the search said; what is known well enough is its own prior."""
    parts = of(Lens.unknown((640, 480), group="yard"))
    assert (parts.focal.prior, parts.focal.people_share, parts.focal.scene_px) == ("search", 1.0, None)
    assert (parts.principal_point.prior, parts.distortion.prior, parts.group) == ("assumed", "assumed", "yard")
    lens = Lens.unknown((640, 480), hfov_deg=60.0)
    assert 0.1 < lens.focal_sd < 0.5
    focal, sd = of(lens).focal, lens.focal_sd * lens.focal
    assert (focal.prior, focal.scene_px, focal.scene_sigma_px) == ("search", lens.focal, pytest.approx(sd))
    assert focal.people_share == pytest.approx(sd**2 / (sd**2 + 40.0**2))
    parts = of(Lens.unknown((640, 480), hfov_deg=60.0, focal_sd=0.05))
    assert (parts.focal.prior, parts.focal.people_share, parts.focal.scene_px) == ("stated", 0.25, None)
    assert parts.principal_point.prior == "assumed"
    known = Lens((640, 480), np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]]), np.zeros(5))
    for lens in (known, replace(known, focal_sd=0.2)):
        parts = of(lens)
        assert {parts.focal.prior, parts.principal_point.prior, parts.distortion.prior} == {"stated"}
        assert parts.focal.people_share == 0.25


def without_intrinsics(folder, more=""):
    """A scene that `simulate` wrote, its intrinsics removed."""
    path = folder / "scene.toml"
    path.write_text(re.sub(r"intrinsics = .*", f"image_size = [720, 576]{more}", path.read_text()))
    return path


def made(folder, *options):
    detector = ["--box-noise", "0.02", "--missing", "0.1"]
    assert run(["simulate", "--preset", "terrace", "--seed", "31", *detector, "-o", str(folder), *options]) == 0
    return folder


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return made(tmp_path_factory.mktemp("short") / "scene", "--seconds", "4")


def test_check_says_that_they_are_estimated_and_the_published_method_needs_them(short, capsys):
    path = without_intrinsics(short)
    assert run(["check", str(path)]) in (0, 3)
    assert "cameras C1 to C4: no intrinsics: focal length, principal point and distortion" in capsys.readouterr().out
    text = re.sub(r"(?s)\[solver\].*", "", path.read_text())
    path.write_text(text + '[solver]\nmethod = "geopose"\nreference = "C1"\n')
    assert run(["check", str(path)]) == 2
    assert '[cameras.C1] has no intrinsics, but method "geopose" assumes that they are exact' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("lines", "what"),
    [
        ("intrinsics = 'rig.toml'\nimage_size = [640, 480]", "states both intrinsics and image_size"),
        ("image_size = [640, 480]\nfocal_sd_percent = 5", "states focal_sd_percent, but no focal length"),
        ("image_size = [640, 0]", "image_size"),
    ],
)
def test_half_a_statement_is_an_error(tmp_path, lines, what):
    path = tmp_path / "scene.toml"
    path.write_text(f"[cameras.A]\ntracks = 'a.txt'\n{lines}\n[cameras.B]\ntracks = 'a.txt'\n{lines}\n")
    with pytest.raises(InputError, match=re.escape(what)):
        Scene.load(path)


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--unrelated-ids", "--clock-offsets", "2")], ids=["identities known", "unknown"])
def test_a_rig_and_its_lenses(tmp_path, options):
    folder = made(tmp_path / "scene", "--seconds", "40", *options)
    truth = read_rig(folder / "truth.toml")
    found = calibrate(without_intrinsics(folder))
    assert found.verdict != "refused"
    off = [abs(np.log(camera.lens.focal / truth[camera.name].lens.focal)) for camera in found.rig]
    assert max(off) < 0.08
    error = compare(found.rig, truth).similarity
    assert error.mean_position_mm < 250
    assert error.mean_orientation_deg < 1.5
    found.write(tmp_path / "out", report=False)
    document = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert {entry["code"] for entry in document["diagnostics"]} >= {"intrinsics_unknown", "intrinsics_estimated"}
    lenses = document["figures"]["lenses"]
    assert all(set(lenses[camera.name]) == {"focal", "principal_point", "distortion"} for camera in truth)
    for parts in lenses.values():
        focal, point, bent = parts["focal"], parts["principal_point"], parts["distortion"]
        assert (focal["prior"], focal["people_share"]) == ("search", 1.0)
        assert {point["prior"], bent["prior"]} == {"assumed"}
        assert point["stated_px"] == [360, 288]
        for sigma, prior, alone, share in (
            (focal["sigma_px"], focal["prior_sigma_px"], focal["people_sigma_px"], None),
            (bent["sigma"], bent["prior_sigma"], bent["people_sigma"], bent["people_share"]),
            *zip(*(point[key] for key in ("sigma_px", "prior_sigma_px", "people_sigma_px", "people_share")), strict=True),
        ):
            assert sigma == pytest.approx(1 / np.hypot(1 / prior, 1 / alone), rel=0.1), "as information adds up"
            assert share is None or share == pytest.approx((sigma / alone) ** 2)
    written = read_rig(tmp_path / "out" / "rig.toml")
    assert written["C1"].lens.focal == pytest.approx(found.rig["C1"].lens.focal)
    assert 0 < written["C1"].lens.focal_sd < 0.1


@pytest.mark.slow
def test_a_field_of_view_narrows_the_search(tmp_path):
    folder = made(tmp_path / "scene", "--seconds", "30")
    truth = read_rig(folder / "truth.toml")
    path = folder / "scene.toml"
    text, stated = path.read_text(), {}
    for camera in truth:
        stated[camera.name] = degrees = round(2 * np.degrees(np.arctan(360 / camera.lens.focal)) * 1.03, 1)
        text = re.sub(
            rf"(\[cameras.{camera.name}\]\n)intrinsics = .*", rf"\1image_size = [720, 576]\nhfov_deg = {degrees:.1f}", text
        )
    path.write_text(text)
    found = calibrate(path)
    assert max(abs(np.log(camera.lens.focal / truth[camera.name].lens.focal)) for camera in found.rig) < 0.05
    for camera in truth:
        focal = adjusted(found.figures).lenses[camera.name].focal
        assert focal.scene_px == pytest.approx(camera.lens.focal, rel=0.05)
        assert focal.scene_sigma_px == pytest.approx(sd_of_field(stated[camera.name]) * focal.scene_px)
        assert 0.8 < focal.people_share < 1
