"""Whom one camera sees, another should see: counted over a small crowd in front of true and of turned cameras."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.diagnostics.covisibility import doubts_of_missed, least_shared, people_missed
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.simulation.placement import looking_at

LENS = Lens((1280, 720), np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]), np.zeros(0))


@pytest.fixture(scope="module")
def rig() -> Rig:
    """Three cameras around a square, 4 m up."""
    places = [(-9.0, -8.0), (9.0, -8.5), (0.0, 11.0)]
    aim = np.array([0.0, 0.0, 0.9])
    cameras = []
    for number, place in enumerate(places, start=1):
        centre = np.array([*place, 4.0])
        cameras.append(Camera(f"C{number}", LENS, Pose.from_centre(looking_at(centre, aim), centre)))
    return Rig(tuple(cameras))


@pytest.fixture(scope="module")
def walked() -> np.ndarray:
    """(200, 3, 2) places of three people who cross the square."""
    at = np.linspace(0, 2 * np.pi, 200)
    return np.stack([np.column_stack([3 * np.cos(k + 1.3 * at), 3 * np.sin((1 + 0.4 * k) * at)]) for k in range(3)], axis=1)


def seen_by(rig: Rig, walked: np.ndarray) -> Observations:
    """The people's boxes in all cameras, none hidden."""
    cameras = {}
    frames, people = walked.shape[:2]
    for camera in rig:
        place = np.column_stack([walked.reshape(-1, 2), np.zeros(frames * people)])
        foot, head = camera.project(place), camera.project(place + (0, 0, 1.75))
        height = foot[:, 1] - head[:, 1]
        ltwh = np.column_stack([foot[:, 0] - 0.2 * height, head[:, 1], 0.4 * height, height])
        boxes = Boxes(np.repeat(np.arange(1, frames + 1), people), np.tile(np.arange(people), frames), ltwh, np.ones(len(ltwh)))
        cameras[camera.name] = CameraObservations(boxes)
    return Observations(cameras)


def test_everybody_is_found_by_the_true_rig(rig: Rig, walked: np.ndarray) -> None:
    pairs = people_missed(rig, seen_by(rig, walked))
    assert len(pairs) == 6
    assert min(pair.due for pair in pairs) > 300
    assert all(pair.found == pair.due for pair in pairs)
    assert all(pair.by_chance < 0.5 * pair.due for pair in pairs)
    assert doubts_of_missed(rig, seen_by(rig, walked)) == []


def test_a_slower_camera_is_not_accused_of_what_it_had_no_sample_of(rig: Rig, walked: np.ndarray) -> None:
    seen, others = seen_by(rig, walked), seen_by(rig, -walked[::-1])

    def slower(of: Observations) -> Observations:
        boxes = of["C2"].boxes
        return replace(seen, cameras={**seen.cameras, "C2": CameraObservations(boxes.take(boxes.frame % 2 == 1))})

    pairs = [pair for pair in people_missed(rig, slower(seen)) if pair.should == "C2"]
    assert all(pair.found == pair.due >= 100 for pair in pairs)
    assert doubts_of_missed(rig, slower(seen)) == []
    assert len(doubts_of_missed(rig, slower(others))) == 1


def test_a_camera_that_filmed_others_is_told(rig: Rig, walked: np.ndarray) -> None:
    seen, others = seen_by(rig, walked), seen_by(rig, -walked[::-1])
    mixed = replace(seen, cameras={**seen.cameras, "C2": others["C2"]})
    (told,) = doubts_of_missed(rig, mixed)
    assert told.code == "people_missed"
    assert "C2" in told.cameras
    (pair,) = [pair for pair in people_missed(rig, mixed) if (pair.sees, pair.should) == told.cameras]
    assert told.values == {"found": pair.found / pair.due, "by_chance": pair.by_chance / pair.due}
    assert 0 < pair.by_chance < pair.due


def films_others(rig: Rig, walked: np.ndarray, camera: str, share: float) -> Observations:
    """A camera sees the others' people for a share of the time only, evenly, and other people else."""
    seen, others = seen_by(rig, walked), seen_by(rig, -walked[::-1])
    boxes = [of[camera].boxes for of in (seen, others)]
    own = boxes[0].frame % 20 < 20 * share
    mixed = replace(boxes[0], ltwh=np.where(own[:, None], boxes[0].ltwh, boxes[1].ltwh))
    return replace(seen, cameras={**seen.cameras, camera: CameraObservations(mixed)})


