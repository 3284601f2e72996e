"""What cameras observed, read otherwise or in another box format: found where that is right, and not where it is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.core.quarter_turns import turn_seen
from passerby.core.solution import Solution
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.findings.texts import text_of
from passerby.hypotheses.box_formats import find_shifted_boxes
from passerby.hypotheses.findings import boxes_in_other_format
from passerby.hypotheses.observations import examine_readings
from passerby.hypotheses.readings import mirrored
from passerby.hypotheses.registration import find_bodies
from passerby.people.body_centres import PeopleRays, identified_body_centres
from passerby.simulation import SimulationOptions, simulate
from passerby.solver.people import PeopleOptions, PeopleSolution
from support.datasets.cmc import write_cmc
from support.scenes.people_and_rigs import part, simulated, solve, without_poses
from support.scenes.walking_area import Walk
from support.tiers import thinned

NAME = "C2"
SOLVING = PeopleOptions(max_sightings=4000)


def examined(change, rig=None):  # type: ignore[no-untyped-def]
    """The readings found where one camera's observations were changed, and the rig is the true one."""
    scene = simulated("terrace")
    seen, lens = part(scene.observations), scene.rig[NAME].lens
    cameras = {**seen.cameras, NAME: change(seen[NAME], lens)}
    solution = Solution("people", rig or scene.rig, "accepted")
    return examine_readings(solution, Observations(cameras, seen.fps), clocks=True)


def boxes_only(seen: CameraObservations) -> CameraObservations:
    return CameraObservations(seen.boxes)


@thinned(
    ("code", "change"),
    [
        ("image_mirrored", lambda seen, lens: mirrored(boxes_only(seen), lens.size)),
        ("image_turned", lambda seen, lens: turn_seen(boxes_only(seen), lens.size, 180)),
        ("image_overturned", lambda seen, lens: turn_seen(mirrored(boxes_only(seen), lens.size), lens.size, 180)),
        ("smaller_image", lambda seen, lens: CameraObservations(replace(seen.boxes, ltwh=0.5 * seen.boxes.ltwh))),
    ],
    every=3,
)
def test_a_misread_camera_is_found_and_put_where_it_stands(code: str, change) -> None:  # type: ignore[no-untyped-def]
    found = examined(change)
    assert [(one.name, one.reading.code, one.decision) for one in found] == [(NAME, code, "doubt")]
    assert np.linalg.norm(found[0].pose.centre - simulated("terrace").rig[NAME].pose.centre) < 0.3


def test_a_late_clock_is_found_with_its_offset_and_right_observations_and_rigs_without_poses_raise_nothing() -> None:
    scene = simulated("terrace")
    found = examined(lambda seen, lens: CameraObservations(replace(seen.boxes, frame=seen.boxes.frame + 3)))
    assert [(one.name, one.reading.code, one.decision) for one in found] == [(NAME, "clock_late", "correct")]
    assert found[0].reading.late_s == pytest.approx(3 / scene.observations.fps, abs=0.3 / scene.observations.fps)
    for rig in (scene.rig, without_poses(scene.rig)):
        assert examined(lambda seen, lens: seen, rig) == []


def test_a_mirrored_image_mirrored_again_is_the_image() -> None:
    scene = simulated("terrace")
    seen, size = scene.observations[NAME], scene.rig[NAME].lens.size
    again = mirrored(mirrored(seen, size), size)
    assert np.allclose(again.boxes.ltwh, seen.boxes.ltwh)
    assert np.allclose(again.keypoints.xy, seen.keypoints.xy)


def boxed(walk: Walk, fps: float) -> Observations:
    """The boxes of the cylinders that walk."""
    cameras = {}
    for camera in walk.rig:
        rows = [
            (frame + 1, person, box)
            for frame, here in enumerate(walk.positions)
            for person, xy in enumerate(here)
            if (box := walk.cylinder_box(camera, xy, whole=True)) is not None
        ]
        frames, people, corners = (np.array(column) for column in zip(*rows, strict=True))
        ltwh = np.column_stack([corners[:, :2], corners[:, 2:] - corners[:, :2]]).astype(np.float64)
        cameras[camera.name] = CameraObservations(Boxes(frames, people, ltwh, np.ones(len(frames))))
    return Observations(cameras, fps)


