"""A floor plan sets scale, origin and heading; wrong placements are named; contradictions let no rig be accepted."""

from dataclasses import replace
from functools import cache
from itertools import product

import cv2
import numpy as np
import pytest

from passerby.calibration.alignment.plan import align_to_plan
from passerby.calibration.calibration import Calibration
from passerby.calibration.in_memory import calibrate_observations
from passerby.cli.main import run
from passerby.common.errors import EvidenceError, InputError
from passerby.core.figures import adjusted
from passerby.core.scale_cues import FloorPlan, PlannedCamera, PlannedPoint
from passerby.evaluation.metrics import compare
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from support.tiers import thinned

UNIT, SIDE = 0.02, 1000
SPOTS = np.array([[-2.5, -4.0, 0.0], [2.5, 4.0, 0.0], [2.5, -4.0, 0.0], [-2.5, 3.5, 0.0]])


@cache
def scene() -> SimulatedScene:
    return simulate(SimulationOptions(preset="terrace", seed=1, seconds=10.0, box_noise=0.02))


def on_plan(xy: np.ndarray) -> tuple[float, float]:
    """The plan's pixel of a place of the true world, whose origin is amid it."""
    return float(xy[0] / UNIT + SIDE / 2), float(SIDE / 2 - xy[1] / UNIT)


def clicks(count: int, noise_px: float = 2.0, seed: int = 0) -> list[dict[str, object]]:
    """`[[world.plan.points]]` of the first spots."""
    rng = np.random.default_rng(seed)
    points = []
    for spot in SPOTS[:count]:
        pixels = {}
        for camera in scene().rig:
            pixel = camera.project(spot[None])[0] + rng.normal(0, noise_px, 2)
            if np.isfinite(pixel).all() and (pixel > 0).all() and (pixel < camera.lens.size).all():
                pixels[camera.name] = pixel.tolist()
        at = np.array(on_plan(spot)) + rng.normal(0, noise_px, 2)
        points.append({"at": at.tolist(), "pixels": pixels})
    return points


def stands(*names: str, noise_px: float = 2.0) -> dict[str, list[float]]:
    rng = np.random.default_rng(5)
    return {name: (np.array(on_plan(scene().rig[name].centre)) + rng.normal(0, noise_px, 2)).tolist() for name in names}


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.png"
    cv2.imwrite(str(path), np.full((SIDE, SIDE, 3), 220, np.uint8))
    return path


def calibrated(image, **plan: object) -> Calibration:
    seen = {name: scene().observations[name].boxes for name in scene().rig.names}
    unit = {} if "distance" in plan else {"metres_per_pixel": UNIT}
    plan = {"image": str(image), **unit, "origin": [SIDE / 2, SIDE / 2], **plan}
    return calibrate_observations(scene().rig, seen, fps=5.0, association={"mode": "given"}, world={"plan": plan})


def off_m(found: Calibration) -> float:
    """The largest distance of a camera on the ground from where it stands in the true world."""
    return max(float(np.hypot(*(camera.centre - scene().rig[camera.name].centre)[:2])) for camera in found.rig)


@pytest.fixture(scope="module")
def by_points(image) -> Calibration:
    return calibrated(image, points=clicks(2))


def test_two_points_set_scale_origin_and_heading(by_points) -> None:
    assert compare(by_points.rig, scene().rig).scale_ratio == pytest.approx(1, abs=0.012)
    assert off_m(by_points) < 0.15
    assert by_points.verdict == "accepted"
    (cue,) = [cue for cue in adjusted(by_points.figures).scale.cues if cue.kind == "plan"]
    assert cue.share > 0.9
    assert adjusted(by_points.figures).scale.relative_sigma < 0.015
    assert by_points.world["by"] == "plan plan.png"
    assert by_points.world["turn_sigma_deg"] < 1
    assert all(row["off_m"] < 0.5 for row in by_points.world["residuals"])


@pytest.mark.slow
def test_a_plan_that_is_a_tenth_too_large_makes_the_world_so(image) -> None:
    """So that it is the plan that sets the scale: its cameras are placed as if it were right, 22 mm for 20."""
    found = calibrated(image, cameras=stands(*scene().rig.names), metres_per_pixel=1.1 * UNIT)
    assert compare(found.rig, scene().rig).scale_ratio == pytest.approx(1.1, rel=0.008)


@pytest.mark.slow
def test_a_distance_on_the_plan_is_as_good_as_metres_per_pixel(image) -> None:
    ends = [[100.0, 100.0], [900.0, 850.0]]
    metres = UNIT * float(np.hypot(800, 750))
    found = calibrated(image, cameras=stands("C1", "C3"), distance={"between": ends, "metres": metres})
    assert compare(found.rig, scene().rig).scale_ratio == pytest.approx(1, abs=0.01)
    assert off_m(found) < 0.15


