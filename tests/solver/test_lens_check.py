"""Lenses that contradict the people, and right ones that must not be accused where joints err or evidence is thin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.solution import Solution
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.body import pose_joints
from passerby.simulation.observe import observe_camera
from passerby.simulation.placement import looking_at
from passerby.simulation.scene import film
from passerby.solver.contradicted_lenses import LEAST_GAIN, MIN_INSTANTS
from passerby.solver.initialisation import Initialisation, refine_in_stages, select_initial_rig
from passerby.solver.lens_check import FAR_CHANGE, FAR_SIGMAS, FocalCheck, sizes_contradicted
from passerby.solver.lens_scores import LensHypothesis, LensScore, _FreeLenses, score_lenses
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people import PeopleOptions
from passerby.solver.uncertainty import design_effect
from support.scenes.people_and_rigs import part, simulated, solve, without_poses
from support.tiers import thinned

SOLVING = PeopleOptions(max_sightings=4000, max_joints=5000)


def misplaced(scene: SimulatedScene, level: float, seed: int) -> Observations:
    """The scene with joints off by `level` of the body: half of the variance alike by kind of joint, some of it by camera and
    by the person's heading. COCO's annotators differ by 1 to 5 % of the body's height, by kind.
    """
    rng = np.random.default_rng(seed)
    alike, cosine, sine = (rng.normal(0, level * share, (17, 2)) for share in (0.7, 0.4, 0.4))
    cameras = {}
    for camera in scene.rig:
        seen = scene.observations[camera.name]
        joints = scene.joints3d[seen.keypoints.frame - 1, np.maximum(seen.keypoints.identity - 1, 0)]
        across = joints[:, 6, :2] - joints[:, 5, :2]
        assert camera.pose is not None
        ray = joints[:, 11, :2] - camera.pose.centre[:2]
        heading = np.arctan2(across[:, 0], -across[:, 1]) - np.arctan2(ray[:, 1], ray[:, 0])
        own = alike + rng.normal(0, 0.3 * level, (17, 2))
        off = own + cosine * np.cos(heading)[:, None, None] + sine * np.sin(heading)[:, None, None]
        tall = np.ptp(seen.keypoints.xy[:, :, 1], axis=1)
        keypoints = replace(seen.keypoints, xy=seen.keypoints.xy + tall[:, None, None] * np.nan_to_num(off))
        cameras[camera.name] = CameraObservations(seen.boxes, keypoints)
    return Observations(cameras, scene.observations.fps)


@cache
def calibrated(preset: str, seed: int, cameras: int, people: int, seconds: float, boxes: bool) -> Solution:
    scene = simulate(
        SimulationOptions(
            preset=preset, seed=seed, cameras=cameras, people=people, seconds=seconds, box_noise=0.03, joint_noise_px=0.5
        )
    )
    seen = misplaced(scene, 0.025, seed)
    if not boxes:
        seen = Observations({name: replace(own, boxes=Boxes.empty()) for name, own in seen.cameras.items()}, seen.fps)
    return solve(scene.rig, seen, options=SOLVING)


def accusations(solution: Solution) -> list[str]:
    return [reason for reason in solution.reasons if "people fit" in reason]


def accused(solution: Solution) -> list[tuple[str, tuple[str, ...]]]:
    """Codes and cameras of what is said against lenses."""
    codes = ("focal_contradicted", "all_focals_contradicted", "image_seems_cropped", "lens_part_contradicted")
    return [(finding.code, finding.cameras) for finding in solution.findings if finding.code in codes]


@pytest.mark.slow
@thinned(
    "scene",
    [
        ("construction", 11, 3, 2, 10.0, True),
        ("construction", 11, 3, 5, 10.0, True),
        ("terrace", 12, 2, 1, 12.0, True),
        ("terrace", 12, 3, 2, 10.0, True),
        ("basketball", 11, 3, 2, 10.0, True),
        ("terrace", 3, 2, 2, 10.0, False),
    ],
    quick=2,
)
def test_right_lenses_are_not_accused_for_joints_that_err_alike(scene: tuple[str, int, int, int, float, bool]) -> None:
    assert accusations(calibrated(*scene)) == []


@cache
def stated(preset: str, factors: tuple[float, ...]) -> tuple[Solution, Rig]:
    """20 s of boxes with 2 % noise, the focal lengths stated wrong by factors."""
    truth = simulated(preset)
    rig = without_poses(LensUnknowns(("focal",)).rig(truth.rig, np.log(np.array(factors))[:, None]))
    return solve(rig, part(truth.observations), options=SOLVING), truth.rig


@thinned("factors", [(1.0, 1.0, 1.0, 1.0), (1.0, 1.1, 1.0, 1.0), (1.0, 0.8, 1.0, 1.0), (1.15,) * 4], quick=2)
@pytest.mark.slow
def test_steps_of_focal_lengths_lead_to_the_true_ones(factors: tuple[float, ...]) -> None:
    """Columns at the observed points would add the noise's own square: +0.01 to +0.05 here, and +1 where people tell little."""
    solution, _ = stated("basketball", factors)
    for camera, factor in zip(solution.figures.cameras, factors, strict=True):
        assert camera.focal_change == pytest.approx(-np.log(factor), abs=max(0.02, 0.25 * abs(np.log(factor))))
        assert abs(camera.focal_change + np.log(factor)) < 3 * camera.focal_change_sigma