def test_a_low_camera_is_not_taken_for_an_overturned_one_below_the_ground(tmp_path) -> None:
    """Cylinders filmed from 2 to 3 m: cameras that are a little below the ground see nearly the same boxes upside down."""
    walk = write_cmc(tmp_path / "CMC1")
    seen = boxed(walk, 4.0)
    rays = PeopleRays.of(walk.rig, identified_body_centres(walk.rig, seen))
    for index, camera in enumerate(walk.rig):
        people = rays.triangulated(PERSON_HEIGHT_M, rays.camera != index)
        overturned = turn_seen(mirrored(seen[camera.name], camera.lens.size), camera.lens.size, 180)
        assert find_bodies(overturned, camera.lens).with_places(people).anew(np.random.default_rng(0)) is None
        assert find_bodies(seen[camera.name], camera.lens).with_places(people).anew(np.random.default_rng(0)) is not None


@thinned("seed", range(4811, 4815), quick=2)
def test_nothing_is_found_in_short_recordings(seed: int) -> None:
    scene = simulate(SimulationOptions(preset="construction", seed=seed, cameras=3, people=4, seconds=3.0))
    assert examine_readings(Solution("people", scene.rig, "accepted"), scene.observations, clocks=True) == []


def solved(preset: str, share: float, *names: str) -> PeopleSolution:
    """A solution by the boxes of a scene of 20 s, those of some cameras shifted right and down by a share of their size."""
    scene = simulated(preset)
    cameras = {}
    for name, seen in part(scene.observations).cameras.items():
        ltwh = np.array(seen.boxes.ltwh)
        ltwh[:, :2] += (share if name in names else 0.0) * ltwh[:, 2:]
        cameras[name] = CameraObservations(replace(seen.boxes, ltwh=ltwh))
    solution = solve(scene.rig, Observations(cameras, scene.observations.fps), options=SOLVING)
    assert isinstance(solution, PeopleSolution)
    return solution


@thinned("preset", ["terrace", "basketball", "construction"])
@pytest.mark.parametrize("share", [0.0, 0.06])
def test_boxes_as_stated_raise_nothing(preset: str, share: float) -> None:
    assert find_shifted_boxes(solved(preset, share, *simulated(preset).rig.names)) is None


def test_exact_boxes_raise_nothing() -> None:
    """Their lower edges move with the feet: as boxes do whose middles were read as corners, but statures do not show it."""
    scene = simulate(SimulationOptions(people=6, seconds=20.0, fps=10.0, box_noise=0.0))
    solution = solve(scene.rig, part(scene.observations), options=SOLVING)
    assert isinstance(solution, PeopleSolution)
    assert find_shifted_boxes(solution) is None


@thinned(("preset", "share"), [("basketball", 0.5), ("terrace", 0.5), ("construction", -0.5), ("basketball", -0.5)], quick=1)
def test_centres_read_as_corners_in_all_cameras_are_found(preset: str, share: float) -> None:
    names = simulated(preset).rig.names
    found = find_shifted_boxes(solved(preset, share, *names))
    assert found.cameras == names
    assert abs(found.shift - share) < 3 * np.hypot(found.sigma, 0.05)
    finding = boxes_in_other_format(found)
    assert finding.values["box_format"] == ("centres" if share > 0 else "ltwh")
    assert f'set boxes = "{finding.values["box_format"]}"' in text_of(finding)


def test_centres_read_as_corners_in_one_camera_are_found() -> None:
    found = find_shifted_boxes(solved("basketball", 0.5, "C2"))
    assert found.cameras == ("C2",)