@pytest.mark.parametrize(("share", "codes"), [(0.15, ["people_missed"]), (0.4, ["people_not_shared"]), (0.85, [])])
def test_a_camera_that_shares_fewer_people_than_the_others_do_is_told(rig: Rig, walked: np.ndarray, share, codes) -> None:
    doubts = doubts_of_missed(rig, films_others(rig, walked, "C2", share))
    assert [doubt.code for doubt in doubts] == codes
    if codes == ["people_not_shared"]:
        assert doubts[0].cameras == ("C2",)
        assert doubts[0].values["found"] == pytest.approx(share, abs=0.12)
        assert doubts[0].values["others"] == 1.0


def test_cameras_that_all_miss_people_are_not_accused(rig: Rig, walked: np.ndarray) -> None:
    """As a detector does: every second person in turn is found, whatever the camera."""
    seen = seen_by(rig, walked)
    rng = np.random.default_rng(1)
    cameras = {}
    for name, camera in seen.cameras.items():
        cameras[name] = CameraObservations(camera.boxes.take(rng.random(len(camera.boxes)) < 0.5))
    missed = people_missed(rig, replace(seen, cameras=cameras))
    assert max(pair.share for pair in missed) < 0.6
    least = least_shared(missed)
    assert least is not None
    assert least.ratio == pytest.approx(1.0, abs=0.15)
    assert doubts_of_missed(rig, replace(seen, cameras=cameras)) == []


def test_two_cameras_have_no_others_to_be_held_against(rig: Rig, walked: np.ndarray) -> None:
    mixed = films_others(rig, walked, "C2", 0.4)
    two = replace(mixed, cameras={name: mixed[name] for name in ("C1", "C2")})
    pairs = people_missed(Rig(rig.cameras[:2]), two)
    assert least_shared(pairs) is None
    assert doubts_of_missed(Rig(rig.cameras[:2]), two) == []


@pytest.mark.parametrize(("beyond_px", "due"), [(1, 0), (4, 200)])
def test_whoever_stands_at_the_border_need_not_be_found(rig: Rig, beyond_px: int, due: int) -> None:
    """Within a quarter of the height that is expected, and three pixels."""
    seen = seen_by(rig, np.zeros((200, 1, 2)))
    foot, head = rig["C2"].project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.75]]))
    height = int(np.ceil(foot[1] + 0.25 * np.linalg.norm(foot - head))) + beyond_px
    cropped = Rig((rig["C1"], replace(rig["C2"], lens=replace(LENS, size=(1280, height)))))
    # Boxes that are a little low, for nobody is looked for who is smaller than those who are found.
    low = replace(seen["C2"].boxes, ltwh=seen["C2"].boxes.ltwh * (1, 1, 1, 0.9))
    pairs = people_missed(cropped, replace(seen, cameras={"C1": seen["C1"], "C2": CameraObservations(low)}))
    assert [pair.due for pair in pairs if pair.should == "C2"] == [due]


def test_a_turned_camera_is_told(rig: Rig, walked: np.ndarray) -> None:
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    pose = rig["C3"].pose
    assert pose is not None
    turned = Rig((*rig.cameras[:2], replace(rig["C3"], pose=Pose.from_centre(pose.R_cw @ turn, pose.centre))))
    (told,) = doubts_of_missed(turned, seen_by(rig, walked))
    assert told.code == "people_missed"
    assert "C3" in told.cameras


def test_few_people_and_cameras_without_a_pose_say_nothing(rig: Rig, walked: np.ndarray) -> None:
    assert doubts_of_missed(rig, seen_by(rig, walked[:5])) == []
    lost = Rig(tuple(replace(camera, pose=None) for camera in rig))
    assert people_missed(lost, seen_by(rig, walked)) == []


def test_a_camera_that_saw_nobody_says_nothing(rig: Rig, walked: np.ndarray) -> None:
    seen = seen_by(rig, walked)
    empty = replace(seen, cameras={**seen.cameras, "C1": CameraObservations()})
    assert {(pair.sees, pair.should) for pair in people_missed(rig, empty)} == {("C2", "C3"), ("C3", "C2")}


def test_who_is_due_and_found_does_not_depend_on_the_origin_and_the_heading_of_the_world(rig: Rig, walked: np.ndarray) -> None:
    seen = films_others(rig, walked, "C2", 0.4)
    c, s = np.cos(1.0), np.sin(1.0)
    moved = rig.moved(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([60.0, -35.0, 0.0]), 1.0)
    assert people_missed(moved, seen) == people_missed(rig, seen)
