"""Whatever joints people show: a verdict with reasons that hold, and no NaN in any value, file or text."""

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.calibration.alignment.places import angle_sd
from passerby.calibration.calibration import Calibration, contents_of
from passerby.cli.main import run
from passerby.cli.tables import show_calibration, tell_reasons
from passerby.cli.terminal import number
from passerby.core.cameras import PoseSigma, Rig
from passerby.core.observations import BODY_17, Keypoints
from passerby.evaluation.metrics import compare_stated_sigmas
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.monitoring.evidence import rig_covariance_of
from passerby.report.contents import contents_from
from passerby.report.page import report_page
from passerby.simulation import SimulatedScene, SimulationOptions, simulate, write_scene
from support.scenes.people_and_rigs import ring, simulated
from support.scenes.upper_bodies import SEGMENT_ENDS, office_joints, without_joints

pytestmark = pytest.mark.system

NOT_A_NUMBER = re.compile(r"(?<![\w-])(nan|inf|infinity)(?!\w)", re.IGNORECASE)


HEAD = BODY_17[:5]


ARMS = ("left_elbow", "right_elbow", "left_wrist", "right_wrist")


TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


UPPER = ("nose", *TRUNK[:2], *ARMS, *TRUNK[2:])


SUBSETS: Mapping[str, tuple[str, ...]] = {
    "all": BODY_17,
    "upper": UPPER,
    "trunk": TRUNK,
    "arms": (*TRUNK[:2], *ARMS),
    "heads": HEAD,
    "hips and legs": BODY_17[11:],
    "left side": tuple(joint for joint in BODY_17 if joint.startswith("left")),
    "left side above the knee": ("left_eye", "left_ear", "left_shoulder", "left_elbow", "left_wrist", "left_hip"),
    "feet": BODY_17[15:],
    "one joint": ("left_wrist",),
}


NOTHING_TO_GO_ON = ("feet", "one joint")
"""Fewer joints than a person has to show."""


class Text(HTMLParser):
    """What a page shows, without scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.told: list[str] = []
        self._silent = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self._silent = tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._silent = False

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self.told.append(data)


def strict(text: str) -> dict[str, object]:
    """JSON without NaN and Infinity, which Python's own reader takes."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} stands in the JSON")

    content: dict[str, object] = json.loads(text, parse_constant=refuse)
    return content


@cache
def office() -> SimulatedScene:
    return simulate(SimulationOptions("terrace", seed=3, cameras=3, people=4, seconds=12.0, joint_noise_px=1.0))


@cache
def of_joints(which: str) -> passerby.Calibration:
    truth, joints = office(), SUBSETS[which]
    seen: dict[str, Keypoints] = {name: office_joints(truth.observations[name].keypoints, joints) for name in truth.rig.names}
    return passerby.calibrate_observations(truth.rig, keypoints=seen, fps=5.0, association={"mode": "given"})


def numbers(value: object) -> list[float]:
    """All floating-point numbers of a value of dataclasses, mappings and sequences."""
    if is_dataclass(value) and not isinstance(value, type):
        return [x for item in fields(value) for x in numbers(getattr(value, item.name))]
    if isinstance(value, Mapping):
        return [x for item in value.values() for x in numbers(item)]
    if isinstance(value, list | tuple):
        return [x for item in value for x in numbers(item)]
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return [float(x) for x in value.ravel()]
    return [float(value)] if isinstance(value, float | np.floating) else []


