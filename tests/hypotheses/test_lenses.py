"""Stated lenses: wrong ones are found where they harm, right ones are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.measuring import (
    CameraMeasuring,
    Distances,
    MeasuringErrors,
    MeasuringFigures,
    MeasuringSigma,
    find_common_ground,
    measure_change,
)
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.hypotheses.alternatives import lens_alternatives
from passerby.hypotheses.comparison import effect
from passerby.hypotheses.findings import lens_corrected, lens_doubtful
from passerby.hypotheses.lenses import LensResult, examine_lenses
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.body import pose_joints
from passerby.simulation.lenses import looking_at
from passerby.simulation.observe import observe_camera
from passerby.simulation.scene import film
from passerby.solver.lens_unknowns import LENS_PARTS, LensUnknowns
from passerby.solver.people import PeopleOptions, PeopleSolution
from support.scenes.people_and_rigs import part, simulated, solve
from support.tiers import thinned

SOLVING = PeopleOptions(max_sightings=4000, max_joints=5000)
ALL = (0, 1, 2, 3)


def stated(preset: str, cameras: tuple[int, ...], change: tuple[float, float, float, float]) -> tuple[Rig, PeopleSolution]:
    """The true rig of a scene of 20 s, and a solution with some lenses stated wrongly.

    Args:
        preset: of the scene.
        cameras: with a wrong lens.
        change: logarithm of the factor on the focal length, the principal point in shares of the width, k1.
    """
    truth = simulated(preset)
    wrong = np.zeros((len(truth.rig), 4))
    wrong[list(cameras)] = change
    wrong[:, 1:3] *= np.array([camera.lens.size[0] for camera in truth.rig])[:, None]
    solution = solve(LensUnknowns(LENS_PARTS).rig(truth.rig, wrong), part(truth.observations), options=SOLVING)
    assert isinstance(solution, PeopleSolution)
    return truth.rig, solution


def suspects(result: LensResult) -> set[tuple[str, tuple[int, ...]]]:
    return {(one.alternative.code, one.alternative.cameras) for one in result.suspects}


@thinned("preset", ["terrace", "basketball", "construction"])
def test_right_lenses_raise_nothing(preset: str) -> None:
    _, solution = stated(preset, (), (0, 0, 0, 0))
    result = examine_lenses(solution)
    assert result.decision == "nothing"
    focals = [one for one in result.screened if one.alternative.code == "focal" and not one.alternative.alike]
    assert all(abs(one.change) < 4 * one.sigma for one in focals)


@pytest.mark.slow
@thinned(
    ("code", "cameras", "change"),
    [
        ("focal", (1,), (np.log(1.1), 0, 0, 0)),
        ("focal", ALL, (np.log(1.1), 0, 0, 0)),
        ("focal", ALL, (np.log(0.92), 0, 0, 0)),
        ("distortion", ALL, (0, 0, 0, 0.15)),
        ("principal_point", (2,), (0, 0.08, 0, 0)),
        ("principal_point", (2,), (0, -0.06, 0, 0)),
    ],
    quick=0,
)
def test_a_wrong_lens_is_found_and_corrected(
    code: str, cameras: tuple[int, ...], change: tuple[float, float, float, float]
) -> None:
    truth, solution = stated("basketball", cameras, change)
    result = examine_lenses(solution)
    assert result.decision == "correct"
    assert (code, cameras) in suspects(result)
    assert result.found is not None
    assert result.found.change[cameras[0], 0] == pytest.approx(-change[0], abs=0.02)
    assert result.found.change[cameras[0], 1] == pytest.approx(-change[1] * truth.cameras[0].lens.size[0], abs=20)
    corrected = result.found.corrected(solution.rig)
    for c, camera in enumerate(corrected):
        before = solution.rig.cameras[c].lens
        same = np.array_equal(camera.lens.matrix, before.matrix) and camera.lens.distortions[0] == before.distortions[0]
        assert same == (c not in cameras)
        assert (camera.lens.focal_sd is not None) is (code == "focal" and c in cameras)


@pytest.mark.slow
def test_a_focal_length_twice_as_long_is_not_passed_over() -> None:
    _, solution = stated("terrace", (1,), (np.log(2.0), 0, 0, 0))
    result = examine_lenses(solution)
    assert result.decision in ("correct", "doubt")
    assert ("focal", (1,)) in suspects(result)


@pytest.mark.slow
def test_a_corrected_rig_measures_what_the_true_one_measures() -> None:
    truth, solution = stated("basketball", (1,), (np.log(1.1), 0, 0, 0))
    result = examine_lenses(solution)
    assert result.found is not None
    places = find_common_ground(truth)
    after = solve(result.found.corrected(solution.rig), part(simulated("basketball").observations), options=SOLVING)
    wrong, right = measure_change(truth, solution.rig, places), measure_change(truth, after.rig, places)
    assert wrong is not None
    assert right is not None
    assert right.points.median_mm < 0.25 * wrong.points.median_mm


def uncertainty(points_mm: float, ground_mm: dict[str, float]) -> MeasuringFigures:
    """Of points, and on the ground by camera."""
    points = MeasuringSigma(median_mm=points_mm, p90_mm=points_mm)
    cameras = {
        name: CameraMeasuring(points=points, across=points, ground=MeasuringSigma(median_mm=mm, p90_mm=mm))
        for name, mm in ground_mm.items()
    }
    return MeasuringFigures(places=1, points=points, ground=None, ground_height_mm=None, cameras=cameras)


@pytest.mark.slow
def test_what_changes_measurements_by_less_than_their_uncertainty_is_a_notice() -> None:
    _, solution = stated("basketball", (1,), (np.log(1.1), 0, 0, 0))
    vague = replace(solution, figures=replace(solution.figures, measuring=uncertainty(1e4, {})))
    assert examine_lenses(vague).decision == "notice"
    tried = [one for one in lens_alternatives(solution.rig) if (one.code, one.cameras) == ("focal", (1,))]
    assert examine_lenses(solution, corrected=tried).decision == "nothing", "what is free contradicts nothing"


@pytest.mark.slow
def test_the_findings_say_which_camera_and_where_it_seems_cropped() -> None:
    truth, solution = stated("basketball", (2,), (0, 0.08, 0, 0))
    result = examine_lenses(solution)
    assert result.found is not None
    found = lens_corrected(result.found)
    assert (found.code, found.severity, found.cameras) == ("lens_corrected", "notice", ("C3",))
    assert found.values["principal_point"]["cropped"] == "left"
    width = truth.cameras[2].lens.size[0]
    assert found.values["principal_point"]["moved_px"] == pytest.approx(0.08 * width, rel=0.2)
    doubtful = lens_doubtful(result)
    assert (doubtful.code, doubtful.severity) == ("lens_doubtful", "doubt")


def test_the_effect_is_that_of_points_or_of_the_ground_that_changes_most() -> None:
    def change(points: float, ground: float) -> MeasuringErrors:
        of = (Distances(mm, 2 * mm, 9) for mm in (points, ground, ground))
        return MeasuringErrors(9, True, next(of), next(of), {"C1": next(of)}, 1.0)

    sigma = uncertainty(20.0, {"C1": 40.0})
    assert effect(change(30.0, 10.0), sigma) == pytest.approx(1.5)
    assert effect(change(30.0, 120.0), sigma) == pytest.approx(3.0)
    assert effect(change(30.0, 120.0), uncertainty(20.0, {})) == pytest.approx(1.5)


def on_a_wall(spacing_m: float, seed: int, *, converging: bool) -> tuple[Rig, Observations]:
    """Four cameras, 3 m high, 6 m in front of the middle of the people, parallel or aimed at it; boxes with 2 % of noise."""
    filmed, rng = film(SimulationOptions(seconds=30.0, people=6, seed=seed)), np.random.default_rng(seed)
    state, present = filmed.motion.at(np.arange(150) / 5.0)
    joints, size = pose_joints(state, filmed.heights), np.array([1280, 720])
    lens = Lens((1280, 720), np.array([[914.0, 0, 640], [0, 914, 360], [0, 0, 1]]), np.zeros(0))
    cameras, seen = [], {}
    for number in range(4):
        x = (number - 1.5) * spacing_m
        centre, aim = np.array([x, -6.0, 3.0]), np.array([0.0 if converging else x, 2.0, 0.8])
        camera = Camera(f"C{number + 1}", lens, Pose.from_centre(looking_at(centre, aim), centre))
        view = observe_camera(camera, joints, filmed.heights, present)
        frame, person = np.nonzero((view.inside > 0.5) & (view.hidden < 0.3))
        edges = view.visible_box[frame, person]
        edges = edges + 0.02 * rng.standard_normal(edges.shape) * (edges[:, 3] - edges[:, 1])[:, None]
        edges = np.clip(edges, 0, [*size, *size])
        ltwh = np.column_stack([edges[:, :2], edges[:, 2:] - edges[:, :2]])
        seen[camera.name] = CameraObservations(Boxes(frame + 1, person + 1, ltwh, np.ones(len(ltwh))))
        cameras.append(camera)
    return Rig(tuple(cameras)), Observations(seen, 5.0)


@pytest.mark.system
@thinned(
    ("spacing_m", "seed", "converging"),
    [(1.0, 1, False), (0.5, 1, False), (0.3, 1, False), (0.5, 12, True), (1.0, 11, True), (1.0, 13, True)],
    quick=1,
)
def test_a_right_rig_of_cameras_side_by_side_on_a_wall_is_accepted(spacing_m: float, seed: int, converging: bool) -> None:
    """They can trade all focal lengths for all distances: what fits better in the sample predicts people worse."""
    rig, observations = on_a_wall(spacing_m, seed, converging=converging)
    solution = solve(rig, observations, options=SOLVING)
    assert [one.code for one in solution.findings] == []
    assert isinstance(solution, PeopleSolution)
    assert examine_lenses(solution).decision == "nothing"
    found, true = (np.array([camera.centre for camera in one]) for one in (solution.rig, rig))
    across, wanted = (np.linalg.norm(np.diff(centres, axis=0), axis=1) for centres in (found, true))
    np.testing.assert_allclose(across / across.mean(), wanted / wanted.mean(), atol=0.05)


def misplaced(observations: Observations, joints3d: np.ndarray, rig: Rig, level: float, seed: int) -> Observations:
    """Joints off by `level` of the body: half of the variance alike by kind of joint, some of it by camera and by the person's
    heading. COCO's annotators differ by 1 to 5 % of the body's height, by kind.
    """
    rng = np.random.default_rng(seed)
    alike, cosine, sine = (rng.normal(0, level * share, (17, 2)) for share in (0.7, 0.4, 0.4))
    cameras = {}
    for camera in rig:
        seen = observations[camera.name]
        joints = joints3d[seen.keypoints.frame - 1, np.maximum(seen.keypoints.identity - 1, 0)]
        across = joints[:, 6, :2] - joints[:, 5, :2]
        ray = joints[:, 11, :2] - camera.pose.centre[:2]
        heading = np.arctan2(across[:, 0], -across[:, 1]) - np.arctan2(ray[:, 1], ray[:, 0])
        own = alike + rng.normal(0, 0.3 * level, (17, 2))
        off = own + cosine * np.cos(heading)[:, None, None] + sine * np.sin(heading)[:, None, None]
        tall = np.ptp(seen.keypoints.xy[:, :, 1], axis=1)
        keypoints = replace(seen.keypoints, xy=seen.keypoints.xy + tall[:, None, None] * np.nan_to_num(off))
        cameras[camera.name] = CameraObservations(seen.boxes, keypoints)
    return Observations(cameras, observations.fps)


@pytest.mark.slow
@thinned(
    ("preset", "seed", "cameras", "people", "seconds", "boxes"),
    [
        ("construction", 11, 3, 2, 10.0, True),
        ("construction", 11, 3, 5, 10.0, True),
        ("terrace", 12, 2, 1, 12.0, True),
        ("terrace", 12, 3, 2, 10.0, True),
        ("basketball", 11, 3, 2, 10.0, True),
        ("terrace", 3, 2, 2, 10.0, False),
    ],
)
def test_right_lenses_raise_nothing_where_joints_err_alike(
    preset: str, seed: int, cameras: int, people: int, seconds: float, boxes: bool
) -> None:
    scene = simulate(
        SimulationOptions(
            preset=preset, seed=seed, cameras=cameras, people=people, seconds=seconds, box_noise=0.03, joint_noise_px=0.5
        )
    )
    seen = misplaced(scene.observations, scene.joints3d, scene.rig, 0.025, seed)
    if not boxes:
        seen = Observations({name: replace(own, boxes=Boxes.empty()) for name, own in seen.cameras.items()}, seen.fps)
    solution = solve(scene.rig, seen, options=SOLVING)
    assert isinstance(solution, PeopleSolution)
    assert examine_lenses(solution).decision == "nothing"