@pytest.mark.slow
def test_a_wrong_point_and_a_wrong_click_in_one_image_are_named(image) -> None:
    points = clicks(4)
    points[2]["at"] = [points[2]["at"][0] + 60.0, points[2]["at"][1]]
    found = calibrated(image, points=points)
    (told,) = [one for one in found.diagnostics if one.code.startswith("point_off")]
    assert told.values["point"] == "3"
    assert told.values["off_m"] == pytest.approx(60 * UNIT, rel=0.3)
    assert compare(found.rig, scene().rig).scale_ratio == pytest.approx(1, abs=0.012)
    assert found.verdict == "accepted"
    points = clicks(2)
    wrong = sorted(points[0]["pixels"])[0]
    u, v = points[0]["pixels"][wrong]
    points[0]["pixels"][wrong] = [u + 60.0, v]
    found = calibrated(image, points=points, cameras=stands("C1", "C3"))
    (told,) = [one for one in found.diagnostics if one.code == "point_off"]
    assert (told.values["point"], told.cameras) == ("1", (wrong,))


@pytest.mark.slow
def test_placements_that_contradict_each_other_let_no_rig_be_accepted(image) -> None:
    """Three cameras, one of them on its spot of the mirrored plan: which is wrong cannot be told."""
    wrong = stands("C1", "C2", "C3")
    wrong["C2"] = [wrong["C2"][0] - 15.0, wrong["C2"][1] + 20.0]
    found = calibrated(image, cameras=wrong)
    (told,) = [one for one in found.doubts if one.code == "plan_contradicts_itself"]
    assert set(told.values["on_plan"]) == {"C1", "C2", "C3"}
    assert found.verdict == "doubtful"


@pytest.mark.slow
@thinned(("times", "by"), product((0.3, 25.4, 1e-3, 1e3), ("points", "cameras")), quick=2)
def test_a_plan_in_a_wrong_unit_is_reported_and_does_not_touch_the_rig(image, times, by) -> None:
    placed = {"points": clicks(4)} if by == "points" else {"cameras": stands(*scene().rig.names)}
    found = calibrated(image, metres_per_pixel=times * UNIT, **placed)
    (told,) = found.doubts
    assert told.code == "plan_unit_wrong"
    assert told.values["metres_per_pixel"] == times * UNIT
    assert told.values["by_people"] == pytest.approx(UNIT, rel=0.1)
    assert found.verdict == "doubtful"
    assert compare(found.rig, scene().rig).scale_ratio == pytest.approx(1, abs=0.1)
    assert not found.world


@pytest.mark.slow
def test_a_mirrored_plan_is_reported_as_such(image) -> None:
    mirrored = {name: [SIDE - at[0], at[1]] for name, at in stands(*scene().rig.names).items()}
    found = calibrated(image, cameras=mirrored)
    assert [one.code for one in found.doubts] == ["plan_mirrored"]
    with pytest.raises(EvidenceError, match=r"the plan is mirrored: .* fit its mirror image only"):
        align_to_plan(scene().rig, replace(plan_of(), cameras=tuple(
            PlannedCamera(name, tuple(at), 0.04) for name, at in mirrored.items()
        )), image)  # fmt: skip


@pytest.mark.slow
@thinned("order", [("C2", "C1", "C3", "C4"), ("C2", "C3", "C4", "C1"), ("C3", "C4", "C2", "C1")])
def test_exchanged_cameras_let_no_rig_be_accepted(image, order) -> None:
    """Any two of the four fit by themselves: which are right cannot be told."""
    at = stands(*scene().rig.names)
    found = calibrated(image, cameras=dict(zip(at, (at[name] for name in order), strict=True)))
    (told,) = [one for one in found.doubts if one.code == "plan_contradicts_itself"]
    assert told.values["on_plan"] == ["C1", "C2", "C3", "C4"]
    assert found.verdict == "doubtful"


def plan_of(points: int = 0, cameras: tuple[str, ...] = (), unit: float = UNIT) -> FloorPlan:
    return FloorPlan(
        "plan.png", unit, 0.002, tuple(PlannedCamera(name, tuple(at), 0.04) for name, at in stands(*cameras).items()),
        tuple(PlannedPoint(str(n), tuple(one["at"]), one["pixels"], 0.04) for n, one in enumerate(clicks(points), start=1)),
        (SIDE / 2, SIDE / 2),
    )  # fmt: skip


