"""The Cramer-Rao bound of small scenes, and errors against it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Pose, Rig
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import exp_rotation
from passerby.simulation import SimulationOptions, simulate
from reliability import bound
from reliability import cramer_rao as rao

NOISE, HEIGHT_SD = 0.02, 0.09


@pytest.fixture(scope="module")
def tiny() -> Any:
    """Three cameras, two people and eight time steps, with the simulator's lenses."""
    scene = simulate(SimulationOptions(cameras=3, people=2, seconds=8.0, fps=1.0, seed=5, box_noise=NOISE))
    return bound.upright_scene(scene, {name: seen.boxes for name, seen in scene.observations.cameras.items()})


@pytest.mark.unit
def test_the_bound_shrinks_with_the_square_root_of_the_seconds(tiny: Any) -> None:
    times, count = 4, len(tiny.places)
    longer = replace(
        tiny, places=np.tile(tiny.places, (times, 1)), person=np.tile(tiny.person, times), camera=np.tile(tiny.camera, times),
        instant=np.concatenate([tiny.instant + repeat * count for repeat in range(times)]),
    )  # fmt: skip
    short, long = (rao.cramer_rao(scene, NOISE, HEIGHT_SD) for scene in (tiny, longer))
    # What is known of heights beforehand does not grow with the seconds.
    assert long.position_mm == pytest.approx(short.position_mm / np.sqrt(times), rel=0.03)
    assert long.orientation_deg == pytest.approx(short.orientation_deg / np.sqrt(times), rel=0.03)


@pytest.mark.unit
def test_the_bound_does_not_depend_on_how_the_world_lies(tiny: Any) -> None:
    turn, shift = exp_rotation(np.array([0.0, 0.0, 2.1])), np.array([30.0, -12.0, 0.0])
    other = replace(tiny, rig=tiny.rig.moved(turn, shift), places=tiny.places @ turn[:2, :2].T + shift[:2])
    here, there = (rao.cramer_rao(scene, NOISE, HEIGHT_SD) for scene in (tiny, other))
    assert there.position_mm == pytest.approx(here.position_mm, rel=1e-5)
    assert there.orientation_deg == pytest.approx(here.orientation_deg, rel=1e-5)


def rig_at(tiny: Any, step: Floats) -> Rig:
    """The tiny scene's rig after a step of its poses, the first unknowns."""
    cameras = []
    for camera, by in zip(tiny.rig, step[: 6 * len(tiny.rig)].reshape(-1, 6), strict=True):
        pose = Pose.from_centre(exp_rotation(by[:3]) @ camera.pose.R_cw, camera.centre + by[3:])
        cameras.append(Camera(camera.name, camera.lens, pose))
    return Rig(tuple(cameras))


def boxes_at(tiny: Any, step: Floats) -> Floats:
    """(M, 3) middles, tops and bottoms, sighting by sighting, after a step of poses, places and heights."""
    rig, heights = rig_at(tiny, step), tiny.heights + step[-2:]
    places = tiny.places + step[6 * len(tiny.rig) : -2].reshape(-1, 2)
    out = []
    for index, instant in zip(tiny.camera, tiny.instant, strict=True):
        camera, place, height = rig.cameras[index], places[instant], heights[tiny.person[instant]]
        near = camera.centre[:2] - place
        foot = place + 0.08 * height * near / np.linalg.norm(near)
        top, bottom = camera.project(np.array([[*place, 0.99 * height], [*foot, 0.0]]))
        out.append([(top[0] + bottom[0]) / 2, top[1], bottom[1]])
    return np.array(out)


@pytest.fixture(scope="module")
def information(tiny: Any) -> Floats:
    """Of all unknowns at once, by numerical derivatives of the cameras' projections."""
    size = 6 * len(tiny.rig) + tiny.places.size + len(tiny.heights)
    at = boxes_at(tiny, np.zeros(size))
    sigma = NOISE * (at[:, 2] - at[:, 1])[:, None] * [np.sqrt(0.5), 1.0, 1.0]
    difference = [boxes_at(tiny, step) - boxes_at(tiny, -step) for step in 1e-4 * np.eye(size)]
    J = np.column_stack([(one / 2e-4 / sigma).ravel() for one in difference])
    whole = J.T @ J
    whole[[-2, -1], [-2, -1]] += 1 / HEIGHT_SD**2
    return np.asarray(whole)


