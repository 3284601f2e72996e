"""Lenses that contradict the people, and right ones that must not be accused where joints err or evidence is thin."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.core.solution import Solution
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.solver.lens_check import COMMON, FARTHEST, KNOWN_FOCAL, MIN_INSTANTS, FocalCheck, common_change
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people import PeopleOptions
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
def test_steps_of_focal_lengths_lead_to_the_true_ones(factors: tuple[float, ...]) -> None:
    """Columns at the observed points would add the noise's own square: +0.01 to +0.05 here, and +1 where people tell little."""
    solution, _ = stated("basketball", factors)
    for camera, factor in zip(solution.figures.cameras, factors, strict=True):
        assert camera.focal_change == pytest.approx(-np.log(factor), abs=max(0.02, 0.25 * abs(np.log(factor))))
        assert abs(camera.focal_change + np.log(factor)) < 3 * camera.focal_change_sigma


@pytest.mark.parametrize(
    ("factors", "told"),
    [((1.0, 1.1, 1.0, 1.0), "camera C2: people fit a focal length"), ((1.085,) * 4, "shorter than stated in all cameras")],
)
def test_focal_lengths_a_little_wrong_are_told_where_people_tell(factors: tuple[float, ...], told: str) -> None:
    (reason,) = accusations(stated("basketball", factors)[0])
    assert told in reason


def checks(*changes: float, sigma: float = 0.02) -> list[FocalCheck]:
    beyond = np.array(changes) - np.median(changes)
    return [FocalCheck(f"C{c}", change, sigma, beyond[c]) for c, change in enumerate(changes)]


def test_few_people_say_nothing() -> None:
    few = [replace(check, instants=MIN_INSTANTS - 1) for check in (*checks(0.0, 0.3, 0.0), *checks(-0.13, -0.14, -0.12))]
    assert not any(check.wrong for check in few)
    assert common_change(few[3:]) is None


def test_thin_evidence_and_far_steps_say_nothing() -> None:
    assert checks(0.0, 0.3, 0.0)[1].wrong
    assert not checks(0.0, 0.3, 0.0, sigma=KNOWN_FOCAL)[1].wrong
    assert not checks(0.0, 1.05 * FARTHEST, 0.0)[1].wrong
    assert common_change(checks(-0.13, -0.14, -0.12)) == pytest.approx(-0.13)
    assert common_change(checks(-0.13, -0.14, 0.01)) is None
    assert common_change(checks(-2.0, -2.1, -1.9)) is None
    least, sigmas = COMMON[1]
    assert common_change(checks(*[1.1 * least] * 3)) is not None
    assert common_change(checks(*[1.1 * least] * 3, sigma=1.2 * least / sigmas)) is None
