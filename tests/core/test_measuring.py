"""How far off a rig measures: zero for the truth, small where intrinsics and pose compensate each other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.measuring import find_common_ground, measuring_errors
from passerby.core.observations import Boxes
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.simulation import SimulatedScene, SimulationOptions, simulate


@pytest.fixture(scope="module")
def made() -> SimulatedScene:
    return simulate(SimulationOptions(seconds=10.0, people=4, seed=3))


def changed(rig: Rig, name: str, turn_deg: float = 0.0, point_px: float = 0.0, shift_m: float = 0.0) -> Rig:
    """One camera of the rig turned about its vertical axis, with another principal point, or at another place."""
    camera = rig[name]
    matrix = np.array(camera.lens.matrix)
    matrix[0, 2] += point_px
    R = exp_rotation(np.array([0.0, np.radians(turn_deg), 0.0])) @ camera.pose.R_cw
    pose = Pose.from_centre(R, camera.pose.centre + np.array([shift_m, 0.0, 0.0]))
    other = Camera(name, replace(camera.lens, matrix=matrix), pose)
    return replace(rig, cameras=tuple(other if one.name == name else one for one in rig))


def test_the_truth_measures_without_error_in_any_frame_of_the_same_ground(made: SimulatedScene) -> None:
    moved = made.rig.moved(exp_rotation(np.array([0.0, 0.0, 1.1])), np.array([3.0, -2.0, 0.0]), 0.8)
    people = {name: made.observations[name].boxes for name in made.rig.names}
    for rig, seen in ((made.rig, None), (moved, None), (made.rig, people)):
        found = measuring_errors(rig, made.rig, seen)
        assert max(found.points.p90_mm, found.ground.p90_mm) < 0.1
        assert (set(found.cameras), found.of_people) == (set(made.rig.names), seen is not None)


def test_a_principal_point_and_a_rotation_compensate(made: SimulatedScene) -> None:
    """Each alone moves points far; together they are a large error of the rotation, and a small one of what is measured."""
    name = made.rig.names[0]
    degrees, pixels = 3.0, made.rig[name].lens.focal * np.tan(np.radians(3.0))
    both = changed(made.rig, name, degrees, -pixels)
    turned, shifted, together = (
        measuring_errors(rig, made.rig).points.median_mm
        for rig in (changed(made.rig, name, degrees), changed(made.rig, name, point_px=-pixels), both)
    )
    assert compare(both, made.rig).metric.orientation_deg[name] == pytest.approx(0.0, abs=1e-6)  # it is the reference
    assert 0.1 < together < 0.2 * min(turned, shifted)


def test_a_camera_that_is_elsewhere_errs_on_its_ground(made: SimulatedScene) -> None:
    name = made.rig.names[1]
    found = measuring_errors(changed(made.rig, name, shift_m=0.3), made.rig)
    assert max(found.cameras, key=lambda camera: found.cameras[camera].median_mm) == name
    assert 100 < found.cameras[name].median_mm < 500


def test_boxes_that_end_near_the_horizon_are_at_no_place_that_counts(made: SimulatedScene) -> None:
    """False boxes whose lower edges show ground 60 m away that two cameras see."""
    rig, camera = changed(made.rig, made.rig.names[1], turn_deg=0.2), made.rig.cameras[0]
    people = {name: made.observations[name].boxes for name in made.rig.names}
    feet = camera.project(np.column_stack([np.linspace(4.0, 6.0, 60), np.full(60, 60.0), np.zeros(60)]))
    seen = people[camera.name]
    with_far = Boxes(
        np.concatenate([seen.frame, np.arange(1, 61)]),
        np.concatenate([seen.identity, np.full(60, -1)]),
        np.concatenate([seen.ltwh, np.column_stack([feet - [5.0, 30.0], np.tile([10.0, 30.0], (60, 1))])]),
        np.ones(len(seen) + 60),
    )
    usual, found = (
        measuring_errors(rig, made.rig, {**people, camera.name: boxes}).points.median_mm for boxes in (seen, with_far)
    )
    assert found == pytest.approx(usual, rel=0.05)


def test_without_two_cameras_a_common_ground_or_people_nothing_is_measured(made: SimulatedScene) -> None:
    below = made.rig.moved(np.eye(3), np.array([0.0, 0.0, -50.0]))
    assert len(find_common_ground(below)) == 0
    assert measuring_errors(Rig((made.rig.cameras[0],)), made.rig) is None
    assert measuring_errors(made.rig, below) is None
    assert measuring_errors(made.rig, made.rig, dict.fromkeys(made.rig.names, Boxes.empty())) is None


def test_evaluate_states_points_and_ground(made: SimulatedScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rig(tmp_path / "truth.toml", made.rig)
    write_rig(tmp_path / "rig.toml", changed(made.rig, made.rig.names[0], shift_m=0.2))
    (tmp_path / "tracks").mkdir()
    for name in made.rig.names:
        write_boxes(tmp_path / "tracks" / f"{name}.txt", made.observations[name].boxes)
    command = ["evaluate", str(tmp_path / "rig.toml"), str(tmp_path / "truth.toml")]
    assert run([*command, "--json"]) == 0
    grid = json.loads(capsys.readouterr().out)
    assert run([*command, "--people", str(tmp_path), "--json"]) == 0
    people = json.loads(capsys.readouterr().out)
    for found in (grid, people):
        assert 1 < found["points"]["median_mm"] < found["points"]["p90_mm"] < 1000
        assert set(found["ground"]["cameras"]) == set(made.rig.names)
    assert grid["points"] != people["points"]
    assert run([*command, "--people", str(tmp_path / "tracks")]) == 0
    assert "places where people walked: points by all cameras: median" in capsys.readouterr().out
    assert run([*command, "--people", str(tmp_path / "none")]) == 2