def test_a_finished_rig_keeps_its_lengths_unless_the_plan_is_to_set_them(image) -> None:
    small = scene().rig.moved(np.eye(3), np.array([3.0, 1.0, 0.0]), 0.9)
    kept = align_to_plan(small, plan_of(cameras=small.names), image)
    assert kept.motion.scale == 1.0
    (told,) = [one for one in kept.diagnostics if one.code == "places_want_scale"]
    assert told.values["percent"] == pytest.approx(100 / 0.9 - 100, abs=1)
    scaled = align_to_plan(small, plan_of(cameras=small.names), image, with_scale=True)
    assert scaled.motion.scale == pytest.approx(1 / 0.9, rel=0.006)
    assert max(np.hypot(*(one.centre - scene().rig[one.name].centre)[:2]) for one in scaled.rig) < 0.1


def test_placements_that_cannot_be_used_are_left_out_and_named(image) -> None:
    """Points above the horizon, cameras without a pose, and one camera that is placed wrongly, but no other."""
    plan = plan_of(points=3)
    sky = replace(plan.points[0], pixels={**plan.points[0].pixels, "C1": (360.0, 5.0)})
    aligned = align_to_plan(scene().rig, replace(plan, points=(sky, *plan.points[1:])), image)
    assert ("point_above_horizon", ("C1",)) in [(one.code, one.cameras) for one in aligned.diagnostics]
    assert [row["used"] for row in aligned.residuals if row["camera"] == "C1" and row["point"] == "1"] == [False]
    lost = replace(scene().rig, cameras=tuple(replace(one, pose=None) if one.name == "C2" else one for one in scene().rig))
    aligned = align_to_plan(lost, plan_of(cameras=("C1", "C2", "C3")), image)
    assert [one.cameras for one in aligned.diagnostics if one.code == "position_without_pose"] == [("C2",)]
    with pytest.raises(EvidenceError, match="fewer than two cameras or points"):
        align_to_plan(lost, plan_of(cameras=("C1", "C2")), image)
    with pytest.raises(InputError, match="C9"):
        align_to_plan(lost, replace(plan_of(), cameras=(PlannedCamera("C9", (1.0, 1.0), 0.1),)), image)
    sound = plan_of(points=2, cameras=scene().rig.names)
    assert align_to_plan(scene().rig, sound, image).diagnostics == ()
    off = [replace(one, at=(one.at[0] + 90.0, one.at[1])) if one.camera == "C3" else one for one in sound.cameras]
    aligned = align_to_plan(scene().rig, replace(sound, cameras=tuple(off)), image)
    (told,) = aligned.diagnostics
    assert (told.code, told.cameras) == ("position_off", ("C3",))
    assert told.values["off_m"] == pytest.approx(90 * UNIT, rel=0.1)
    assert [row["camera"] for row in aligned.residuals if not row["used"]] == ["C3"]


def test_align_takes_a_plan_in_a_file_of_its_own(by_points, image, tmp_path, capsys) -> None:
    by_points.write(tmp_path / "out")
    at = stands("C1", "C2", "C3", "C4")
    text = (
        f"image = '{image}'\nmetres_per_pixel = {UNIT}\ncameras = {{ " + ", ".join(f"{k} = {v}" for k, v in at.items()) + " }"
    )
    (tmp_path / "plan.toml").write_text(text)
    plan = ["--plan", str(tmp_path / "plan.toml")]
    assert run(["align", str(tmp_path / "out"), "-o", str(tmp_path / "new"), *plan]) == 0
    assert "aligned by plan plan.png" in capsys.readouterr().out
    assert '"metres_per_pixel"' in (tmp_path / "new" / "calibration.json").read_text()
    assert run(["align", str(tmp_path / "out"), "-o", str(tmp_path / "rig.toml"), *plan, "--tilt"]) == 2
    assert "a plan knows no heights" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["terrace", "basketball"])
def test_two_cameras_on_a_plan_give_the_scale_to_the_goal(preset, image) -> None:
    """Median of ten seeds within 0.6 %, clicks of 2 px on a plan of 1000 px."""
    errors = []
    for seed in range(10):
        truth = simulate(SimulationOptions(preset=preset, seed=seed, seconds=20.0, box_noise=0.02))
        rng = np.random.default_rng(seed)
        centre = np.array([camera.centre[:2] for camera in truth.rig])
        unit = float(np.ptp(centre, axis=0).max()) / (SIDE - 100)
        at = {
            name: (50 + (centre[c] - centre.min(axis=0)) * (1, -1) / unit + (0, SIDE - 100) + rng.normal(0, 2, 2)).tolist()
            for c, name in enumerate(truth.rig.names) if name in ("C1", "C3")
        }  # fmt: skip
        seen = {name: truth.observations[name].boxes for name in truth.rig.names}
        plan = {"image": str(image), "metres_per_pixel": unit, "cameras": at}
        found = calibrate_observations(truth.rig, seen, fps=5.0, association={"mode": "given"}, world={"plan": plan})
        errors.append(abs(compare(found.rig, truth.rig).scale_ratio - 1))
    assert float(np.median(errors)) < 0.006
