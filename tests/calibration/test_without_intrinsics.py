"""Scenes without intrinsics: from boxes alone, identities and clocks known or not, to a rig with its lenses."""

import json
import re

import numpy as np
import pytest

from passerby.calibration.calibrate import calibrate
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.data_sheet import sd_of_field
from passerby.core.figures import adjusted
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene


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


def test_check_says_that_they_are_estimated(short, tmp_path, capsys):
    path = without_intrinsics(short)
    assert run(["check", str(path)]) in (0, 3)
    assert "cameras C1 to C4: no intrinsics: focal length, principal point and distortion" in capsys.readouterr().out


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


def test_the_published_method_needs_them(short, capsys):
    path = without_intrinsics(short)
    text = re.sub(r"(?s)\[solver\].*", "", path.read_text())
    path.write_text(text + '[solver]\nmethod = "geopose"\nreference = "C1"\n')
    assert run(["check", str(path)]) == 2
    assert '[cameras.C1] has no intrinsics, but method "geopose" assumes that they are exact' in capsys.readouterr().err


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
