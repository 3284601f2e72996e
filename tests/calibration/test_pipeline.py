"""The order of the stages, and what becomes of a solver's answer; the solver is a stand-in here."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import passerby
from passerby.calibration import rig_comparison, scene_solver
from passerby.calibration.rig_comparison import compare_rigs
from passerby.cli.main import run
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Pose, PoseSigma
from passerby.core.figures import AdjustedFigures, CueFigures, ScaleFigures
from passerby.core.solution import Solution
from passerby.findings.finding import refusal
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from support.scenes.handmade_files import lens, rows, write_scene
from support.scenes.people_and_rigs import part, ring, simulated


@dataclass(frozen=True)
class Options:
    rounds: int = 3
    reference: str | None = None


FIGURES = AdjustedFigures(foot_shift=np.float64(0.5), vertical_sigma_deg=float("nan"))


class Solver:
    """Places the cameras in a row; `lost` get no pose."""

    def __init__(self):
        self.verdict, self.lost, self.error, self.figures = "accepted", (), None, FIGURES
        self.calls = []

    def __call__(self, rig, observations, cues, options, *, rng, guesses=()):
        self.calls.append((rig, observations, cues, options, rng))
        if self.error:
            raise self.error
        cameras = [
            replace(camera, pose=Pose(np.eye(3), np.array([index, 0, 2.0])), sigma=PoseSigma(0.01, 0.2))
            if camera.name not in self.lost
            else camera
            for index, camera in enumerate(rig)
        ]
        return Solution("people", replace(rig, cameras=tuple(cameras)), self.verdict, (), self.figures)


@pytest.fixture
def solver(monkeypatch):
    solver = Solver()
    for options, solve in (("PeopleOptions", "solve_people"), ("GeoPoseOptions", "solve_geopose")):
        monkeypatch.setattr(scene_solver, options, Options)
        monkeypatch.setattr(scene_solver, solve, solver)
    return solver


def test_three_lines_of_python(tmp_path, solver):
    calibration = passerby.calibrate(write_scene(tmp_path))
    calibration.write(tmp_path / "out")
    assert calibration.accepted

    rig = read_rig(tmp_path / "out" / "rig.toml")
    assert rig.verdict == "accepted"
    assert rig["B"].pose.t_cw.tolist() == [1, 0, 2]
    assert rig["B"].sigma.position_m == pytest.approx(0.01)
    assert np.array_equal(read_boxes(tmp_path / "out" / "tracks" / "A.txt").ltwh, read_boxes(tmp_path / "A.txt").ltwh)
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert report["verdict"] == "accepted"
    assert report["passerby"] == passerby.__version__
    assert report["schema_version"] == 1
    figures = {key: report["figures"][key] for key in ("foot_shift", "vertical_sigma_deg", "moved", "ground")}
    assert figures == {"foot_shift": 0.5, "vertical_sigma_deg": None, "moved": [], "ground": None}
    assert not {"undetermined", "clock_rates"} & set(report["figures"])
    assert report["options"] == {"rounds": 3, "reference": None}
    assert report["cameras"][1]["centre_m"] == [-1, 0, -2]
    assert report["cameras"][1]["boxes"] == 20
    assert "seconds" not in report


def test_the_solver_gets_lenses_without_poses_and_known_people(tmp_path, solver):
    posed = lens("A") + "rotation = [0.1, 0.2, 0.3]\ntranslation = [1, 2, 3]\n" + lens("B")
    files = {"rig.toml": posed, "A.txt": rows() + "11,-1,9,9,9,9,1,-1,-1,-1\n"}
    extra = "[scene]\nfps = 7\n[solver]\noptions = { rounds = 5 }\n[scale]\nperson_height_m = 1.6\n"
    passerby.calibrate(str(write_scene(tmp_path, files=files, extra=extra)), seed=4)
    rig, observations, cues, options, rng = solver.calls[0]
    assert all(camera.pose is None for camera in rig)
    assert len(observations["A"].boxes) == 20
    assert observations.fps == 7
    assert cues.population.mean_m == 1.6
    assert options.rounds == 5
    passerby.calibrate(write_scene(tmp_path, extra="[solver]\nmethod = 'geopose'\nreference = 'B'"))
    assert solver.calls[1][3].reference == "B"
    assert rng.integers(10**9) == np.random.default_rng(4).integers(10**9)


@pytest.mark.parametrize("apart_m", [1.0, 2.0])
def test_known_places_are_a_scale_cue_that_heights_can_contradict(tmp_path, solver, apart_m):
    """The solver has the two cameras one metre apart, by the heights of people."""
    heights = CueFigures(
        cue="population of 5", kind="population", count=5, stated_m=1.7, measured_m=1.7, sd_m=0.08, residual_sigmas=0.0,
        share=1.0, own_scale=1.0, own_sigma=0.045,
    )  # fmt: skip
    solver.figures = replace(FIGURES, scale=ScaleFigures(relative_sigma=0.045, cues=(heights,)))
    (tmp_path / "positions.csv").write_text(f"camera,x,y,z\nA,5,5,3\nB,5,{5 + apart_m},3\n")
    scene = write_scene(tmp_path, extra='[world]\npositions = "positions.csv"\nscale = true\n')
    calibration = passerby.calibrate(scene)
    assert np.linalg.norm(calibration.rig["A"].centre - calibration.rig["B"].centre) == pytest.approx(apart_m)
    cue = calibration.figures.scale.cues[-1]
    assert (cue.kind, cue.own_scale) == ("world", pytest.approx(apart_m))
    named = [found.values["cues"] for found in calibration.doubts if found.code == "scale_cues_disagree"]
    assert [set(cues) for cues in named] == [{"population of 5", cue.cue}] * (apart_m > 1)
    assert calibration.accepted == (apart_m == 1)


def test_a_refusal_is_written_over_the_accepted_rig_and_ends_with_status_3(tmp_path, solver, capsys):
    scene, out = write_scene(tmp_path), tmp_path / "out"
    assert run(["calibrate", str(scene), "-o", str(out), "--no-report"]) == 0
    capsys.readouterr()
    solver.error = EvidenceError("too little", ("all people walk on one line: record them elsewhere too",))
    assert run(["calibrate", str(scene), "-o", str(out)]) == 3
    assert capsys.readouterr().err == "refused: all people walk on one line: record them elsewhere too\n"
    report = json.loads((out / "calibration.json").read_text())
    assert report["verdict"] == "refused"
    assert report["reasons"] == ["all people walk on one line: record them elsewhere too"]
    (told,) = report["diagnostics"]
    assert (told["code"], told["severity"], told["text"]) == ("too_little_evidence", "refusal", report["reasons"][0])
    rig = read_rig(out / "rig.toml")
    assert rig.verdict == "refused"
    assert all(camera.pose is None for camera in rig)


def test_cameras_that_share_no_people_are_refused_before_the_solver(tmp_path, solver):
    calibration = passerby.calibrate(write_scene(tmp_path, files={"B.txt": rows(identities=(8, 9))}))
    assert calibration.verdict == "refused"
    assert calibration.diagnostics == (refusal("no_shared_people", given=True),)
    assert not solver.calls


@pytest.mark.parametrize(
    ("option", "told"), [("round = 3", "unknown key 'round': did you mean 'rounds'"), ("rounds = 'many'", "rounds is 'many': ")]
)
def test_wrong_options_are_reported(tmp_path, solver, option, told):
    with pytest.raises(InputError, match=rf"\[solver.options\]:? {told}"):
        passerby.calibrate(write_scene(tmp_path, extra=f"[solver.options]\n{option}"))


@pytest.mark.parametrize("shares", [True, False])
def test_a_rig_that_lacks_a_camera_is_not_accepted_and_the_reason_is_named(tmp_path, solver, capsys, shares):
    solver.lost = ("C",)
    scene = write_scene(tmp_path, ("A", "B", "C"), files={} if shares else {"C.txt": rows(identities=(8, 9))})
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "out"), "--json"]) == 3
    out, errors = capsys.readouterr()
    report = json.loads(out)
    assert report["verdict"] == "doubtful"
    assert set(report["seconds"]) == {"reading", "solving"}
    (told,) = report["diagnostics"]
    assert (told["code"], told["cameras"]) == ("camera_without_pose", ["C"])
    assert (told["values"]["why"] is None) == shares
    assert ("camera C shares no people with A, B" in errors) != shares


@pytest.mark.parametrize(
    ("error", "status", "first", "last"),
    [
        (ZeroDivisionError("oops"), 1, "Traceback", "error: a bug in Passerby: ZeroDivisionError: oops"),
        (KeyboardInterrupt(), 130, "error: interrupted", "error: interrupted"),
    ],
    ids=["a bug", "an interruption"],
)
def test_a_run_that_fails_says_how_and_writes_nothing(tmp_path, solver, capsys, error, status, first, last):
    solver.error = error
    assert run(["calibrate", str(write_scene(tmp_path)), "-o", str(tmp_path / "out")]) == status
    errors = capsys.readouterr().err.splitlines()
    assert errors[0].startswith(first)
    assert errors[-1].startswith(last)
    assert not (tmp_path / "out").exists()


def test_a_scene_whose_people_cannot_be_associated_and_a_damaged_folder_are_reported(monkeypatch, tmp_path: Path) -> None:
    refused = SimpleNamespace(verdict="refused", reasons=("nobody walks: film people", "B saw nobody: point it at them"))
    monkeypatch.setattr(rig_comparison, "calibrate", lambda *_, **named: refused)
    rig = ring(3)
    with pytest.raises(EvidenceError, match="nobody walks: film people; B saw nobody: point it at them"):
        compare_rigs(rig, rig, tmp_path / "scene.toml")
    (tmp_path / "calibration.json").write_text("{}")
    with pytest.raises(InputError, match=r"calibration\.json: is not what `passerby calibrate` writes"):
        compare_rigs(rig, rig, tmp_path)


def test_the_people_of_a_scene_are_those_of_its_calibration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its own poses are not used; the seed is handed on."""
    scene, asked = simulated(seconds=8.0), []

    def calibrate(people: Path, **named: object) -> SimpleNamespace:
        asked.append((people, named["seed"]))
        stated = SimpleNamespace(scale=SimpleNamespace(person_height_m=1.72), turns={})
        return SimpleNamespace(verdict="doubtful", instants=part(scene.observations), scene=stated, rig=scene.rig)

    monkeypatch.setattr(rig_comparison, "calibrate", calibrate)
    shrunk = scene.rig.moved([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 0.3], 0.9)
    found = compare_rigs(scene.rig, shrunk, tmp_path / "scene.toml", seed=5)
    assert asked == [(tmp_path / "scene.toml", 5)]
    assert found.difference_px > 0
    assert set(found.cameras) == set(scene.rig.names)
