"""How far off a rig measures: zero for the truth, small where errors compensate; the doubt where it is too vague."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import AdjustedFigures, AdjustmentRound, SolvedCamera
from passerby.core.measuring import CameraMeasuring, MeasuringFigures, MeasuringSigma, find_common_ground, measuring_errors
from passerby.core.observations import Boxes
from passerby.core.usability import add_uncertainty_doubts, doubts_of_uncertainty
from passerby.evaluation.metrics import compare
from passerby.findings.finding import Finding, notice
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
    first, second = made.rig.names[:2]
    degrees, pixels = 3.0, made.rig[first].lens.focal * np.tan(np.radians(3.0))
    both = changed(made.rig, first, degrees, -pixels)
    turned, shifted, together = (
        measuring_errors(rig, made.rig).points.median_mm
        for rig in (changed(made.rig, first, degrees), changed(made.rig, first, point_px=-pixels), both)
    )
    assert compare(both, made.rig).metric.orientation_deg[first] == pytest.approx(0.0, abs=1e-6)  # it is the reference
    assert 0.1 < together < 0.2 * min(turned, shifted)
    # A camera at another place errs on its ground.
    found = measuring_errors(changed(made.rig, second, shift_m=0.3), made.rig)
    assert max(found.cameras, key=lambda camera: found.cameras[camera].median_mm) == second
    assert 100 < found.cameras[second].median_mm < 500


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


LENS = Lens((800, 600), np.array([[700.0, 0, 400], [0, 700, 300], [0, 0, 1]]), np.zeros(0))
CENTRES = np.array([[0.0, 0, 3], [8.0, 0, 3], [0.0, 8, 3]])


def rig_of_three(factor: float = 1.0) -> Rig:
    cameras = (Pose.from_centre(np.eye(3), factor * centre) for centre in CENTRES)
    return Rig(tuple(Camera(f"C{k}", LENS, pose) for k, pose in enumerate(cameras, start=1)))


def measuring(*across_m: float, ground_m: float | None = None) -> MeasuringFigures:
    """Cameras whose rays pass places so far beside them, metres, one sigma."""
    sigmas = [MeasuringSigma(median_mm=1000 * one, p90_mm=2000 * one) for one in across_m]
    ground = None if ground_m is None else MeasuringSigma(median_mm=1000 * ground_m, p90_mm=2000 * ground_m)
    cameras = {f"C{k}": CameraMeasuring(points=one, across=one, ground=ground) for k, one in enumerate(sigmas, start=1)}
    return MeasuringFigures(places=10, points=sigmas[0], ground=ground, ground_height_mm=None, cameras=cameras)


def figures(own: MeasuringFigures | None = None, **others: object) -> AdjustedFigures:
    cameras = tuple(SolvedCamera(name=f"C{k}", shape_position_sigma_mm=10.0) for k in (1, 2, 3))
    return replace(AdjustedFigures(cameras=cameras, measuring=own), **others)  # type: ignore[arg-type]


SOUND = figures(measuring(0.01, 0.01, 0.01, ground_m=0.1))


def test_a_camera_that_measures_points_too_vaguely() -> None:
    (doubt,) = doubts_of_uncertainty(rig_of_three(), figures(measuring(0.01, 1.0, 0.01)), [])
    assert (doubt.cameras, doubt.values["what"], doubt.values["sigma"]) == (("C2",), "points", pytest.approx(1000.0))
    # One that sees no shared place counts by its position.
    cameras = tuple(SolvedCamera(name=f"C{k}", shape_position_sigma_mm=10.0 if k < 3 else 900.0) for k in (1, 2, 3))
    (doubt,) = doubts_of_uncertainty(rig_of_three(), figures(None, cameras=cameras), [])
    assert (doubt.cameras, doubt.values["sigma"]) == (("C3",), 900.0)
    nowhere = Rig(tuple(replace(camera, pose=None) for camera in rig_of_three()))
    assert doubts_of_uncertainty(nowhere, figures(), []) == []


@pytest.mark.parametrize(("factor", "sigma_m", "vague"), [(0.1, 0.15, True), (1, 0.15, False), (1, 0.6, True), (40, 0.6, 0)])
def test_how_well_points_have_to_be_known_goes_by_the_size_of_the_rig(factor: float, sigma_m: float, vague: bool) -> None:
    """A share of the extent in small and in large rigs, and metres between them."""
    found = doubts_of_uncertainty(rig_of_three(factor), figures(measuring(*3 * [sigma_m])), [])
    assert [one.values["what"] for one in found] == vague * 3 * ["points"]


@pytest.mark.parametrize(("reach", "sound_m", "vague_m"), [(None, 0.07, 0.2), (0.5, 0.07, 0.2), (8.0, 0.5, 1.6)])
def test_the_height_of_the_ground_counts_not_how_flat_a_camera_looks(reach: float | None, sound_m: float, vague_m: float):
    for ground_m, count in ((sound_m, 0), (vague_m, 3)):
        own = measuring(0.01, 0.01, 0.01, ground_m=ground_m)
        own = replace(own, cameras={name: replace(one, reach=reach) for name, one in own.cameras.items()})
        found = doubts_of_uncertainty(rig_of_three(), figures(own), [])
        assert [one.values["what"] for one in found] == count * ["ground"]
        assert all(one.values["sigma"] == pytest.approx(1000 * ground_m) for one in found)
    for sigma, whats in ((0.05, []), (0.4, ["scale"])):
        scaled = replace(SOUND, scale=replace(SOUND.scale, relative_sigma=sigma))
        assert [one.values["what"] for one in doubts_of_uncertainty(rig_of_three(), scaled, [])] == whats


def test_a_quantity_that_nothing_fixes_has_no_sigma() -> None:
    free = replace(SOUND, undetermined=("scale", "vertical", "camera C2"))
    found = doubts_of_uncertainty(rig_of_three(), free, [])
    assert [(one.values["what"], one.values["sigma"], one.values["lacks"], one.cameras) for one in found] == [
        ("world", None, ["scale", "vertical"], ()), ("points", None, [], ("C2",)),
    ]  # fmt: skip
    for lacks, what in (("scale", "scale"), ("vertical", "ground"), ("height of the ground", "ground")):
        (doubt,) = doubts_of_uncertainty(rig_of_three(), replace(SOUND, undetermined=(lacks,)), [])
        assert (doubt.values["what"], doubt.values["lacks"]) == (what, [lacks])


@pytest.mark.parametrize(
    "why",
    [notice("people_not_spread", shape="line", length_m=14.2), notice("boxes_noisy", noise_percent=40.0),
     notice("adjustment_not_converged")],
)  # fmt: skip
def test_beside_these_the_sigmas_say_too_little(why: Finding) -> None:
    early = AdjustmentRound(sightings=9, renamed=0, joints=0, iterations=200, converged=False, cost=None)
    rounds = (early,) if why.code == "adjustment_not_converged" else ()
    (doubt,) = doubts_of_uncertainty(rig_of_three(), replace(SOUND, rounds=rounds), [why])
    assert (doubt.cameras, doubt.values["what"], doubt.values["sigma"]) == ((), "points", None)
    assert doubt.values["why"]["code"] == why.code
    # A sound rig is sound beside a notice that explains nothing.
    assert doubts_of_uncertainty(rig_of_three(), SOUND, [notice("few_observations", "C1", agreeing=12)]) == []


def test_a_doubt_says_why_and_the_notice_is_not_said_twice() -> None:
    uneven, few = notice("ground_uneven", rise_m=0.4, at=None), notice("few_observations", "C2", agreeing=12)
    vague = figures(measuring(0.01, 1.0, 0.01))
    found = add_uncertainty_doubts(rig_of_three(), vague, [uneven, few])
    assert [one.code for one in found] == ["ground_uneven", "rig_uncertain"]
    assert found[-1].values["why"]["code"] == "few_observations"
    # A notice of another camera explains nothing of this one.
    found = add_uncertainty_doubts(rig_of_three(), vague, [notice("few_observations", "C1", agreeing=12)])
    assert found[-1].values["why"] is None
    # Said again with other figures, it is not said twice.
    assert add_uncertainty_doubts(rig_of_three(), vague, found) == found
