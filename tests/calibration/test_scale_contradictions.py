"""Rigs whose scale is wrong although all angles fit: what people do contradicts what the scale was taken from."""

from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

CODE = "scale_cues_disagree"


def made(preset: str) -> SimulatedScene:
    return simulate(SimulationOptions(preset=preset, seconds=30.0, people=6, box_noise=0.02, seed=1))


def calibrated(scene: SimulatedScene, share: float = 1.0, fps: float = 5.0, **tables: object) -> passerby.Calibration:
    """From boxes that show so much of each person, from the head down."""
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    boxes = {name: replace(one, ltwh=one.ltwh * (1, 1, 1, share)) for name, one in boxes.items()}
    lenses = {camera.name: camera.lens for camera in scene.rig}
    return passerby.calibrate_observations(lenses, boxes, fps=fps, association={"mode": "given"}, **tables)


def named(found: passerby.Calibration) -> set[str]:
    """The kinds of the cues that contradict each other."""
    told = [one.values for one in found.doubts if one.code == CODE]
    return {kind for values in told for kind in values["kinds"]}


@pytest.mark.system
@pytest.mark.parametrize("said", [{"person_height_m": 1.72}, {"person_height_sd_m": 0.09}, {"person_height_mean_sd_m": 0.02}])
def test_boxes_of_half_height_are_named_whatever_is_written_under_scale(said: dict[str, float]) -> None:
    scene = made("terrace")
    found = calibrated(scene, 0.5, scale=said)
    assert found.verdict == "doubtful"
    assert "population" in named(found)
    assert calibrated(scene, scale=said).verdict == "accepted"


@pytest.mark.system
def test_half_height_is_named_on_a_court_and_people_who_run_are_not() -> None:
    scene = made("basketball")
    assert "population" in named(calibrated(scene, 0.5, scale={"person_height_m": 1.72}))
    right = calibrated(scene, scale={"person_height_m": 1.72})
    assert right.verdict == "accepted"
    assert [cue.kind for cue in right.figures.scale.cues] == ["population", "walking_speed", "body_width"]


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["terrace", "basketball", "construction"])
def test_a_stated_mean_height_is_no_reason_to_believe_half_hidden_people(preset: str) -> None:
    """A counter hides the lower two fifths of everybody from all cameras: the rig is too large, and all angles fit."""
    scene = simulate(SimulationOptions(preset=preset, seed=4000, seconds=20.0, box_noise=0.02, missing=0.1))
    scale = {"person_height_m": 1.72, "person_height_mean_sd_m": 0.03}
    assert calibrated(scene, scale=scale).verdict == "accepted"
    assert calibrated(scene, 0.6, scale=scale).verdict == "doubtful"


@pytest.mark.system
def test_a_frame_rate_of_twice_the_true_one_is_named() -> None:
    found = calibrated(made("terrace"), fps=10.0)
    assert found.verdict == "doubtful"
    assert "walking_speed" in named(found)
    assert any("frame rate, which may be wrong" in reason for reason in found.reasons)


@pytest.mark.system
def test_a_length_that_makes_people_giants_is_named() -> None:
    scene = made("terrace")
    metres = float(np.linalg.norm(scene.rig["C1"].pose.centre - scene.rig["C3"].pose.centre))
    right = {"distances": [{"between": ["C1", "C3"], "metres": metres}]}
    wrong = {"distances": [{"between": ["C1", "C3"], "metres": 1.75 * metres}]}
    assert calibrated(scene, scale=right).verdict == "accepted"
    found = calibrated(scene, scale=wrong)
    (told,) = [one.values["cues"] for one in found.doubts if one.code == CODE]
    assert told == ["distance C1 to C3"]


@pytest.mark.slow
@pytest.mark.system
def test_camera_positions_that_make_people_giants_are_named(tmp_path) -> None:
    scene = made("terrace")
    for factor, verdict in ((1.0, "accepted"), (1.75, "doubtful")):
        rows = [f"{camera.name},{','.join(str(factor * x) for x in camera.pose.centre)}" for camera in scene.rig]
        path = tmp_path / f"places{factor}.csv"
        path.write_text("camera,x,y,z\n" + "\n".join(rows) + "\n")
        found = calibrated(scene, world={"positions": str(path), "scale": True})
        assert found.verdict == verdict, found.reasons
        assert named(found) == ({"world"} if factor > 1 else set())