@pytest.mark.slow
@thinned(("factors", "camera"), [((1.0, 1.05, 1.0, 1.0), "C2"), ((1.05,) * 4, ""), ((1.0, 1.3, 1.0, 1.0), "C2")], quick=2)
def test_a_wrong_focal_length_is_named_with_its_size_and_nothing_else(factors: tuple[float, ...], camera: str) -> None:
    solution, _ = stated("basketball", factors)
    code, cameras = ("focal_contradicted", (camera,)) if camera else ("all_focals_contradicted", ())
    assert accused(solution) == [(code, cameras)]
    (finding,) = (finding for finding in solution.findings if finding.code == code)
    assert finding.values["change"] == pytest.approx(1 / max(factors) - 1, abs=0.01)
    assert solution.verdict == "doubtful"


@thinned("preset", ["terrace", "basketball", "construction"])
def test_right_lenses_are_not_accused(preset: str) -> None:
    solution, _ = stated(preset, (1.0,) * 4)
    assert accused(solution) == []
    assert solution.verdict == "accepted"


@cache
def with_lens(preset: str, camera: str, change: Callable[[Lens], Lens], also: str | None = None) -> Solution:
    """The same with another lens stated for one camera, or two."""
    truth = simulated(preset)
    rig = Rig(tuple(replace(c, lens=change(c.lens)) if c.name in (camera, also) else c for c in truth.rig))
    return solve(rig, part(truth.observations), options=SOLVING)


def off_centre(lens: Lens, share: float) -> Lens:
    matrix = np.array(lens.matrix)
    matrix[0, 2] += share * lens.size[0]
    return replace(lens, matrix=matrix)


@pytest.mark.slow
@thinned(("share", "side"), [(0.08, "left"), (-0.05, "right")])
def test_an_image_cropped_on_one_side_is_named_as_such(share: float, side: str) -> None:
    """People put the principal point nearer to the side that was cut than where it is stated."""
    change = _OFF[share]
    solution = with_lens("basketball", "C3", change)
    assert accused(solution) == [("image_seems_cropped", ("C3",))]
    (finding,) = (finding for finding in solution.findings if finding.code == "image_seems_cropped")
    assert finding.values["side"] == side
    width = simulated("basketball").rig["C3"].lens.size[0]
    assert finding.values["moved_px"] == pytest.approx(abs(share) * width, rel=0.15)


_OFF = {share: partial(off_centre, share=share) for share in (0.08, -0.05)}


def zoomed_in(lens: Lens) -> Lens:
    return LensUnknowns(("focal",)).moved(lens, np.array([0.15]))


@pytest.mark.slow
def test_two_wrong_lenses_are_both_named() -> None:
    named = accused(with_lens("basketball", "C1", zoomed_in, "C4"))
    assert sorted(named) == [("focal_contradicted", ("C1",)), ("focal_contradicted", ("C4",))]


def unbent(lens: Lens) -> Lens:
    return replace(lens, distortions=lens.distortions + np.array([0.15, *np.zeros(len(lens.distortions) - 1)]))


@pytest.mark.slow
def test_a_wrong_distortion_is_named() -> None:
    solution = with_lens("basketball", "C2", unbent)
    assert accused(solution) == [("lens_part_contradicted", ("C2",))]
    assert "distortion" in accusations(solution)[0]


@pytest.mark.slow
@thinned("preset", ["basketball", "terrace"])
def test_a_mirrored_camera_is_not_accused_of_its_lens_nor_are_the_others(preset: str) -> None:
    """What of it agrees by chance fits another focal length better: it has to agree with that one."""
    truth = simulated(preset)
    boxes, width = truth.observations["C2"].boxes, truth.rig["C2"].lens.size[0]
    ltwh = boxes.ltwh.copy()
    ltwh[:, 0] = width - ltwh[:, 0] - ltwh[:, 2]
    seen = dict(part(truth.observations).cameras)
    seen["C2"] = replace(seen["C2"], boxes=replace(boxes, ltwh=ltwh))
    solution = solve(truth.rig, Observations(seen, truth.observations.fps), options=SOLVING)
    assert accused(solution) == []
    assert solution.verdict == "doubtful"


