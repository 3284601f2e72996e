"""People that cameras predict in each other's images, and people held out of the adjustment: what they say of a rig."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.held_out import hold_out, is_held_out
from passerby.calibration.prediction import Outcomes, find_poor_predictions, findings_of_predictions, predict_people
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import HeldOutFigures, NoiseFigures
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.findings.finding import Finding
from passerby.people.one_against_others import disagreements
from passerby.simulation import SimulationOptions, simulate
from support.scenes.people_and_rigs import looking_at

LENS = Lens((1280, 720), np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]), np.zeros(0))


CLOSE = 0.08
"""Of the height: boxes here have no noise."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    """Three cameras around a square, 4 m up."""
    places = [(-9.0, -8.0, 4.0), (9.0, -8.5, 4.0), (0.0, 11.0, 4.0)]
    return Rig(tuple(Camera(f"C{n}", LENS, looking_at(place, (0.0, 0.0, 0.9))) for n, place in enumerate(places, start=1)))


@pytest.fixture(scope="module")
def seen(rig: Rig, walked: np.ndarray) -> Observations:
    return seen_by(rig, walked)


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


def with_boxes(seen: Observations, **boxes: Boxes) -> Observations:
    """The same with other boxes of some cameras."""
    return replace(seen, cameras={**seen.cameras, **{name: CameraObservations(one) for name, one in boxes.items()}})


def films_others(rig: Rig, walked: np.ndarray, camera: str, own: np.ndarray) -> Observations:
    """A camera sees the others' people in some frames (200,) only, and other people else."""
    seen, others = seen_by(rig, walked), seen_by(rig, -walked[::-1])
    boxes = seen[camera].boxes
    ltwh = np.where(own[boxes.frame - 1, None], boxes.ltwh, others[camera].boxes.ltwh)
    return with_boxes(seen, **{camera: replace(boxes, ltwh=ltwh)})


def findings(rig: Rig, seen: Observations) -> list[Finding]:
    return findings_of_predictions(rig, predict_people(rig, seen, {}))


def in_camera(outcomes: Outcomes, camera: int) -> Outcomes:
    return outcomes.take(outcomes.within == camera)


