"""A rig whose scale, vertical and ground nothing fixes: no NaN in any file or line, and every file can be read again."""

import json
import re
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.calibration.alignment.places import angle_sd
from passerby.calibration.calibration import Calibration, contents_of
from passerby.cli.main import run
from passerby.cli.terminal import number
from passerby.core.cameras import PoseSigma, Rig
from passerby.evaluation.metrics import compare_stated_sigmas
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.monitoring.evidence import rig_covariance_of
from passerby.report.contents import contents_from
from passerby.report.page import report_page
from passerby.simulation import write_scene
from support.scenes.people_and_rigs import ring, simulated
from support.scenes.upper_bodies import SEGMENT_ENDS, without_joints

pytestmark = pytest.mark.system

NOT_A_NUMBER = re.compile(r"(?<![\w-])(nan|inf|infinity)(?!\w)", re.IGNORECASE)
WANT_OF_EVIDENCE = 3


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
        assert run(["calibrate", str(scene), "-o", str(tmp_path / "out"), "--no-report"]) == WANT_OF_EVIDENCE
        shown = capsys.readouterr()
        assert scale in shown.out
        assert "unknown" in next(line for line in shown.out.splitlines() if line.startswith("C1 "))
        assert "doubtful: nothing fixes " in shown.err
        assert not NOT_A_NUMBER.search(shown.out + shown.err)


def test_json_has_null_for_what_is_unknown(loose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(["calibrate", str(loose), "-o", str(out), "--no-report", "--json"]) == WANT_OF_EVIDENCE
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
def test_a_sigma_that_is_known_in_part_survives_the_file(tmp_path: Path) -> None:
    sigmas = (PoseSigma(np.inf, 0.2), PoseSigma(0.1, np.inf), PoseSigma(np.inf, np.inf), PoseSigma(0.1, 0.2, np.eye(6)))
    rig = Rig(tuple(replace(camera, sigma=sigma) for camera, sigma in zip(ring(4), sigmas, strict=True)))
    write_rig(tmp_path / "rig.toml", rig)
    again = [camera.sigma for camera in read_rig(tmp_path / "rig.toml")]
    assert again[2] is None
    told = [(one.position_m, one.orientation_deg, one.covariance is None) for one in again if one is not None]
    assert told == [(np.inf, 0.2, True), (0.1, np.inf, True), (0.1, 0.2, False)]


@pytest.mark.unit
def test_what_uses_sigmas_takes_infinite_ones_as_not_stated() -> None:
    """Beside `position_sds`, of which test_alignment_sigmas.py tells."""
    none, infinite = (Rig(tuple(replace(camera, sigma=one) for camera in ring(3))) for one in (None, PoseSigma(np.inf, np.inf)))
    assert angle_sd(infinite["C1"]) == angle_sd(none["C1"])
    np.testing.assert_array_equal(rig_covariance_of(infinite, "C1"), rig_covariance_of(none, "C1"))
    judged = compare_stated_sigmas(infinite.cameras, [camera.pose for camera in none])
    assert judged.to_dict()["position_within_1_sigma"] is None
    assert (number(np.inf), number(np.nan), number(None)) == ("unknown", "-", "-")