def test_few_people_say_nothing() -> None:
    """A focal length a fifth too long, and fewer people than the check needs to see in a camera."""
    truth = simulated("basketball")
    seen = part(truth.observations)
    few = {
        name: replace(own, boxes=own.boxes.take(own.boxes.identity <= 2).take(slice(0, MIN_INSTANTS - 1)))
        for name, own in seen.cameras.items()
    }
    rig = without_poses(LensUnknowns(("focal",)).rig(truth.rig, np.log([[1.0], [1.2], [1.0], [1.0]])))
    assert accused(solve(rig, Observations(few, seen.fps), options=SOLVING)) == []


def scored(preset: str, camera: int, factor: float) -> tuple[Rig, list[LensScore]]:
    """The scores at the optimum of a rig with one focal length stated wrongly."""
    truth = simulated(preset)
    logs = np.zeros((len(truth.rig), 1))
    logs[camera] = np.log(factor)
    rig = without_poses(LensUnknowns(("focal",)).rig(truth.rig, logs))
    rng = np.random.default_rng(0)
    start = Initialisation.prepare(rig, part(truth.observations), ScaleCues(), SOLVING, rng)
    fit = refine_in_stages(start, select_initial_rig(start, SOLVING, rng).state, SOLVING, rng)
    problem, state = fit.model.problem, fit.result.state
    inflation = design_effect(fit.model, start.evidence, problem.terms(state, jacobians=False))
    return rig, score_lenses(rig, problem, state, inflation)


def test_the_score_of_the_right_hypothesis_is_the_largest_and_its_step_leads_there() -> None:
    rig, scores = scored("basketball", 2, 1.1)
    assert [score.gain for score in scores] == sorted((score.gain for score in scores), reverse=True)
    best = scores[0]
    assert best.hypothesis == LensHypothesis("focal", (2,))
    assert best.gain > LEAST_GAIN
    assert best.change[0] == pytest.approx(-np.log(1.1), rel=0.25)
    kinds = {(score.hypothesis.part, len(score.hypothesis.cameras)) for score in scores}
    alone = {("focal", 1), ("principal_point", 1), ("distortion", 1)}
    assert kinds == alone | {("focal", len(rig)), ("distortion", len(rig))}


def test_the_score_of_right_lenses_is_small() -> None:
    _, scores = scored("basketball", 2, 1.0)
    assert scores[0].gain < LEAST_GAIN


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_what_nobody_tells_of_a_lens_has_no_finite_sigma(rank):
    """Where a principal point is known in one direction only, neither is: an inverse of the rest would call it sure."""
    H = np.zeros((4, 4))
    H[:rank, :rank] = np.diag([4.0, 9.0])[:rank, :rank]
    score = _FreeLenses(H, np.ones(4)).along(LensHypothesis("principal_point", (0,)), np.eye(4)[:, :2])
    assert np.isfinite(score.change).all()
    assert score.sd == pytest.approx((1 / 2, 1 / 3) if rank == 2 else (np.inf, np.inf))


def test_a_size_that_no_lens_explains_is_told_where_it_is_far_and_sure():
    checks = [
        FocalCheck("far", -1.07, 0.21),
        FocalCheck("unsure", -1.07, 1.07 / (FAR_SIGMAS - 0.1)),
        FocalCheck("near", FAR_CHANGE - 0.01, 0.01),
        FocalCheck("hardly told", -9.0, FAR_CHANGE + 0.01),
    ]
    (found,) = sizes_contradicted(checks)
    assert (found.code, found.severity, found.cameras) == ("size_contradicted", "doubt", ("far",))
    assert found.values["change"] == pytest.approx(np.exp(-1.07) - 1)


def test_steps_that_are_the_same_in_all_cameras_say_nothing_of_where_one_stands() -> None:
    """Cameras side by side on a wall trade all focal lengths for all distances."""
    assert sizes_contradicted([FocalCheck(name, -2.3, 0.19) for name in "ABCD"]) == []
    for steps in ((2.3, -2.3), (-2.3, -1.6, -2.3), (-2.3, -0.1, -0.1), (-2.3,)):
        found = sizes_contradicted([FocalCheck(name, step, 0.19) for name, step in zip("ABC", steps, strict=False)])
        assert [one.cameras[0] for one in found] == [name for name, step in zip("ABC", steps, strict=False) if step != -0.1]


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
    """Aimed at one point they would fit all focal lengths 25 % shorter, but then no principal point any more."""
    rig, observations = on_a_wall(spacing_m, seed, converging=converging)
    solution = solve(rig, observations, options=SOLVING)
    assert [one.code for one in solution.findings] == []
    found, true = (np.array([camera.centre for camera in one]) for one in (solution.rig, rig))
    across, wanted = (np.linalg.norm(np.diff(centres, axis=0), axis=1) for centres in (found, true))
    np.testing.assert_allclose(across / across.mean(), wanted / wanted.mean(), atol=0.05)