def turned(degrees: float) -> np.ndarray:
    """About the vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_everyone_is_detected_where_the_true_rig_predicts(rig: Rig, seen: Observations) -> None:
    outcomes = predict_people(rig, seen, {})
    assert len(np.unique(np.column_stack([outcomes.by, outcomes.within]), axis=0)) == 6
    assert len(outcomes) > 1500
    assert (outcomes.residual < CLOSE).mean() > 0.99
    assert (outcomes.by_chance < CLOSE).mean() < 0.3
    assert set(outcomes.part) == set(range(8))
    assert findings(rig, seen) == []
    # Neither names nor detectors that miss people are a fault of the rig.
    boxes = {name: seen[name].boxes for name in rig.names}
    for shares in ((0.6, 0.6, 0.6), (0.95, 0.95, 0.8)):
        rng = np.random.default_rng(1)
        kept = {name: one.take(rng.random(len(one)) < share) for (name, one), share in zip(boxes.items(), shares, strict=True)}
        assert findings(rig, with_boxes(seen, **kept)) == []
    assert findings(rig, with_boxes(seen, C2=replace(boxes["C2"], identity=(boxes["C2"].identity + 1) % 3))) == []
    outcomes = predict_people(rig, with_boxes(seen, C2=replace(boxes["C2"], identity=np.full(len(boxes["C2"]), -1))), {})
    assert not (outcomes.by == 1).any()
    assert (in_camera(outcomes, 1).residual < CLOSE).mean() > 0.99


@pytest.mark.parametrize(("share", "poor"), [(0.15, True), (0.4, True), (0.9, False)])
def test_a_camera_that_films_other_people_most_of_the_time(rig: Rig, walked: np.ndarray, share: float, poor: bool) -> None:
    """Wherever the origin and the heading of the world are."""
    elsewhere = films_others(rig, walked, "C2", np.arange(200) % 20 < 20 * share)
    moved = rig.moved(turned(57.3), np.array([60.0, -35.0, 0.0]), 1.0)
    found, other = findings(rig, elsewhere), findings(moved, elsewhere)
    assert [(one.code, one.severity, one.cameras) for one in found] == [("people_not_predicted", "doubt", ("C2",))] * poor
    assert [(one.cameras, one.values["share"]) for one in other] == [
        (one.cameras, pytest.approx(one.values["share"], abs=1e-6)) for one in found
    ]
    for one in found:
        assert one.values["share"] == pytest.approx(share, abs=0.12)
        assert one.values["expected"] > 0.8


def test_the_part_of_the_recording_that_disagrees_and_a_turned_camera_are_named(
    rig: Rig, walked: np.ndarray, seen: Observations
) -> None:
    (one,) = findings(rig, films_others(rig, walked, "C2", np.arange(200) < 100))
    assert one.cameras == ("C2",)
    assert (one.values["from_percent"], one.values["to_percent"]) == (50.0, 100.0)
    pose = rig["C3"].pose
    bent = Rig((*rig.cameras[:2], replace(rig["C3"], pose=Pose.from_centre(pose.R_cw @ turned(4), pose.centre))))
    (one,) = findings(bent, seen)
    assert one.cameras == ("C3",)
    assert one.values["share"] < 0.2


def test_where_all_cameras_disagree_or_most_boxes_are_missed_the_rig_is_doubtful(
    rig: Rig, walked: np.ndarray, seen: Observations
) -> None:
    elsewhere = [seen_by(rig, way) for way in (walked, -walked[::-1], walked[:, ::-1, ::-1] * (1, -1))]
    seen = Observations({name: part[name] for name, part in zip(rig.names, elsewhere, strict=True)})
    (one,) = findings(rig, seen)
    assert one.cameras == ()
    # Of two cameras, either may be wrong.
    two = Rig(rig.cameras[:2])
    (one,) = findings(two, films_others(two, walked, "C2", np.zeros(200, dtype=bool)))
    assert one.cameras == ()
    # A wrong rig can fit some of the people well and be near the others: its noise says how near is near enough.
    outcomes = predict_people(rig, seen, {})
    off = np.where(np.arange(len(outcomes)) % 4 == 0, 0.02, 0.15)
    outcomes = replace(outcomes, residual=off, by_chance=np.full(len(off), np.inf))
    noise = NoiseFigures(floor_px=0.5, box_px=0.5, centre=0.01, height=0.03, joint=0.02, broken_edges=0.0)
    (one,) = findings_of_predictions(rig, outcomes, noise)
    assert one.cameras == ()
    assert one.values["share"] == pytest.approx(0.25, abs=0.1)
    assert findings_of_predictions(rig, outcomes, replace(noise, centre=0.03)) == findings_of_predictions(rig, outcomes) == []


def test_people_behind_a_wall_or_a_nearer_person_are_not_predicted(rig: Rig, seen: Observations) -> None:
    boxes = seen["C2"].boxes
    open_side = boxes.ltwh[:, 0] > 600
    assert 0.2 < open_side.mean() < 0.8
    outcomes = predict_people(rig, with_boxes(seen, C2=boxes.take(open_side)), {})
    before = in_camera(predict_people(rig, seen, {}), 1)
    assert 0 < len(in_camera(outcomes, 1)) < 0.8 * len(before)
    # But for a third of a height along the wall, none is due who cannot be seen.
    assert (in_camera(outcomes, 1).residual < CLOSE).mean() > 0.75
    assert findings_of_predictions(rig, outcomes) == []
    early, wide = boxes.frame <= 100, np.array([100.0, 100.0, 1100.0, 600.0])
    near = replace(boxes, ltwh=np.where(early[:, None], wide, boxes.ltwh), identity=np.where(early, -1, boxes.identity))
    outcomes = in_camera(predict_people(rig, with_boxes(seen, C2=near), {}), 1)
    assert len(outcomes) > 100
    assert (outcomes.part >= 4).mean() > 0.95


def test_a_camera_is_not_blamed_for_frames_that_it_lacks(rig: Rig, seen: Observations) -> None:
    boxes = seen["C2"].boxes
    slower = with_boxes(seen, C2=boxes.take(boxes.frame % 2 == 1))
    silent = with_boxes(seen, C2=boxes.take((boxes.frame < 60) | (boxes.frame > 140)))
    gap = np.arange(60, 64)
    brief = with_boxes(seen, C2=boxes.take(~np.isin(boxes.frame, gap)))
    for lacking, unrecorded in ((slower, {}), (silent, {}), (brief, {"C2": gap})):
        outcomes = in_camera(predict_people(rig, lacking, unrecorded), 1)
        assert len(outcomes) > 200
        assert (outcomes.residual < CLOSE).mean() > 0.99
    assert (in_camera(predict_people(rig, brief, {}), 1).residual > CLOSE).any()


def test_people_at_the_border_are_not_predicted(rig: Rig) -> None:
    at = np.zeros((200, 1, 2))
    at[:100] += (3.0, 3.0)  # otherwise no camera ever detected anyone there
    seen = seen_by(rig, np.concatenate([at, at[::-1]]))
    foot, head = rig["C2"].project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.75]]))
    height = int(np.ceil(foot[1] + 0.25 * np.linalg.norm(foot - head)))
    for beyond_px, some in ((1, False), (4, True)):
        cropped = Rig((rig["C1"], replace(rig["C2"], lens=replace(LENS, size=(1280, height + beyond_px)))))
        outcomes = in_camera(predict_people(cropped, seen, {}), 1)
        assert bool(np.isin(outcomes.part, (2, 3, 4, 5)).any()) == some


def test_joints_are_predicted_as_boxes_are() -> None:
    scene = simulate(SimulationOptions(preset="terrace", seed=880, seconds=20.0, people=4, joint_noise_px=1.0))
    joints = {name: CameraObservations(keypoints=seen.keypoints) for name, seen in scene.observations.cameras.items()}
    outcomes = predict_people(scene.rig, replace(scene.observations, cameras=joints), {})
    assert len(outcomes) > 500
    assert (outcomes.residual < 0.15).mean() > 0.8
    assert findings_of_predictions(scene.rig, outcomes) == []


def test_too_little_says_nothing(rig: Rig, walked: np.ndarray) -> None:
    few = films_others(rig, walked, "C2", np.zeros(200, dtype=bool))
    boxes = {name: seen.boxes.take(seen.boxes.frame <= 5) for name, seen in few.cameras.items()}
    assert findings(rig, with_boxes(few, **boxes)) == []
    lost = Rig(tuple(replace(camera, pose=None) for camera in rig))
    assert find_poor_predictions(predict_people(lost, few, {})) == []
    empty = replace(few, cameras={**few.cameras, "C2": CameraObservations()})
    outcomes = predict_people(rig, empty, {})
    assert {*outcomes.by, *outcomes.within} == {0, 2}


HEIGHT_M = 1.72


@pytest.fixture(scope="module")
def scene():
    return simulate(SimulationOptions(preset="terrace", seed=950, seconds=25.0, box_noise=0.01))


def figures_of(rig, instants, seed=0) -> HeldOutFigures:
    found = hold_out(rig, instants, HEIGHT_M, seed)
    assert found.figures is not None
    return found.figures


def ratio(figures: HeldOutFigures) -> float:
    """How many times as much as fitted people those of the best stretch held out disagree, as a share of their size."""
    return figures.least_share / figures.fit.median_share


def test_a_good_rig_fits_the_people_held_out_in_every_fifth_stretch(scene):
    figures = figures_of(scene.rig, scene.observations)
    assert figures.stretches == 1
    assert figures.stretch_s == pytest.approx(5.0, abs=0.1)
    assert figures.fit.sightings > 3 * figures.held_out.sightings
    assert 0.6 < ratio(figures) < 1.5
    assert 0.02 < figures.held_out.ground_50_m < 0.4
    assert figures.held_out.ground_50_m < figures.held_out.ground_90_m
    steps = np.arange(1, 26 * 10)
    held = is_held_out(steps, scene.rig, scene.observations, 1.0)
    fps = scene.observations.fps
    number = (steps - steps[held][0]) // fps
    assert (held == (number % 5 == 0)).all()


@pytest.mark.slow
def test_a_camera_that_was_elsewhere_in_the_stretch_held_out(scene):
    """The rest of the recording cannot show it: only the people held out do."""
    rig, instants = scene.rig, scene.observations
    good = figures_of(rig, instants)
    seen = instants["C2"]
    ltwh = seen.boxes.ltwh.copy()
    rows = is_held_out(seen.boxes.frame, rig, instants, good.stretch_s)
    assert 0.1 < rows.mean() < 0.3
    ltwh[rows, 0] += 0.5 * ltwh[rows, 3]
    bumped = replace(instants, cameras={**instants.cameras, "C2": CameraObservations(replace(seen.boxes, ltwh=ltwh))})
    figures = figures_of(rig, bumped)
    assert figures.fit.median_px == pytest.approx(good.fit.median_px, rel=0.1)
    assert ratio(figures) > 1.5 * ratio(good)


def test_two_cameras_hold_people_out_of_each_other_and_too_few_people_hold_out_none(scene):
    for count in (1, 2):
        rig = Rig(scene.rig.cameras[:count])
        boxes = {name: scene.observations[name].boxes for name in rig.names}
        early = {name: CameraObservations(one.take(one.frame < 60)) for name, one in boxes.items()}
        seen = replace(scene.observations, cameras=early)
        found = hold_out(rig, seen, HEIGHT_M, 0)
        assert (found is not None) == (count == 2)
    assert 0.5 < ratio(found.figures) < 1.6
    rig, instants = scene.rig, scene.observations
    short = {
        name: CameraObservations(seen.boxes.take(seen.boxes.frame < seen.boxes.frame.min() + 20))
        for name, seen in instants.cameras.items()
    }
    assert hold_out(rig, replace(instants, cameras=short), HEIGHT_M, 0) is None
    assert hold_out(Rig(tuple(replace(camera, pose=None) for camera in rig)), instants, HEIGHT_M, 0) is None
    nobody = {name: CameraObservations() for name in rig.names}
    assert hold_out(rig, replace(instants, cameras=nobody), HEIGHT_M, 0) is None


def test_one_camera_against_the_others_by_hand(scene):
    rig, instants = scene.rig, scene.observations
    before = disagreements(rig, instants, HEIGHT_M)
    turn = np.radians(1.0)
    camera = rig["C3"]
    about_up = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    turned = replace(camera, pose=type(camera.pose).from_centre(about_up @ camera.pose.R_cw, camera.pose.centre))
    after = disagreements(Rig(tuple(turned if one.name == "C3" else one for one in rig)), instants, HEIGHT_M)
    degree_px = turn * camera.lens.matrix[0, 0]
    assert np.median(before["C3"].pixels) < 0.3 * degree_px
    assert np.median(after["C3"].pixels) == pytest.approx(degree_px, rel=0.3)
    assert max(np.median(one.pixels) for one in after.values()) == np.median(after["C3"].pixels)
    assert len(after["C3"]) == len(before["C3"])
