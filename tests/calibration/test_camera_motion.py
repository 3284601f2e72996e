"""Cameras that move, zoom or keep turning while they film: found, dated, measured and left out; and cameras that stay."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import passerby
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import DetectedDrift, DetectedMotion, _without, findings_of_motions
from passerby.core.cameras import Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.evaluation.metrics import compare
from passerby.findings.texts import remedy_of
from passerby.hypotheses.camera_path import CameraPath, fit_path, residuals_along
from passerby.hypotheses.changes import FoundChange, PoseChange, PoseDrift, drift_of, fit_drift, step_of, suspect_change
from passerby.hypotheses.correspondences import Correspondences, match_people
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Disturbance, Move, Zoom, film_disturbed, gradual_zoom, rig_after
from support.tiers import thinned

MOVED = SimulationOptions(seconds=32.0, people=6, box_noise=0.02, seed=3)
ZOOMED = SimulationOptions(seconds=24.0, people=6, box_noise=0.02, missing=0.1, seed=3900)
DRIFTED = replace(MOVED, seconds=40.0)
FPS, BODY_M, DEGREES = 5.0, 1.72, 2.0


@cache
def filmed(disturbances: tuple[Disturbance, ...] = (), options: SimulationOptions = MOVED) -> SimulatedScene:
    return simulate(options, film_disturbed(options, disturbances))


@cache
def calibrated(
    disturbances: tuple[Disturbance, ...] = (), options: SimulationOptions = MOVED, *, known: bool = True
) -> Calibration:
    scene = filmed(disturbances, options)
    lenses = {camera.name: camera.lens if known else Lens.unknown(camera.lens.size) for camera in scene.rig}
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    association = {"mode": "combined" if options.unrelated_ids else "given", "max_offset_s": 0.0}
    return passerby.calibrate_observations(lenses, boxes, fps=FPS, association=association)


def matched(scene: SimulatedScene, name: str, *, given: bool = True) -> Correspondences:
    """What a camera saw with the people that the others see, by the true rig."""
    middles, c = identified_body_centres(scene.rig, scene.observations), scene.rig.names.index(name)
    own = middles[c]
    assert own is not None
    if not given:
        own = replace(own, identity=17 - own.identity)  # tracklets that mean nothing elsewhere
    return match_people(own, triangulate_people(scene.rig, middles, BODY_M, excluding=c), BODY_M, given=given)


def compared(m: Correspondences, scene: SimulatedScene, name: str) -> FoundChange | None:
    """What changed, by the true rig."""
    suspect = suspect_change(m, scene.rig[name].pose, FPS, len(scene.rig))
    return None if suspect is None else suspect.compared()


def change_of(scene: SimulatedScene, name: str, *, given: bool = True, stated: bool = True) -> PoseChange | None:
    """The step that is found."""
    m = matched(scene, name, given=given)
    change = compared(m, scene, name)
    return None if change is None else step_of(m, change, stated=stated)


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
    change = change_of(filmed((move,)), move.camera, given=given)
    assert change.zoom == 1.0
    if not change.at_start:
        assert abs((change.spans[0][0] - 1) / FPS - move.from_s) < 1.0
        assert change.at_end
    else:
        assert abs(change.spans[-1][1] / FPS - move.from_s) < 1.0
    true_m, true_deg = np.linalg.norm(move.shift_m), np.linalg.norm(move.turn_deg)
    assert change.degrees == pytest.approx(true_deg, abs=0.3 * true_deg + 0.3)
    assert change.metres == pytest.approx(true_m, abs=0.3 * true_m + 0.1)


@pytest.mark.slow
def test_a_knock_and_back_is_found():
    change = change_of(filmed((Move("C2", 12.0, turn_deg=(0.0, 3.0, 0.0), until_s=20.0),)), "C2")
    assert not change.at_start
    assert not change.at_end
    assert abs((change.spans[0][0] - 1) / FPS - 12.0) < 1.0
    assert abs(change.spans[-1][1] / FPS - 20.0) < 1.0


@pytest.mark.slow
def test_pixels_across_and_pixels_down_count_alike():
    """A camera's pose is the same where the picture's columns are taken for its rows."""
    m, start = matched(filmed(), "C2"), filmed().rig["C2"].pose
    exchanged = match_people(replace(m.own, middle_tangent=m.own.middle_tangent[:, ::-1]), m.people, BODY_M, given=True)
    here, there = (fit_path(one, CameraPath(start)).pose for one in (m, exchanged))
    np.testing.assert_allclose(there.centre, here.centre, atol=1e-9)
    assert np.linalg.norm(here.centre - start.centre) > 1e-6


@pytest.mark.parametrize("options", [MOVED, ZOOMED], ids=["moved", "zoomed"])
@pytest.mark.parametrize("given", [True, False])
def test_no_camera_of_a_still_rig_seems_to_move_or_zoom(given, options):
    scene = filmed((), options)
    assert [change_of(scene, name, given=given) for name in scene.rig.names] == [None] * len(scene.rig)


@pytest.mark.slow
def test_the_stretch_of_a_stated_lens_is_the_part_that_it_does_not_hold_for():
    """However long that is; of a lens that is estimated, the longer part stays."""
    scene = filmed((Zoom("C2", 8.0, 1.3),), ZOOMED)
    stated, estimated = (change_of(scene, "C2", stated=one) for one in (True, False))
    assert (stated.at_end, estimated.at_start) == (True, True)
    assert stated.zoom == pytest.approx(1.3, rel=0.04)
    assert estimated.zoom == pytest.approx(1 / 1.3, rel=0.04)


def test_a_zoomed_path_sees_what_the_zoomed_lens_sees():
    """Exactly so for a lens without distortion."""
    scene = filmed((), ZOOMED)
    m, pose = matched(scene, "C2"), scene.rig["C2"].pose
    lens = replace(scene.rig["C2"].lens, distortions=np.zeros(0))
    matrix = np.array(lens.matrix)
    matrix[:2, :2] *= 1.3
    there, pixels = replace(lens, matrix=matrix), lens.project_rays(m.own.middle)
    ray = there.bearings(pixels)
    by_path, by_lens = (
        residuals_along(replace(m, own=replace(m.own, middle=rays, middle_tangent=one.tangents(rays))), path).found.residual
        for rays, one, path in ((m.own.middle, lens, CameraPath(pose, float(np.log(1.3)))), (ray, there, CameraPath(pose)))
    )
    near = np.abs(by_lens).max(axis=0) < 20.0
    assert near.sum() > 20
    np.testing.assert_allclose(by_path[:, near], by_lens[:, near], atol=1e-6)


@pytest.mark.slow
def test_a_gradual_zoom_takes_its_time():
    scene = filmed()
    steps = gradual_zoom("C2", 4.0, 8.0, 1.5)
    after = rig_after(scene.rig, steps[:1])["C2"].lens.focal
    assert (steps[0].from_s, steps[-1].from_s, steps[-1].factor) == (4.0, pytest.approx(7.8), pytest.approx(1.5))
    assert after / scene.rig["C2"].lens.focal == pytest.approx(1.5 ** (1 / 20))


def turning(camera: str, degrees: float) -> tuple[Move, ...]:
    """A pan at one rate during the whole recording, a small step at each frame."""
    frames = round(DRIFTED.seconds * FPS)
    return tuple(Move(camera, k / FPS, turn_deg=(0.0, degrees * k / (frames - 1), 0.0)) for k in range(1, frames))


def one_drift(m: Correspondences, pose: Pose) -> PoseDrift:
    """A drift at one rate."""
    return drift_of(m, fit_drift(m, CameraPath(pose), 1), 0.0)


def test_a_steady_turn_is_measured() -> None:
    scene = filmed(turning("C2", DEGREES), DRIFTED)
    m = matched(scene, "C2")
    found = compared(m, scene, "C2")
    assert found.kind == "drifts"
    drift = drift_of(m, found.path, found.over_base.gain)
    assert drift.steady
    assert drift.degrees == pytest.approx(DEGREES, rel=0.1)
    assert drift.turn[-1, 1] - drift.turn[0, 1] == pytest.approx(np.radians(DEGREES), rel=0.1)


@thinned(
    "move",
    [
        Move("C2", 18.0, turn_deg=(0.0, 1.0, 0.0)),
        Move("C2", 16.0, turn_deg=(0.0, 2.0, 0.0), until_s=26.0),
        Move("C2", 20.0, turn_deg=(0.0, 6.0, 0.0), shift_m=(0.3, 0.0, 0.0)),
    ],
    ids=["step", "there and back", "knock"],
)
def test_a_step_is_no_drift(move: Move) -> None:
    scene = filmed((move,), DRIFTED)
    assert compared(matched(scene, "C2"), scene, "C2").kind == "moved"


def test_taking_a_drift_out_of_the_observations_stops_the_camera() -> None:
    scene = filmed(turning("C2", DEGREES), DRIFTED)
    m, pose = matched(scene, "C2"), scene.rig["C2"].pose
    drift = one_drift(m, pose)
    found = DetectedDrift("C2", (float(drift.knots[0]), float(drift.knots[-1])), FPS, drift)
    lens, seen = scene.rig["C2"].lens, scene.observations
    corrected = found.corrected(seen, lens)
    assert corrected["C1"] is seen["C1"]
    own = identified_body_centres(scene.rig, corrected)[1]
    assert one_drift(match_people(own, m.people, BODY_M, given=True), pose).degrees < 0.1 * DEGREES
    cut = ~seen["C2"].boxes.inside(lens.size)
    np.testing.assert_array_equal(corrected["C2"].boxes.ltwh[cut], seen["C2"].boxes.ltwh[cut])
    np.testing.assert_allclose(corrected["C2"].boxes.ltwh[:, 2:], seen["C2"].boxes.ltwh[:, 2:])


def drifting(camera: str, pixels: float) -> DetectedDrift:
    turn = np.array([[0.0, -0.01, 0.0], [0.0, 0.01, 0.0]])
    return DetectedDrift(camera, (1.0, 601.0), 5.0, PoseDrift(np.array([1.0, 601.0]), turn, 100.0, pixels))


def test_a_drift_has_its_rate_and_cameras_that_all_drift_are_one_finding() -> None:
    rig = filmed(()).rig
    (alone,) = findings_of_motions([drifting("C2", 30.0)], rig)
    assert (alone.code, alone.severity, alone.cameras) == ("camera_drifts", "doubt", ("C2",))
    assert alone.values["minutes"] == pytest.approx(2.0)
    assert alone.values["degrees"] == pytest.approx(np.degrees(0.02))
    (together,) = findings_of_motions([drifting(name, 10.0 * k) for k, name in enumerate(("C3", "C1", "C4"), start=1)], rig)
    assert together.cameras == ("C1", "C3", "C4")
    assert together.values["pixels"] == [10.0, 30.0]
    assert len(findings_of_motions([drifting("C1", 10.0), drifting("C2", 10.0)], rig)) == 2


CHANGE = PoseChange(
    ((1, 1),), at_start=False, at_end=False, main=Pose(np.eye(3), np.zeros(3)),
    other=Pose.from_centre(np.eye(3), np.array([0.3, 0.0, 0.4])), gain=100.0, sigmas=50.0, shift=0.2,
)  # fmt: skip


def motion(first: int, last: int, *, fps: float | None = 25.0, zoom: float = 1.0, **ends: bool) -> DetectedMotion:
    """Of camera B, whose frames `first` to `last` were left out."""
    return DetectedMotion("B", ((first, last),), fps, replace(CHANGE, zoom=zoom, **ends))


@pytest.mark.parametrize(
    ("moved", "frames", "seconds", "left_out"),
    [
        (motion(501, 1000, at_end=True), [501, 501], [20.0, 20.0], "after"),
        (motion(1, 500, at_start=True), [501, 501], [20.0, 20.0], "before"),
        (motion(501, 751), [501, 751], [20.0, 30.0], "between"),
    ],
)
def test_a_move_is_reported_with_when_it_was_or_with_there_and_back(
    moved: DetectedMotion, frames: list[int], seconds: list[float], left_out: str
) -> None:
    told = moved.finding
    severity = "notice" if left_out == "between" else "doubt"  # the rig is right before and after
    assert (told.code, told.severity, told.cameras) == ("camera_moved", severity, ("B",))
    assert told.values["frames"] == frames
    assert told.values["seconds"] == pytest.approx(seconds)
    assert told.values["left_out"] == left_out
    assert told.values["metres"] == pytest.approx(0.5)
    assert told.values["factor"] is None
    # What a scene file takes are whole seconds that lie outside the margin of the move.
    assert seconds[0] - 0.5 - 1 < told.values["until_s"] <= seconds[0] - 0.5
    assert seconds[1] + 0.5 <= told.values["from_s"] < seconds[1] + 0.5 + 1


def test_a_camera_that_went_and_came_back_several_times_is_a_doubt_and_all_these_parts_are_left_out() -> None:
    parts = (101, 200), (301, 400), (501, 600)
    moved = DetectedMotion("B", parts, 25.0, replace(CHANGE, spans=parts, at_end=True))
    stated = moved.finding
    assert (stated.severity, stated.values["left_out"], stated.values["times"]) == ("doubt", "between", 3)
    assert (stated.values["frames"], stated.values["seconds"]) == ([101, 600], pytest.approx([4.0, 23.96]))
    assert moved.figures.frames == (101, 600)
    frames = np.array([88, 89, 100, 213, 250, 288, 300, 450, 612, 613])
    assert moved.contains(frames).sum() == 0
    assert moved.contains(frames, 12.0).tolist() == [False, True, True, False, False, False, True, False, True, False]


@pytest.mark.parametrize(("ends", "factor"), [({"at_end": True}, 1.25), ({}, 1.25), ({"at_start": True}, 0.8)])
def test_a_zoom_is_reported_as_the_picture_changed_in_the_course_of_time(ends: dict[str, bool], factor: float) -> None:
    """1.25 times the focal length before is 0.8 times after; without a frame rate it is told in frames alone."""
    told = motion(501, 1000, fps=None, zoom=1.25, **ends).finding
    assert told.code == "camera_moved"
    assert told.values["factor"] == pytest.approx(factor)
    assert told.values["frames"] == ([501, 1000] if not ends else [501, 501] if "at_end" in ends else [1001, 1001])
    assert told.values["seconds"] is told.values["until_s"] is told.values["from_s"] is None


@pytest.mark.parametrize(("fps", "margin"), [(20.0, 10), (4.0, 2)])
def test_half_a_second_before_and_after_is_left_out_as_well_and_of_that_camera_only(fps: float, margin: int) -> None:
    frame = np.arange(1, 101)
    boxes = Boxes(frame, np.zeros(100, int), np.full((100, 4), 50.0), np.ones(100))
    joints = Keypoints(frame, np.zeros(100, int), np.full((100, 1, 2), 50.0), np.ones((100, 1)), ("head",))
    seen = Observations({name: CameraObservations(boxes, joints) for name in "AB"}, fps)
    rest = _without(seen, motion(40, 60, fps=fps))
    left = [*range(1, 40 - margin), *range(60 + margin + 1, 101)]
    assert rest["B"].boxes.frame.tolist() == rest["B"].keypoints.frame.tolist() == left
    assert len(rest["A"].boxes) == len(rest["A"].keypoints) == 100


def assert_right(calibration: Calibration, true: Rig, options: SimulationOptions) -> None:
    """Nearly as right as that of cameras that stand still."""
    errors, usual = compare(calibration.rig, true), compare(calibrated((), options).rig, filmed((), options).rig).similarity
    assert not errors.missing
    assert errors.similarity.mean_position_mm < 1.5 * usual.mean_position_mm
    assert errors.similarity.mean_orientation_deg < 1.5 * usual.mean_orientation_deg


@pytest.mark.system
@pytest.mark.parametrize("options", [MOVED, replace(MOVED, unrelated_ids=True, tracklet_seconds=10.0)], ids=["given", "found"])
def test_what_a_moved_camera_saw_afterwards_is_left_out(options):
    move = Move("C2", 21.0, turn_deg=(0.0, 6.0, 0.0), shift_m=(0.3, 0.0, 0.0))
    calibration = calibrated((move,), options)
    assert calibration.verdict == "doubtful"
    (told,) = [reason for reason in calibration.reasons if reason.startswith("camera ")]
    assert told.startswith("camera C2 moved by 0.")
    assert " degrees at 2" in told
    left_out = "its pose is the one before the move, and its observations after the move were left out"
    assert f"{left_out}; under [cameras.C2] set until_s = 20 " in told
    assert "from_s = 22 for the pose after" in told
    (figures,) = calibration.figures.moved
    assert abs(figures.seconds[0] - 21.0) < 1.0
    assert figures.degrees == pytest.approx(6.0, rel=0.3)
    assert figures.metres == pytest.approx(0.3, rel=0.3)
    assert_right(calibration, filmed((), options).rig, options)


@pytest.mark.system
def test_a_tour_between_two_poses_is_one_finding_and_the_rig_is_that_of_the_pose_seen_most():
    away = [(5.0, 9.0), (15.0, 18.0), (24.0, 28.0)]
    tour = tuple(Move("C2", begin, turn_deg=(0.0, 6.0, 0.0), until_s=end) for begin, end in away)
    calibration = calibrated(tour)
    (stated,) = [finding for finding in calibration.diagnostics if finding.code == "camera_moved"]
    assert (stated.severity, stated.cameras, stated.values["times"]) == ("doubt", ("C2",), 3)
    assert stated.values["seconds"] == pytest.approx([5.0, 28.0], abs=1.0)
    assert stated.values["degrees"] == pytest.approx(6.0, abs=0.5)
    assert calibration.verdict == "doubtful"
    assert_right(calibration, filmed().rig, MOVED)


@pytest.mark.system
def test_the_longer_part_is_kept():
    move = Move("C2", 11.0, turn_deg=(0.0, 6.0, 0.0))
    calibration = calibrated((move,))
    (told,) = calibration.reasons
    left_out = "its pose is the one after the move, and its observations before the move were left out"
    assert f"{left_out}; under [cameras.C2] set from_s = 12 " in told
    assert_right(calibration, rig_after(filmed().rig, [move]), MOVED)


@pytest.mark.system
def test_a_still_rig_is_accepted_and_nothing_is_left_out():
    assert calibrated().verdict == "accepted"
    assert calibrated().figures.moved == ()


@pytest.mark.system
def test_a_camera_that_keeps_turning_is_one_finding_and_its_rig_is_right() -> None:
    found = calibrated(turning("C2", DEGREES), DRIFTED)
    (reason,) = found.reasons
    assert reason.startswith("camera C2 drifts by ")
    assert "degrees) a minute" in reason
    assert found.verdict == "doubtful"
    assert not found.figures.moved
    (figures,) = found.figures.drifts
    assert figures.degrees == pytest.approx(DEGREES, rel=0.1)
    # Its mean orientation lies half of the drift away from that at the beginning.
    errors = compare(found.rig, filmed(turning("C2", DEGREES), DRIFTED).rig).similarity
    assert errors.mean_orientation_deg < 0.25 * DEGREES + 0.1
    assert errors.mean_position_mm < 60


@pytest.mark.slow
@pytest.mark.parametrize("unrelated", [{}, {"unrelated_ids": True, "tracklet_seconds": 10.0}], ids=["given", "found"])
def test_a_zoom_is_named_and_what_was_seen_with_it_left_out(unrelated):
    zoom, options = (Zoom("C2", 24.0, 1.3),), replace(ZOOMED, seconds=40.0, **unrelated)
    calibration = calibrated(zoom, options)
    assert calibration.verdict == "doubtful"
    (finding,) = [one for one in calibration.diagnostics if one.code == "camera_moved"]
    assert (finding.cameras, finding.values["left_out"]) == (("C2",), "after")
    assert finding.values["factor"] == pytest.approx(1.3, rel=0.04)
    assert finding.values["seconds"][0] == pytest.approx(24.0, abs=1.0)
    assert "until_s = 23" in remedy_of(finding)
    (figures,) = calibration.figures.moved
    assert figures.zoom == finding.values["factor"]
    assert compare(calibration.rig, filmed(zoom, options).rig).similarity.mean_position_mm < 40


@pytest.mark.slow
def test_a_zoom_of_an_unknown_lens_is_named():
    calibration = calibrated((Zoom("C2", 24.0, 1.3),), replace(ZOOMED, seconds=40.0), known=False)
    assert calibration.verdict == "doubtful"
    (finding,) = [one for one in calibration.diagnostics if one.code == "camera_moved" and one.cameras == ("C2",)]
    assert finding.values["factor"] is not None
