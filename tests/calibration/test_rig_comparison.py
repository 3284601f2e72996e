"""Whose people two rigs are held against: those of a calibration's folder, or of a scene that is calibrated for it."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from passerby.calibration import rig_comparison
from passerby.calibration.rig_comparison import compare_rigs
from passerby.common.errors import EvidenceError, InputError
from support.scenes.people_and_rigs import part, ring, simulated


def test_a_scene_whose_people_cannot_be_associated_and_a_damaged_folder_are_told(monkeypatch, tmp_path: Path) -> None:
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