@pytest.mark.parametrize("which", SUBSETS)
def test_every_number_is_one_and_every_text_makes_sense(which: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No lens is blamed that is right: what is missing is a part of the bodies."""
    found = of_joints(which)
    assert np.isfinite(numbers(found.figures)).all()
    poses = [(camera.pose.R_cw, camera.pose.centre) for camera in found.rig if camera.pose is not None]
    assert np.isfinite(numbers(poses)).all()
    assert not any(NOT_A_NUMBER.search(text) for text in found.reasons)
    assert found.reasons or found.verdict == "accepted"
    assert (found.verdict == "refused") == (which in NOTHING_TO_GO_ON)
    found.write(tmp_path)
    for path in tmp_path.rglob("*.json"):
        strict(path.read_text())
    assert not NOT_A_NUMBER.search((tmp_path / "rig.toml").read_text() if (tmp_path / "rig.toml").exists() else "")
    show_calibration(found, verbose=True)
    tell_reasons(found)
    shown = capsys.readouterr()
    assert not NOT_A_NUMBER.search(shown.out + shown.err + repr(found))
    assert which in NOTHING_TO_GO_ON or not any("distortion" in text or "intrinsics" in text for text in found.reasons)


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene file of heads, wrists and hips; boxes are not named in it."""
    truth = simulated("terrace", seconds=12.0)
    folder = tmp_path_factory.mktemp("loose")
    scene = write_scene(
        replace(truth, observations=without_joints(truth.observations, SEGMENT_ENDS)), folder / "scene", keypoints=True
    )
    scene.write_text("\n".join(line for line in scene.read_text().splitlines() if not line.startswith("tracks")))
    return scene


@pytest.fixture(scope="module")
def written(loose: Path) -> tuple[Path, Calibration]:
    calibration = passerby.calibrate(loose)
    calibration.write(loose.parent.parent / "out")
    return loose.parent.parent / "out", calibration


@pytest.mark.smoke
def test_the_command_says_it_in_words_and_ends_with_3(loose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    distance = '\n[[scale.distances]]\nbetween = ["C1", "C2"]\nmetres = 9.8\nsd_m = 0.01\n'
    measured = loose.with_name("measured.toml")
    measured.write_text(loose.read_text() + distance)
    for scene, scale in ((loose, "scale unknown: no observation"), (measured, "scale known to 0.3 %, from distance C1 to C2")):
        assert run(["calibrate", str(scene), "-o", str(tmp_path / "out"), "--no-report"]) == 3
        shown = capsys.readouterr()
        assert scale in shown.out
        assert "unknown" in next(line for line in shown.out.splitlines() if line.startswith("C1 "))
        assert "doubtful: nothing fixes " in shown.err
        assert not NOT_A_NUMBER.search(shown.out + shown.err)


def test_json_has_null_for_what_is_unknown(loose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(["calibrate", str(loose), "-o", str(out), "--no-report", "--json"]) == 3
    for text in (capsys.readouterr().out, (out / "calibration.json").read_text()):
        told = strict(text)
        figures, cameras = told["figures"], told["cameras"]
        assert isinstance(figures, dict)
        assert isinstance(cameras, list)
        assert figures["undetermined"] == ["scale", "vertical", "height of the ground"]
        assert all(camera["position_sigma_mm"] is None and camera["orientation_sigma_deg"] is None for camera in cameras)


def test_every_file_is_read_again(written: tuple[Path, Calibration], tmp_path: Path) -> None:
    folder, calibration = written
    truth = folder.parent / "scene" / "truth.toml"
    content = tomllib.loads((folder / "rig.toml").read_text())
    assert not NOT_A_NUMBER.search((folder / "rig.toml").read_text())
    assert not {"position_sigma_mm", "orientation_sigma_deg", "covariance"} & content["C1"].keys()
    assert passerby.read_calibration(folder).verdict == "doubtful"
    for rig in (folder / "rig.toml", calibration):
        comparison = passerby.evaluate(rig, truth)
        strict(json.dumps(comparison.to_dict()))
        assert comparison.stated is not None
        assert not comparison.stated.position_sigmas
        aligned = passerby.align(rig, camera="C2", towards="C4")
        write_rig(tmp_path / "aligned.toml", aligned.rig)
        assert read_rig(tmp_path / "aligned.toml").names == ("C1", "C2", "C3", "C4")
        for kind in ("colmap", "opencv", "anipose", "caliscope"):
            assert passerby.export_rig(rig, kind, tmp_path / f"{kind}_{type(rig).__name__}", lossy=True) is not None
    assert "nan" not in repr(calibration.rig["C1"])
    assert "sigma unknown" in repr(calibration.rig["C1"])
    assert not NOT_A_NUMBER.search(" ".join(Text(calibration._repr_html_()).told))


def test_the_report_says_unknown(written: tuple[Path, Calibration], capsys: pytest.CaptureFixture[str]) -> None:
    folder, calibration = written
    shown, at_once = (
        [text.strip() for text in Text(report_page(contents)).told]
        for contents in (contents_from(folder), contents_of(calibration))
    )
    assert shown == at_once
    assert not NOT_A_NUMBER.search(" ".join(shown))
    for name in ("scale uncertainty (1 sigma)", "worst camera position uncertainty", "up direction uncertainty (1 sigma)"):
        assert shown[shown.index(name) + 1] == "unknown"
    assert run(["report", str(folder)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.unit
def test_a_sigma_that_is_known_in_part_survives_the_file_and_an_infinite_one_counts_as_not_stated(tmp_path: Path) -> None:
    sigmas = (PoseSigma(np.inf, 0.2), PoseSigma(0.1, np.inf), PoseSigma(np.inf, np.inf), PoseSigma(0.1, 0.2, np.eye(6)))
    rig = Rig(tuple(replace(camera, sigma=sigma) for camera, sigma in zip(ring(4), sigmas, strict=True)))
    write_rig(tmp_path / "rig.toml", rig)
    again = [camera.sigma for camera in read_rig(tmp_path / "rig.toml")]
    assert again[2] is None
    told = [(one.position_m, one.orientation_deg, one.covariance is None) for one in again if one is not None]
    assert told == [(np.inf, 0.2, True), (0.1, np.inf, True), (0.1, 0.2, False)]
    # Beside `position_sds`, of which test_alignment_sigmas.py tells.
    none, infinite = (Rig(tuple(replace(camera, sigma=one) for camera in ring(3))) for one in (None, PoseSigma(np.inf, np.inf)))
    assert angle_sd(infinite["C1"]) == angle_sd(none["C1"])
    np.testing.assert_array_equal(rig_covariance_of(infinite, "C1"), rig_covariance_of(none, "C1"))
    judged = compare_stated_sigmas(infinite.cameras, [camera.pose for camera in none])
    assert judged.to_dict()["position_within_1_sigma"] is None
    assert (number(np.inf), number(np.nan), number(None)) == ("unknown", "-", "-")
