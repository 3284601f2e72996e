"""What scale and vertical rest on: people who contradict what the scale was taken from, and what bodies say of gravity."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import passerby
from passerby.calibration.calibration import Calibration
from passerby.calibration.in_memory import calibrate_observations
from passerby.core.observations import Keypoints
from passerby.geometry.rotations import direction_angle
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from support.scenes.people_and_rigs import part, simulated, without_poses

CODE = "scale_cues_disagree"
MEAN = {"person_height_m": 1.72}


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
@pytest.mark.parametrize("said", [MEAN, {"person_height_sd_m": 0.09}, {"person_height_mean_sd_m": 0.02}])
def test_boxes_of_half_height_are_named_whatever_is_written_under_scale(said: dict[str, float]) -> None:
    found = calibrated(made("terrace"), 0.5, scale=said)
    assert found.verdict == "doubtful"
    assert "population" in named(found)
    assert calibrated(made("terrace"), scale=said).verdict == "accepted"


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
@pytest.mark.parametrize("by", ["a distance", "positions"])
def test_a_length_or_camera_positions_that_make_people_giants_are_named(tmp_path, by) -> None:
    scene = made("terrace")
    centres = {camera.name: camera.pose.centre for camera in scene.rig}
    for factor, verdict in ((1.0, "accepted"), (1.75, "doubtful")):
        if by == "a distance":
            metres = factor * float(np.linalg.norm(centres["C1"] - centres["C3"]))
            tables = {"scale": {"distances": [{"between": ["C1", "C3"], "metres": metres}]}}
        else:
            rows = [f"{name},{','.join(str(factor * x) for x in centre)}" for name, centre in centres.items()]
            path = tmp_path / f"places{factor}.csv"
            path.write_text("camera,x,y,z\n" + "\n".join(rows) + "\n")
            tables = {"world": {"positions": str(path), "scale": True}}
        found = calibrated(scene, **tables)
        assert found.verdict == verdict, found.reasons
        told = [one.values["cues"] for one in found.doubts if one.code == CODE]
        if by == "a distance":
            assert told == [["distance C1 to C3"]] * (factor > 1)
        else:
            assert named(found) == ({"world"} if factor > 1 else set())


TRUTH = simulated("terrace", seconds=10.0)


@cache
def on_a_slope(tilt_deg: float) -> Calibration:
    """People who stand along gravity on a ground that is tilted, seen as keypoints."""
    joints = TRUTH.joints3d.copy()
    joints[..., 2] += np.tan(np.radians(tilt_deg)) * TRUTH.ground_positions[:, :, None, 0]
    rng, keypoints, shape = np.random.default_rng(0), {}, joints.shape[:3]
    for camera in TRUTH.rig:
        pixels = camera.project(joints.reshape(-1, 3)).reshape(*shape, 2) + rng.normal(0, 1.0, (*shape, 2))
        with np.errstate(invalid="ignore"):
            inside = ((pixels > 0) & (pixels < np.array(camera.lens.size))).all(axis=-1)
        frame, person = np.nonzero(inside.sum(axis=-1) >= 10)
        seen = inside[frame, person]
        xy = np.where(seen[..., None], pixels[frame, person], 0.0)
        keypoints[camera.name] = Keypoints(TRUTH.frames[frame], TRUTH.identities[person], xy, seen.astype(float))
    return calibrate_observations(
        without_poses(TRUTH.rig), keypoints=keypoints, fps=TRUTH.options.fps, association={"mode": "given"}
    )


def off_gravity(found: Calibration) -> float:
    """Degrees between z and gravity."""
    up = [
        camera.pose.R_cw.T @ TRUTH.rig[camera.name].pose.R_cw[:, 2] for camera in found.rig.posed() if camera.pose is not None
    ]
    return float(np.degrees(direction_angle(np.mean(up, axis=0), np.array([0.0, 0.0, 1.0]))))


def test_a_ramp_is_reported_and_z_is_its_normal() -> None:
    found = on_a_slope(3.0)
    up = found.figures.up
    assert up.direction == "ground normal"
    assert off_gravity(found) == pytest.approx(3.0, abs=0.3)
    assert up.tilt_deg == pytest.approx(3.0, abs=3 * up.tilt_sigma_deg)
    assert off_gravity(found) < 2 * up.gravity_sigma_deg
    (told,) = [one for one in found.diagnostics if one.code == "ground_tilted"]
    assert told.severity == "notice"
    assert found.verdict == "accepted"
    assert found.rig.metadata["up"].startswith("ground normal; gravity within")


@pytest.mark.slow
def test_level_ground_is_not_reported() -> None:
    found = on_a_slope(0.0)
    up = found.figures.up
    assert up is not None
    assert up.tilt_deg < 3 * up.tilt_sigma_deg
    assert off_gravity(found) < up.gravity_sigma_deg < 1.0
    assert not [one for one in found.diagnostics if one.code == "ground_tilted"]


@pytest.mark.slow
def test_boxes_leave_the_slope_of_the_ground_open() -> None:
    boxes = {name: seen.boxes for name, seen in part(TRUTH.observations).cameras.items()}
    found = calibrate_observations(without_poses(TRUTH.rig), boxes, fps=TRUTH.options.fps, association={"mode": "given"})
    up = found.figures.up
    assert up is not None
    assert up.tilt_deg is None
    assert up.gravity_sigma_deg > 1.0 > found.figures.vertical_sigma_deg
