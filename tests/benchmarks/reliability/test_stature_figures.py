"""What all people of a recording have in common: groups that are drawn, heights of boxes, and what the page says of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from passerby.simulation import SimulationOptions, simulate

Bench = Callable[[str], ModuleType]
CLOSE = 1e-9


@pytest.fixture(scope="module")
def statures(bench: Bench) -> ModuleType:
    return bench("reliability.stature_figures")


def test_groups_are_drawn_by_their_seed_and_are_of_a_plausible_stature(statures: ModuleType) -> None:
    groups = statures.drawn_groups(np.random.default_rng(1), 20_000)
    assert np.array_equal(groups, statures.drawn_groups(np.random.default_rng(1), 20_000))
    assert -0.05 < groups.mean() < -0.01, "half of the people are women, and many countries are small"
    assert 0.03 < groups.std() < 0.05
    assert np.log(1.46 / 1.72) < groups.min() < groups.max() < np.log(1.86 / 1.72)
    for men, women in statures.MEN_AND_WOMEN_CM.values():
        assert 159 < men < 184
        assert 149 <= women < 171
        assert 8 < men - women < 16


def test_heights_of_boxes_are_held_against_whole_bodies(statures: ModuleType) -> None:
    scene = simulate(SimulationOptions(preset="terrace", seed=1, cameras=2, people=3, seconds=4.0, occlusion=False))
    taller = {name: replace(boxes, ltwh=boxes.ltwh * (1, 1, 1, 1.03)) for name, boxes in scene.truth.items()}
    for camera in scene.rig:
        ratios, away = statures.height_ratios(camera, taller[camera.name], scene)
        assert len(ratios) == len(away) > 10
        assert np.abs(ratios - np.log(1.03)).max() < CLOSE
        assert 1.0 < np.exp(away).min() < np.exp(away).max() < 30.0
        nothing = taller[camera.name].take(np.zeros(len(taller[camera.name]), dtype=bool))
        assert [len(column) for column in statures.height_ratios(camera, nothing, scene)] == [0, 0]


def test_the_page_has_the_constant_and_tells_scale_from_heights(statures: ModuleType) -> None:
    seen = {"a": _outcome("background", 0.02, 0.01), "b": _outcome("background", float("nan"), 0.03)}
    found = statures.tabulate(seen, {})
    assert found.run == f"POPULATION_BIAS = {statures.POPULATION_BIAS:g}"
    rows = {row[0]: row[1] for row in found.tables["POPULATION_BIAS"].rows}
    assert rows["boxes by the background, rendered films"] == "1"
    assert rows["heights of boxes by the background"] == "2"
    assert not any("by the network" in name for name in rows), "none was run"
    assert "The models were not at hand" in found.notes[1]
    both = seen | {"c": _outcome("network", 0.0, 0.0)}
    assert len(statures.tabulate(both, {}).notes) == 1
    assert "root mean square" in statures.tabulate({}, {}).notes[0], "without a film"


def test_without_models_there_are_films_by_silhouettes_alone(
    statures: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for folder in (None, tmp_path):
        monkeypatch.setattr(statures, "models_folder", lambda folder=folder: folder)
        assert {detector for detector, _, _ in statures.cases(2).values()} == {"background"}


def _outcome(detector: str, log_scale: float, log_boxes: float) -> dict[str, object]:
    return {"detector": detector, "log_scale": log_scale, "log_boxes": log_boxes, "boxes": 1}
