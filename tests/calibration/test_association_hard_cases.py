"""Input that is odd, poor or wrong where identities are to be found: what can be calibrated is, and the rest is told."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

import passerby
from passerby.cli.main import run
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.simulation import SimulationOptions, simulate, write_scene
from support.scenes.boxes_of_walks import boxes_of

pytestmark = pytest.mark.system

FAULTS = {"seconds": 20.0, "box_noise": 0.02, "missing": 0.1, "unrelated_ids": True, "tracklet_seconds": 4.0}
HEIGHTS = (1.75, 1.62, 1.85, 1.7, 1.68)
FRAMES = 150


def scene(folder, **options):
    simulated = simulate(SimulationOptions(**{**FAULTS, **options}))
    return simulated, write_scene(simulated, folder / "scene")


def edit(path, camera, change):
    """Change what a camera saw."""
    file = path.parent / "tracks" / f"{camera}.txt"
    boxes = change(read_boxes(file))
    write_boxes(file, boxes.take(np.lexsort((boxes.identity, boxes.frame))))


def declare(path, **tables):
    path.write_text(tomli_w.dumps({**tomllib.loads(path.read_text()), **tables}))


def declare_fps(path, camera, fps):
    cameras = tomllib.loads(path.read_text())["cameras"]
    declare(path, cameras={**cameras, camera: {**cameras[camera], "fps": fps}})


def forget_fps(path):
    declare(path, scene={"name": "of unknown rate"})


def started_later(frames):
    """The first frames are not there, and nothing tells of it."""
    return lambda boxes: replace(boxes.take(boxes.frame > frames), frame=boxes.frame[boxes.frame > frames] - frames)


def registered(calibration):
    return [camera.name for camera in calibration.rig if camera.pose is not None]


def assert_near_truth(calibration, truth, names=None, mm=40.0, degrees=0.2):
    """The cameras, all unless named, are where they are."""
    assert registered(calibration) == list(names or truth.names), calibration.reasons
    judged = compare(calibration.rig.posed(), Rig(tuple(camera for camera in truth if camera.name in registered(calibration))))
    assert judged.similarity.mean_position_mm < mm
    assert judged.similarity.mean_orientation_deg < degrees


def one_sentence(sentences, *parts):
    assert any(all(part in text for part in parts) for text in sentences), sentences


# --- people ---


@pytest.fixture(scope="module")
def terrace():
    return simulate(SimulationOptions(preset="terrace", box_noise=0.02, seconds=30))


def walking(rng):
    """All over the terrace."""
    points = rng.uniform(-1, 1, (60, 2)) * (3, 5)
    arrival = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]) / 1.2
    return np.column_stack([np.interp(np.arange(FRAMES) / 5, arrival, points[:, axis]) for axis in (0, 1)])


def standing(rng):
    return rng.uniform(-1, 1, 2) * (2.5, 4) + 0.02 * rng.standard_normal((FRAMES, 2))


def on_a_line(phase):
    """To and fro over 8 metres."""
    along = np.abs((np.arange(FRAMES) / 5 * 1.2 + phase) % 16 - 8) - 4
    return np.outer(along, (0.5, 0.87))


def seen(terrace, folder, ways, rng):
    """A scene of people on the given ways, in tracklets of four seconds whose numbers mean nothing."""
    walks = {number: (way, HEIGHTS[number % len(HEIGHTS)]) for number, way in enumerate(ways, start=1)}
    cameras = {}
    for k, (name, own) in enumerate(boxes_of(terrace.rig, walks, rng, noise=0.015).cameras.items()):
        boxes = own.boxes.take(rng.random(len(own.boxes)) > 0.1)
        number = np.unique(boxes.identity * 50 + (boxes.frame + 7 * k) // 20, return_inverse=True)[1]
        cameras[name] = CameraObservations(replace(boxes, identity=rng.permutation(number.max() + 1)[number] + 1))
    path = write_scene(replace(terrace, observations=Observations(cameras, 5.0)), folder / "scene")
    declare(path, association={"mode": "combined"})
    return path


def test_people_who_stand_among_walkers_do_no_harm(terrace, tmp_path):
    rng = np.random.default_rng(1)
    path = seen(terrace, tmp_path, [walking(rng), walking(rng), walking(rng), standing(rng), standing(rng)], rng)
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "accepted", calibration.reasons
    assert_near_truth(calibration, terrace.rig)


def test_people_who_only_stand_are_not_enough(terrace, tmp_path):
    """Where they stand may well fit, at any offset of the clocks."""
    rng = np.random.default_rng(2)
    calibration = passerby.calibrate(seen(terrace, tmp_path, [standing(rng) for _ in range(5)], rng))
    assert calibration.exit_status == 3
    one_sentence(calibration.reasons, "stand still", "record more people walking")


def test_one_line_is_not_enough(terrace, tmp_path):
    rng = np.random.default_rng(3)
    calibration = passerby.calibrate(seen(terrace, tmp_path, [on_a_line(5 * k) for k in range(3)], rng))
    assert calibration.exit_status == 3
    one_sentence(calibration.reasons, "on one straight line")


def test_one_person_and_two_cameras(tmp_path):
    simulated, path = scene(tmp_path, cameras=2, people=1, seconds=40.0)
    assert_near_truth(passerby.calibrate(path), simulated.rig, degrees=0.6)


# --- cameras ---


def test_two_cameras_at_one_place(terrace, tmp_path):
    rng = np.random.default_rng(1)
    own = terrace.rig["C2"]
    beside = Pose.from_centre(own.pose.R_cw, own.pose.centre + 0.12 * own.pose.R_cw[0])
    rig = Rig((*terrace.rig, Camera("C5", own.lens, beside)))
    calibration = passerby.calibrate(
        seen(
            replace(terrace, rig=rig, options=replace(terrace.options, cameras=5)),
            tmp_path,
            [walking(rng) for _ in range(4)],
            rng,
        )
    )
    assert calibration.verdict == "accepted", calibration.reasons
    assert_near_truth(calibration, rig)


def test_one_camera_found_twice_harms_no_pose_but_is_told(tmp_path):
    simulated, path = scene(tmp_path)
    rng = np.random.default_rng(4)

    def seen_again(boxes):
        corners = np.column_stack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])
        corners += 0.02 * boxes.ltwh[:, 3:] * rng.standard_normal((len(boxes), 4))
        size = np.maximum(corners[:, 2:] - corners[:, :2], 2.0)
        return replace(boxes, ltwh=np.column_stack([corners[:, :2], size]), identity=boxes.identity + 100 * (boxes.frame // 20))

    write_boxes(path.parent / "tracks" / "C5.txt", seen_again(simulated.truth["C2"]))
    lenses = tomllib.loads((path.parent / "intrinsics.toml").read_text())
    lenses["C5"] = lenses["C2"] | ({"name": "C5"} if "name" in lenses["C2"] else {})
    (path.parent / "intrinsics.toml").write_text(tomli_w.dumps(lenses))
    cameras = tomllib.loads(path.read_text())["cameras"]
    declare(path, cameras={**cameras, "C5": {"intrinsics": "intrinsics.toml", "tracks": "tracks/C5.txt"}})
    calibration = passerby.calibrate(path)
    one_sentence(calibration.reasons, "cameras C2 and C5 show the same", "delete [cameras.C5]")
    assert_near_truth(calibration, Rig((*simulated.rig, replace(simulated.rig["C2"], name="C5"))))


def test_a_camera_that_saw_nobody_is_named(tmp_path, capsys):
    _, path = scene(tmp_path)
    (path.parent / "tracks" / "C3.txt").write_text("")
    assert run(["calibrate", str(path), "-o", str(tmp_path / "out")]) == 3
    assert "camera C3 saw no person" in capsys.readouterr().err
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert [camera["registered"] for camera in report["cameras"]] == [True, True, False, True]


def test_ids_that_change_from_frame_to_frame_are_detections(tmp_path):
    simulated, path = scene(tmp_path)
    edit(path, "C3", lambda boxes: replace(boxes, identity=np.arange(1, len(boxes) + 1)))
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "accepted", calibration.reasons
    assert_near_truth(calibration, simulated.rig)
    one_sentence(calibration.findings, "camera C3", "treated as detections")


def test_ids_that_change_person_and_false_boxes(tmp_path):
    simulated, path = scene(tmp_path, identity_swaps=0.05, false_boxes=0.3)
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "accepted", calibration.reasons
    assert "clock_drifts" not in [notice.code for notice in calibration.notices], "the clocks are sound"
    assert_near_truth(calibration, simulated.rig)


# --- clocks ---


@pytest.mark.parametrize("stated", [10.0, 2.5])
def test_a_frame_rate_that_is_far_off_is_told_with_the_right_one(tmp_path, stated):
    simulated, path = scene(tmp_path)
    declare_fps(path, "C3", stated)
    calibration = passerby.calibrate(path)
    assert calibration.exit_status == 3
    assert_near_truth(calibration, simulated.rig, ["C1", "C2", "C4"])
    (lost,) = [doubt for doubt in calibration.doubts if "C3" in doubt.cameras]
    fixed = lost.values["why"]["values"]["fixed_by"]
    assert (fixed["code"], fixed["cameras"][0]) == ("other_rate_fits", "C3")
    assert (fixed["values"]["fits_fps"], fixed["values"]["fps"]) == (pytest.approx(5.0), stated)
    one_sentence(calibration.reasons, "camera C3", f"at 5 frames per second instead of {stated:g}", "check its fps")


def test_a_clock_that_drifts_is_told(tmp_path):
    """25 for 24 frames per second: 0.8 s over these 20 s, which an offset alone cannot remedy."""
    _, path = scene(tmp_path)
    declare_fps(path, "C3", 5.0 * 25 / 24)
    calibration = passerby.calibrate(path)
    assert calibration.exit_status == 3
    (drifting,) = [doubt for doubt in calibration.doubts if doubt.code == "clock_drifts"]
    assert drifting.cameras == ("C3",)
    assert drifting.values["drift_s"] < 1.0
    assert drifting.values["fits_fps"] == pytest.approx(5.0, abs=0.06)


def test_clocks_that_differ_by_more_than_is_searched_for(tmp_path):
    _, path = scene(tmp_path, cameras=2, seconds=40.0)
    edit(path, "C2", started_later(45))
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "refused"
    assert calibration.exit_status == 3
    one_sentence(calibration.reasons, "the clock of C2 is 9.0 s behind the clock of C1", "max_offset_s = ")
    declare(path, association={"mode": "combined", "max_offset_s": 10.0})
    fixed = passerby.calibrate(path)
    assert fixed.verdict == "accepted", fixed.reasons
    assert fixed.association.clocks["C2"].offset_s == pytest.approx(9.0, abs=0.05)


@pytest.mark.parametrize("fps", [1.0, 2.0])
def test_slow_cameras_of_unknown_rate(tmp_path, fps):
    simulated, path = scene(tmp_path, fps=fps, seconds=40.0, tracklet_seconds=0.0)
    forget_fps(path)
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "accepted", calibration.reasons
    assert_near_truth(calibration, simulated.rig)
    one_sentence(calibration.findings, "no frame rate is given")
