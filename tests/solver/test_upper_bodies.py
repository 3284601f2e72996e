"""People seen without their legs: segments tell the scale, trunks the up direction, and the ground is a guess or stated."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.core.scale_cues import CameraDistance, CameraHeight, ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import exp_rotation
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.solver.body_segments import HIP_SHARE, SEGMENTS, Bodies, bodies_in_space, body_scale, ground_below, segments_agree
from passerby.solver.body_vertical import LEAN_SD, SAME_POSTURE, SIDEWAYS_SD, SWAY_SD, body_vertical
from support.scenes.exact_sightings import poses_of
from support.scenes.operating_room import NAMES, identities_of_one_frame, operating_room
from support.scenes.people_and_rigs import solve
from support.scenes.upper_bodies import office_joints, without_joints
from support.tiers import thinned

UPPER = (
    "nose", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip",
    "right_hip",
)  # fmt: skip
STANDING = np.array([[0.0, 0.2, 1.45], [0.0, -0.2, 1.45], [0.0, 0.1, 0.95], [0.0, -0.1, 0.95]])
UNDETERMINED = "nothing fixes the scale, the up direction and the height of the ground: "
JOINTS = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


@cache
def room(preset: str, seed: int) -> tuple[SimulatedScene, Observations]:
    options = SimulationOptions(preset, seed=seed, cameras=3, people=5, seconds=20.0, joint_noise_px=1.5)
    truth = simulate(options)
    seen = {
        name: CameraObservations(keypoints=office_joints(one.keypoints, UPPER))
        for name, one in truth.observations.cameras.items()
    }
    return truth, Observations(seen, truth.observations.fps)


@cache
def solved(preset: str, seed: int) -> tuple[SimulatedScene, Solution]:
    truth, seen = room(preset, seed)
    return truth, solve(truth.rig, seen)


def tilt_deg(truth: Rig, solution: Solution) -> float:
    """The mean angle between the up direction of the cameras and the true one."""
    found, true = (
        np.array([camera.pose.R_cw[:, 2] for camera in rig if camera.pose is not None]) for rig in (solution.rig, truth)
    )
    return float(np.degrees(np.arccos(np.clip((found * true).sum(axis=1), -1, 1))).mean())


def scale_of(truth: SimulatedScene, solution: Solution) -> float:
    return float(np.linalg.norm(solution.rig["C1"].centre - solution.rig["C2"].centre) / np.linalg.norm(
        truth.rig["C1"].centre - truth.rig["C2"].centre))  # fmt: skip


@pytest.mark.slow
@thinned(("preset", "seed"), [("terrace", 1), ("terrace", 2), ("construction", 3)])
def test_scale_and_up_are_as_sure_as_stated(preset: str, seed: int) -> None:
    truth, solution = solved(preset, seed)
    scale, up = solution.figures.scale.relative_sigma, solution.figures.vertical_sigma_deg
    assert 0.06 < scale < 0.12
    assert abs(np.log(scale_of(truth, solution))) < scale
    assert 0.5 < up < 6
    assert tilt_deg(truth.rig, solution) < 2 * up
    assert [cue.kind for cue in solution.figures.scale.cues] == ["segments"]
    similar = compare(solution.rig, truth.rig).similarity
    assert similar.mean_position_mm < 60
    assert similar.mean_orientation_deg < 1.5
    assert solution.verdict == "doubtful"
    assert "ground_by_hips" in [finding.code for finding in solution.findings]
    assert all(camera.sigma.position_m > 0.25 for camera in solution.rig)


def test_a_camera_height_replaces_the_guess_at_the_ground() -> None:
    truth, seen = room("terrace", 1)
    height = CameraHeight("C2", float(truth.rig["C2"].centre[2]), 0.01)
    solution = solve(truth.rig, seen, ScaleCues(camera_heights=(height,)))
    assert "ground_by_hips" not in [finding.code for finding in solution.findings]
    assert {finding.values["what"] for finding in solution.findings} <= {"ground"}  # the up direction by trunks
    assert solution.rig["C2"].centre[2] == pytest.approx(height.metres, abs=0.02)
    assert abs(np.log(scale_of(truth, solution))) < solution.figures.scale.relative_sigma
    assert tilt_deg(truth.rig, solution) < 1 < solution.figures.vertical_sigma_deg < 6
    similar = compare(solution.rig, truth.rig).similarity
    assert similar.mean_position_mm < 5
    assert similar.mean_orientation_deg < 0.1
    assert 0.06 < solution.figures.scale.relative_sigma < 0.12  # a height over a ground on which no one is seen is no scale


@pytest.mark.slow
def test_a_measured_length_is_believed_and_a_wrong_one_is_named() -> None:
    truth, seen = room("terrace", 1)
    metres = float(np.linalg.norm(truth.rig["C1"].centre - truth.rig["C2"].centre))
    right, wrong = (
        solve(truth.rig, seen, ScaleCues(distances=(CameraDistance(("C1", "C2"), factor * metres, 0.01),))) for factor in (1, 2)
    )
    assert scale_of(truth, right) == pytest.approx(1, abs=0.005)
    assert right.figures.scale.relative_sigma < 0.01
    assert "scale_cues_disagree" not in [finding.code for finding in right.findings]
    (finding,) = [finding for finding in wrong.findings if finding.code == "scale_cues_disagree"]
    assert [cue.split()[0] for cue in finding.values["cues"]] == ["distance", "body"]


def test_a_camera_that_shares_nothing_has_no_part_in_it() -> None:
    truth, seen = room("terrace", 1)
    alone = Observations({**seen.cameras, "C3": CameraObservations()}, seen.fps)
    solution = solve(truth.rig, alone)
    assert solution.rig["C3"].pose is None
    assert abs(np.log(scale_of(truth, solution))) < 0.1


def bodies(trunks: np.ndarray, identity: np.ndarray) -> Bodies:
    return Bodies(identity, np.arange(len(identity)), trunks, JOINTS)


def test_a_person_who_leans_and_turns_shows_up_all_the_same() -> None:
    """All lean forwards by 0.3; those who face one way only are the less sure the way that they lean."""
    leaning = STANDING @ exp_rotation(np.array([0.0, 0.3, 0.0])).T
    turns = np.linspace(0, 2 * np.pi, 60, endpoint=False)[:, None] * [0.0, 0.0, 1.0]
    person = np.zeros(60, dtype=np.int64)
    turning, facing = (
        body_vertical(bodies(leaning @ exp_rotation(turn).transpose(0, 2, 1), person)) for turn in (turns, 0 * turns)
    )
    assert np.degrees(np.arccos(turning.up[2])) < 0.5
    assert np.degrees(np.arccos(facing.up[2])) > 5
    by_way = facing.basis.T @ facing.covariance @ facing.basis
    assert by_way[0, 0] > 4 * by_way[1, 1]
    assert np.trace(turning.covariance) < 0.5 * np.trace(facing.covariance)


@pytest.mark.parametrize("people", [1, 4])
def test_people_who_face_one_way_tell_the_up_direction_as_well_as_trunks_are_known_to_lean(people: int) -> None:
    """Each leans by `LEAN_SD` and `SIDEWAYS_SD`, and of three postures sways. Two shoulders and one hip slant."""
    each = 3 * SAME_POSTURE
    person = np.repeat(np.arange(people), each)
    found = body_vertical(Bodies(person, np.tile(np.arange(each), people), STANDING[None].repeat(len(person), axis=0), JOINTS))
    by_way = found.basis.T @ found.covariance @ found.basis
    forwards, sideways = ((sd**2 + SWAY_SD**2 / 3) / people for sd in (LEAN_SD, SIDEWAYS_SD))
    np.testing.assert_allclose(by_way, np.diag([forwards, sideways, 0.0]), atol=1e-9)
    half = body_vertical(Bodies(np.zeros(60, dtype=np.int64), np.arange(60), STANDING[None, :3].repeat(60, axis=0), JOINTS[:3]))
    sigmas = np.sqrt(np.linalg.eigvalsh(half.basis.T @ half.covariance @ half.basis)[1:])
    assert sigmas == pytest.approx(np.full(2, np.hypot(LEAN_SD, SWAY_SD / np.sqrt(3))), rel=0.02)


def test_a_person_who_is_measured_once_counts_and_moves_little() -> None:
    person = np.repeat(np.arange(3), (1, 8, 8))
    seen = np.where(person == 0, 1.5, 1.0)[:, None, None] * STANDING
    frame, mean, sd = np.arange(len(person)), np.full(3, 1.72), np.full(3, 0.1)
    shoulders = Bodies(person, frame, seen[:, :2], JOINTS[:2])
    found = body_scale(shoulders, mean, sd, np.arange(3))
    assert (found.people, found.segments) == (3, ("shoulders",))
    assert found.log_factor == pytest.approx(np.log(SEGMENTS[1].share * 1.72 / 0.4), abs=0.05)
    assert body_scale(shoulders, mean[:1], sd[:1], np.arange(1)) is not None
    up = np.array([0.0, 0.0, 1.0])
    ground = ground_below(bodies(seen, person), up, 1.0, np.arange(3), mean)
    assert ground == (pytest.approx(0.95 - HIP_SHARE * 1.72), "hips")
    vertical = body_vertical(bodies(seen[:1], person[:1]))
    assert np.sqrt(np.linalg.eigvalsh(vertical.covariance)) == pytest.approx(
        np.hypot((SIDEWAYS_SD, LEAN_SD), SWAY_SD), rel=0.02
    )


def test_ids_of_one_time_step_are_no_more_people_than_are_there_at_once() -> None:
    """Two people, each under a new number in each time step, lean by as much as they may."""
    frame = np.repeat(np.arange(60), 2)
    points = STANDING[None].repeat(len(frame), axis=0)
    by_ids = [body_vertical(Bodies(ids, frame, points, JOINTS)) for ids in (np.arange(120) % 2, np.arange(120))]
    known, unknown = (np.trace(one.covariance) for one in by_ids)
    assert unknown == pytest.approx(known)


@pytest.mark.parametrize(
    ("points", "joints", "expected"),
    [
        (STANDING[:2], JOINTS[:2], (pytest.approx(1.45 - 0.82 * 1.72), "shoulders")),
        (np.array([[0.0, 0.0, 1.6]]), ("head",), (pytest.approx(1.6 - 0.95 * 1.72), "heads")),
        (np.array([[0.0, 0.0, 1.6]]), ("left_wrist",), None),
    ],
    ids=["shoulders", "heads", "a wrist"],
)
def test_without_hips_shoulders_and_heads_show_the_ground(points, joints, expected) -> None:
    seen = Bodies(np.zeros(5, dtype=np.int64), np.arange(5), points[None].repeat(5, axis=0), joints)
    assert ground_below(seen, np.array([0.0, 0.0, 1.0]), 1.0, np.array([0]), np.array([1.72])) == expected


@thinned("lost", [(), ("hip",), ("hip", "elbow", "wrist"), ("hip", "head", "neck")], every=3)
@pytest.mark.parametrize("ids", ["hold", "of one time step"])
def test_ten_keypoints_under_the_ceiling_fix_the_world(lost: tuple[str, ...], ids: str) -> None:
    rig, seen = operating_room(4711)
    if ids != "hold":
        seen = identities_of_one_frame(seen)
    solution = solve(rig, without_joints(seen, lost))
    assert solution.figures.undetermined is None
    ratio = compare(solution.rig, rig).scale_ratio
    scale, up = solution.figures.scale, solution.figures.vertical_sigma_deg
    assert abs(np.log(ratio)) < 2 * scale.relative_sigma < 0.3
    assert tilt_deg(rig, solution) < 2 * up < 16
    (cue,) = scale.cues
    assert cue.kind == "segments"
    assert ("trunks" in cue.cue) == ("hip" not in lost)
    assert "shoulders" in cue.cue
    (world,) = [one.values["why"] for one in solution.findings if one.values.get("what") == "ground"][:1]
    assert world["values"]["by"] == ("shoulders" if lost else "hips")
    off = np.mean([solution.rig[name].centre[2] - rig[name].centre[2] for name in rig.names])
    assert abs(off) < 2 * world["values"]["sigma_m"]


def test_cameras_may_list_their_keypoints_in_different_orders() -> None:
    rig, seen = operating_room(4711)
    backwards = CameraObservations(keypoints=office_joints(seen["C2"].keypoints, NAMES[::-1]))
    found = [
        bodies_in_space(rig, *poses_of(rig), each, np.random.default_rng(0)).points
        for each in (seen, Observations({**seen.cameras, "C2": backwards}, seen.fps))
    ]
    np.testing.assert_allclose(*found)


def test_segments_that_contradict_each_other_tell_no_scale() -> None:
    """Shoulders as wide as the trunk is long: the names are of other joints."""
    person, mean, sd, who = np.zeros(20, dtype=np.int64), np.array([1.72]), np.array([0.1]), np.array([0])
    usual, odd = STANDING.copy(), STANDING.copy()
    usual[:2, 1] *= 0.9
    odd[:2, 1] *= 2.5
    right, wrong = (bodies(points[None].repeat(20, axis=0), person) for points in (usual, odd))
    assert abs(body_scale(right, mean, sd, who).log_factor) < 0.05
    assert segments_agree(right, mean, who)
    assert not segments_agree(wrong, mean, who)


@pytest.mark.parametrize("kind", ["terrace", "operating room"])
def test_joints_under_wrong_names_place_no_rig(kind: str) -> None:
    """Hips as elbows and elbows as hips: neither trunks nor arms are what they are called. Shoulders as hips: upside down."""
    if kind == "terrace":
        rig, seen, names, other = room("terrace", 1)[0].rig, room("terrace", 1)[1], UPPER, "elbow"
    else:
        rig, seen, names, other = *operating_room(4711), NAMES, "shoulder"
    wrong = tuple(name.replace("hip", "?").replace(other, "hip").replace("?", other) for name in names)
    renamed = {name: CameraObservations(keypoints=replace(one.keypoints, joints=wrong)) for name, one in seen.cameras.items()}
    solution = solve(rig, Observations(renamed, seen.fps))
    figures = solution.figures
    assert figures.undetermined == ("scale", "vertical", "height of the ground")
    assert solution.reasons[0].startswith(UNDETERMINED)
    assert solution.verdict == "doubtful"
    assert np.isinf([(camera.sigma.position_m, camera.sigma.orientation_deg) for camera in solution.rig]).all()
    assert figures.scale.relative_sigma is figures.vertical_sigma_deg is None
    assert all(pair.sigma_m is None for pair in figures.distances)
    assert all(0 < camera.shape_orientation_sigma_deg < 1 for camera in figures.cameras)
