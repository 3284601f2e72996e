"""Files that earlier releases wrote are read, and give what they gave; those of a later one are an error that says so."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.interchange.calibration_json import SCHEMA_VERSION
from passerby.interchange.rig_toml import RIG_FORMAT
from passerby.scene.tables import SCENE_FORMAT

RELEASES = sorted(path for path in Path(__file__).parent.iterdir() if (path / "out").is_dir())


@pytest.fixture(params=RELEASES, ids=lambda path: path.name)
def release(request, tmp_path):
    return Path(shutil.copytree(request.param, tmp_path / "release"))


def test_there_is_a_release():
    assert RELEASES


@pytest.mark.slow
def test_its_scene_is_calibrated_as_it_was(release):
    before, truth = passerby.read_rig(release / "out" / "rig.toml"), passerby.read_rig(release / "scene" / "truth.toml")
    found = passerby.calibrate(release / "scene" / "scene.toml")
    assert found.verdict == before.verdict == "accepted"
    now = passerby.evaluate(found.rig, truth).similarity.mean_position_mm
    then = passerby.evaluate(before, truth).similarity.mean_position_mm
    assert now < 1.5 * then + 10


def test_its_output_folder_is_read_by_every_command(release, tmp_path):
    out = str(release / "out")
    assert run(["report", out, "-o", str(tmp_path / "report.html")]) == 0
    assert run(["track", out]) == 0
    assert run(["export", out, "--format", "opencv", "-o", str(tmp_path / "opencv")]) == 0
    assert run(["align", out, "--camera", "C2", "-o", str(tmp_path / "aligned.toml")]) == 0
    folder = passerby.read_calibration(release / "out")
    assert folder.verdict == "accepted"
    assert len(folder.rig) == 4
    assert np.isfinite(folder.rig["C1"].centre).all()


def test_a_later_release(release):
    rig, scene, document = (
        release / "out" / "rig.toml", release / "scene" / "scene.toml", release / "out" / "calibration.json"
    )  # fmt: skip
    _change(rig, f"format_version = {RIG_FORMAT}", f"format_version = {RIG_FORMAT + 1}")
    with pytest.raises(InputError, match=r"rig\.toml: \[metadata\] format_version is 2, of a later Passerby"):
        passerby.read_rig(rig)
    scene.write_text(scene.read_text().replace("[scene]", f"[scene]\nformat_version = {SCENE_FORMAT + 1}", 1))
    with pytest.raises(InputError, match=r"scene\.toml.*format_version.*of a later Passerby"):
        passerby.calibrate(scene)
    _change(document, f'"schema_version": {SCHEMA_VERSION}', f'"schema_version": {SCHEMA_VERSION + 1}')
    with pytest.raises(InputError, match=r"calibration\.json: schema_version is 2, of a later Passerby"):
        passerby.read_calibration(release / "out")


def _change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
