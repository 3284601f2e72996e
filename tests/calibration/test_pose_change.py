"""Cameras that move while they film: found, told, left out; and cameras that stand still."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import passerby
from passerby.calibration.calibration import Calibration
from passerby.core.cameras import Rig
from passerby.evaluation.metrics import compare
from passerby.hypotheses.camera_path import CameraPath, fit_path
from passerby.hypotheses.changes import PoseChange, step_of, suspect_change
from passerby.hypotheses.correspondences import match_people
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Move, film_disturbed, rig_after
from support.tiers import thinned

OPTIONS = SimulationOptions(seconds=32.0, people=6, box_noise=0.02, seed=3)
UNRELATED = replace(OPTIONS, unrelated_ids=True, tracklet_seconds=10.0)
ZOOMED = replace(OPTIONS, seconds=24.0, missing=0.1, seed=3900)
"""The scene of test_zoom.py."""
BODY_M = 1.72


@cache
def moved(move: Move | None, options: SimulationOptions = OPTIONS) -> SimulatedScene:
    return simulate(options, film_disturbed(options, () if move is None else (move,)))


def calibrated(scene: SimulatedScene) -> Calibration:
    mode = "combined" if scene.options.unrelated_ids else "given"
    return passerby.calibrate_observations(
        scene.rig, {name: scene.observations[name].boxes for name in scene.rig.names}, fps=scene.options.fps,
        association={"mode": mode, "max_offset_s": 0.0},
    )  # fmt: skip


def changes(scene: SimulatedScene, *, given: bool = True) -> dict[str, PoseChange]:
    """The changes that are found, by camera and by the true rig."""
    middles = identified_body_centres(scene.rig, scene.observations)
    out = {}
    for c, camera in enumerate(scene.rig):
        people = triangulate_people(scene.rig, middles, BODY_M, excluding=c)
        own = middles[c]
        if not given:
            own = replace(own, identity=17 - own.identity)  # tracklets that mean nothing elsewhere
        assert camera.pose is not None
        m = match_people(own, people, BODY_M, given=given)
        suspect = suspect_change(m, camera.pose, 5.0, len(scene.rig))
        change = None if suspect is None else suspect.compared()
        if change is not None:
            out[camera.name] = step_of(m, change, stated=True)
    return out


@thinned(
    "move",
    [
        Move("C2", 19.0, turn_deg=(0.0, 1.0, 0.0)),
        Move("C3", 12.0, shift_m=(0.15, 0.0, 0.0)),
        Move("C1", 16.0, turn_deg=(4.0, 8.0, 3.0)),
    ],
)
@pytest.mark.parametrize("given", [True, False])
def test_a_move_is_dated_and_measured(move, given):
    change = changes(moved(move), given=given)[move.camera]
    assert change.zoom == 1.0
    if not change.at_start:
        assert abs((change.first - 1) / 5.0 - move.from_s) < 1.0
        assert change.at_end
    else:
        assert abs(change.last / 5.0 - move.from_s) < 1.0
    true_m, true_deg = np.linalg.norm(move.shift_m), np.linalg.norm(move.turn_deg)
    assert change.degrees == pytest.approx(true_deg, abs=0.3 * true_deg + 0.3)
    assert change.metres == pytest.approx(true_m, abs=0.3 * true_m + 0.1)


@pytest.mark.slow
def test_a_knock_and_back_is_found():
    change = changes(moved(Move("C2", 12.0, turn_deg=(0.0, 3.0, 0.0), until_s=20.0)))["C2"]
    assert not change.at_start
    assert not change.at_end
    assert abs((change.first - 1) / 5.0 - 12.0) < 1.0
    assert abs(change.last / 5.0 - 20.0) < 1.0


@pytest.mark.slow
def test_pixels_across_and_pixels_down_count_alike():
    """A camera's pose is the same where the picture's columns are taken for its rows."""
    scene = moved(None)
    people = triangulate_people(scene.rig, identified_body_centres(scene.rig, scene.observations), BODY_M, excluding=1)
    own = identified_body_centres(scene.rig, scene.observations)[1]
    assert own is not None
    exchanged = replace(own, middle_tangent=own.middle_tangent[:, ::-1])
    start = scene.rig["C2"].pose
    assert start is not None
    here, there = (fit_path(match_people(one, people, BODY_M, given=True), CameraPath(start)).pose for one in (own, exchanged))
    np.testing.assert_allclose(there.centre, here.centre, atol=1e-9)
    assert np.linalg.norm(here.centre - start.centre) > 1e-6


@pytest.mark.parametrize("options", [OPTIONS, ZOOMED], ids=["moved", "zoomed"])
@pytest.mark.parametrize("given", [True, False])
def test_no_camera_of_a_still_rig_seems_to_move_or_zoom(given, options):
    assert not changes(moved(None, options), given=given)


def assert_right(calibration: Calibration, true: Rig, mm: float, degrees: float) -> None:
    judged = compare(calibration.rig, true)
    assert not judged.missing
    assert judged.similarity.mean_position_mm < mm
    assert judged.similarity.mean_orientation_deg < degrees


@pytest.mark.system
@pytest.mark.parametrize("options", [OPTIONS, UNRELATED], ids=["given", "found"])
def test_what_a_moved_camera_saw_afterwards_is_left_out(options):
    move = Move("C2", 21.0, turn_deg=(0.0, 6.0, 0.0), shift_m=(0.3, 0.0, 0.0))
    scene = moved(move, options)
    still = compare(calibrated(moved(None, options)).rig, scene.rig).similarity
    calibration = calibrated(scene)
    assert calibration.verdict == "doubtful"
    (told,) = [reason for reason in calibration.reasons if reason.startswith("camera ")]
    assert told.startswith("camera C2 moved by 0.")
    assert " degrees at 2" in told
    assert (
        "its pose is the one before the move, and its observations after the move were left out; under [cameras.C2] set "
        "until_s = 20 " in told
    )
    assert "from_s = 22 for the pose after" in told
    (figures,) = calibration.figures.moved
    assert abs(figures.seconds[0] - 21.0) < 1.0
    assert figures.degrees == pytest.approx(6.0, rel=0.3)
    assert figures.metres == pytest.approx(0.3, rel=0.3)
    assert_right(calibration, scene.rig, 1.5 * still.mean_position_mm, 1.5 * still.mean_orientation_deg)


@pytest.mark.system
def test_the_longer_part_is_kept():
    move = Move("C2", 11.0, turn_deg=(0.0, 6.0, 0.0))
    scene = moved(move)
    calibration = calibrated(scene)
    (told,) = calibration.reasons
    assert (
        "its pose is the one after the move, and its observations before the move were left out; under [cameras.C2] set "
        "from_s = 12 " in told
    )
    still = compare(calibrated(moved(None)).rig, scene.rig).similarity
    after = rig_after(scene.rig, [move])
    assert_right(calibration, after, 1.5 * still.mean_position_mm, 1.5 * still.mean_orientation_deg)


@pytest.mark.system
def test_a_still_rig_is_accepted_and_nothing_is_left_out():
    calibration = calibrated(moved(None))
    assert calibration.verdict == "accepted"
    assert calibration.figures.moved == ()