@pytest.mark.unit
def test_the_information_is_that_of_numerical_derivatives(tiny: Any, information: Floats) -> None:
    n_poses, n_places = 6 * len(tiny.rig), tiny.places.size
    places = np.arange(n_poses, n_poses + n_places)
    shared = np.setdiff1d(np.arange(len(information)), places)
    across = information[np.ix_(shared, places)]
    reduced = information[np.ix_(shared, shared)] - across @ np.linalg.solve(information[np.ix_(places, places)], across.T)
    found = rao.shared_information(tiny, NOISE, HEIGHT_SD)
    unit = np.sqrt(np.diag(reduced))
    assert found / np.outer(unit, unit) == pytest.approx(reduced / np.outer(unit, unit), abs=1e-5)


@pytest.mark.slow
def test_the_bound_is_of_errors_as_they_are_measured(tiny: Any, information: Floats) -> None:
    values, vectors = np.linalg.eigh(information)
    # A turn about the vertical and two shifts along the ground are free, and nothing else.
    assert values[2] < 1e-6 * values[3]
    drawn = np.random.default_rng(1).standard_normal((2000, len(values) - 3)) / np.sqrt(values[3:])
    small = 1e-3  # enough for the alignment to be linear
    found = [compare(rig_at(tiny, small * (vectors[:, 3:] @ one)), tiny.rig).similarity for one in drawn]
    expected = rao.cramer_rao(tiny, NOISE, HEIGHT_SD)
    position = np.array([[*one.position_mm.values()] for one in found])
    orientation = np.array([[*one.orientation_deg.values()] for one in found])
    assert np.sqrt(np.mean(position**2, axis=0)) / small == pytest.approx(expected.position_mm, rel=0.05)
    assert np.sqrt(np.mean(orientation**2, axis=0)) / small == pytest.approx(expected.orientation_deg, rel=0.05)


@pytest.mark.unit
def test_cameras_that_see_nobody_in_common_have_no_bound(tiny: Any) -> None:
    alone = tiny.camera != 2
    assert rao.cramer_rao(replace(tiny, camera=tiny.camera[alone], instant=tiny.instant[alone]), NOISE, HEIGHT_SD) is None


@pytest.mark.slow
def test_upright_people_come_near_the_bound_and_simulated_ones_do_not() -> None:
    results = [bound.work(("terrace", 8, seed)) for seed in (30, 31, 32)]
    assert len(bound.complete(results)) == 3
    for kind in bound.KINDS:
        assert 0.7 < bound.ratio(results, bound.UPRIGHT, kind) < 1.7
    assert bound.ratio(results, bound.SIMULATED, "position") > bound.ratio(results, bound.UPRIGHT, "position")
    lines = bound._lines(results)
    assert [line.what for line in lines] == [f"errors over the Cramer-Rao bound: terrace, {kind}" for kind in bound.KINDS]
    tables, notes = bound.tabulate(results)
    assert tables["By number of people"].rows[0][:2] == ["terrace", "8"]
    assert "nan" not in f"{tables} {notes}"


@pytest.mark.unit
def test_a_scene_without_a_bound_or_a_camera_is_counted_and_left_out() -> None:
    figures = {"position": [2.0, 4.0], "orientation": [0.1, 0.2]}
    errors = {name: figures | {"verdict": "accepted", "opposite": 1.0} for name in bound.VARIANTS}
    bounds = {name: {"position": [1.0, 2.0], "orientation": [0.1, 0.1], "share": 0.2} for name in bound.VARIANTS[:2]}
    whole = {"preset": "terrace", "people": 2, "seed": 1, "bounds": bounds, "errors": errors}
    unbounded = whole | {"bounds": bounds | {bound.UPRIGHT: None}}
    unposed = whole | {"errors": errors | {bound.NOISELESS: {"verdict": "refused"}}}
    results = [whole, unbounded, unposed]
    assert bound.complete(results) == [whole]
    assert bound.ratio([whole], bound.SIMULATED, "position") == pytest.approx(2.0)
    assert bound.ratio([whole], bound.SIMULATED, "orientation") == pytest.approx(np.sqrt(2.5))
    assert [line.reached for line in bound._lines(results)] == [False, False]
    assert "has 1 of 3 scenes" in bound.tabulate(results)[1][0]
