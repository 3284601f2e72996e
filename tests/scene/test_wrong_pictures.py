"""Boxes from images of another size, crop or rotation than the lens is for."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.core.cameras import Camera, Lens, Pose
from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.findings.finding import doubt
from passerby.perception.video import VideoInfo
from passerby.scene.box_interpretations import is_upside_down, level_of_rotation, rotation_of_sideways
from passerby.scene.lens_sources import smaller_picture
from passerby.scene.people_in_images import faults_of_people, findings_of_people
from passerby.scene.reading import input_from_memory
from passerby.scene.scene import Scene
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.body import pose_joints
from passerby.simulation.lenses import looking_at
from passerby.simulation.observe import observe_camera
from passerby.simulation.scene import film
from support.tiers import thinned

Change = Callable[[Boxes, tuple[int, int]], Boxes]


@cache
def scene(preset: str = "terrace", seed: int = 1, height: float | None = None) -> SimulatedScene:
    return simulate(SimulationOptions(preset=preset, seconds=30.0, people=6, box_noise=0.02, seed=seed, camera_height_m=height))


def calibrated(
    made: SimulatedScene, changed: tuple[str, ...], change: Change, lens: Callable[[Lens], Lens] = lambda lens: lens,
    given: bool = True,
) -> passerby.Calibration:  # fmt: skip
    """With the boxes and the lenses of some cameras changed."""
    lenses = {camera.name: lens(camera.lens) if camera.name in changed else camera.lens for camera in made.rig}
    boxes = {name: made.observations[name].boxes for name in made.rig.names}
    boxes |= {name: change(boxes[name], made.rig[name].lens.size) for name in changed}
    return passerby.calibrate_observations(
        lenses, boxes, fps=5.0, association={"mode": "given" if given else "combined", "max_offset_s": 0}
    )


def scaled(factor: float) -> Change:
    return lambda boxes, size: replace(boxes, ltwh=factor * boxes.ltwh)


def flipped(boxes: Boxes, size: tuple[int, int]) -> Boxes:
    ltwh = boxes.ltwh.copy()
    ltwh[:, 1] = size[1] - ltwh[:, 1] - ltwh[:, 3]
    return replace(boxes, ltwh=ltwh)


def upside_down(boxes: Boxes, size: tuple[int, int]) -> Boxes:
    ltwh = flipped(boxes, size).ltwh.copy()
    ltwh[:, 0] = size[0] - ltwh[:, 0] - ltwh[:, 2]
    return replace(boxes, ltwh=ltwh)


def larger(lens: Lens) -> Lens:
    """For pictures twice as large; the people keep to the upper left quarter."""
    return replace(lens, size=(2 * lens.size[0], 2 * lens.size[1]))


@pytest.mark.system
@pytest.mark.parametrize("given", [True, False])
def test_boxes_of_a_half_size_picture_are_a_doubt(given: bool) -> None:
    found = calibrated(scene(), ("C2",), scaled(0.5), given=given)
    assert found.verdict == "doubtful"
    (told,) = [reason for reason in found.reasons if "its people seem to be detected" in reason]
    assert "camera C2: its people seem to be detected in images of 360 x 288, not of the stated 720 x 576" in told


@pytest.mark.system
@pytest.mark.parametrize(
    ("factor", "size"),
    [
        (0.5, "360 x 288"),
        pytest.param(1 / 3, "240 x 192", marks=pytest.mark.slow),
        pytest.param(2 / 3, "480 x 384", marks=pytest.mark.slow),
    ],
)
def test_boxes_of_a_second_stream_of_all_cameras_are_a_doubt(factor: float, size: str) -> None:
    made = scene()
    found = calibrated(made, made.rig.names, scaled(factor))
    assert found.verdict != "accepted"
    assert sum(f"seem to be detected in images of {size}" in reason for reason in found.reasons) == 4


@pytest.mark.system
@pytest.mark.parametrize("changed", [("C2",), ("C1", "C2", "C3", "C4")])
@pytest.mark.parametrize("preset", ["terrace", "construction"])
def test_people_who_keep_to_a_corner_of_the_picture_are_accepted(changed: tuple[str, ...], preset: str) -> None:
    found = calibrated(scene(preset), changed, lambda boxes, size: boxes, larger)
    assert found.verdict == "accepted", found.reasons
    assert any("wrong image size" in finding for finding in found.findings)


def walkers(size: tuple[int, int], cut: float) -> np.ndarray:
    """Extents of people all over a picture, cut off at a share of its size."""
    rng = np.random.default_rng(1)
    tall = rng.uniform(60, 300, 2000)
    left, top = rng.uniform(-20, size[0], 2000), rng.uniform(0.2, 0.9, 2000) * size[1]
    extent = np.column_stack([left, top, left + 0.4 * tall, top + tall])
    return np.clip(extent, 0, np.tile(cut * np.array(size), 2))[(left < 0.95 * cut * size[0]) & (top < 0.9 * cut * size[1])]


def test_people_cut_off_at_the_border_of_a_second_stream_show_its_size() -> None:
    """People who stop short of a line are not cut off."""
    found = smaller_picture(walkers((1920, 1080), 0.5), (1920, 1080))
    assert found[1] == (960, 540)
    whole = walkers((1920, 1080), 1.0)
    inside = whole[(whole[:, 2] < 960) & (whole[:, 3] < 540)]
    assert len(inside) > 100
    one = np.tile([400.0, 300.0, 480.0, 540.0], (400, 1))
    for seen in (whole, inside, np.concatenate([inside, one])):
        assert smaller_picture(seen, (1920, 1080)) is None


@thinned(("preset", "height"), [("terrace", None), ("basketball", None), ("construction", None), ("terrace", 4.0)])
def test_a_flip_top_to_bottom_is_found_and_right_pictures_are_none(preset: str, height: float | None) -> None:
    made = scene(preset, height=height)
    for camera in made.rig:
        boxes = made.observations[camera.name].boxes
        assert not is_upside_down(camera.lens, CameraObservations(boxes), 1.72)
        wrong_boxes = flipped(boxes, camera.lens.size)
        stated, turned = (level_of_rotation(camera.lens, wrong_boxes, 1.72, turn) for turn in (0, 180))
        assert stated is not None
        assert turned is not None
        assert stated.residual / turned.residual > 1.2
    wrong = CameraObservations(flipped(made.observations["C1"].boxes, made.rig["C1"].lens.size))
    assert is_upside_down(made.rig["C1"].lens, wrong, 1.72)
    camera, joints = made.rig["C1"], made.observations["C1"].keypoints
    assert not is_upside_down(camera.lens, CameraObservations(keypoints=joints), 1.72)
    turned = replace(joints, xy=(0, camera.lens.size[1]) + joints.xy * (1, -1))
    assert is_upside_down(camera.lens, CameraObservations(keypoints=turned), 1.72)


@thinned("height", [1.2, 8.0])
def test_where_both_ways_fit_alike_no_flip_is_found(height: float) -> None:
    made = scene(height=height)
    for camera in made.rig:
        assert not is_upside_down(camera.lens, made.observations[camera.name], 1.72)


@pytest.mark.system
@pytest.mark.parametrize("change", [flipped, upside_down])
def test_no_rig_with_a_picture_turned_over_is_accepted(change: Change) -> None:
    found = calibrated(scene(), ("C2",), change)
    assert found.verdict != "accepted"
    assert doubt("image_misread", "C2", how="upside_down", rotate=180) in found.doubts


def sideways(made: SimulatedScene, name: str, turn: int) -> tuple[Lens, CameraObservations]:
    """A camera whose images are on their side: those that `turn` degrees clockwise put upright."""
    camera, seen = made.rig[name], made.observations[name]
    width, height = camera.lens.size

    def back(xy: np.ndarray) -> np.ndarray:
        """Anticlockwise by `turn`; the upright image's (x, y)."""
        return np.stack([xy[..., 1], width - xy[..., 0]] if turn == 90 else [height - xy[..., 1], xy[..., 0]], axis=-1)

    ltwh = seen.boxes.ltwh
    ends = np.stack([back(ltwh[:, :2]), back(ltwh[:, :2] + ltwh[:, 2:])])
    boxes = replace(seen.boxes, ltwh=np.concatenate([ends.min(axis=0), np.ptp(ends, axis=0)], axis=1))
    point = back(camera.lens.matrix[:2, 2])
    fx, fy = camera.lens.matrix[0, 0], camera.lens.matrix[1, 1]
    matrix = np.array([[fy, 0, point[0]], [0, fx, point[1]], [0, 0, 1.0]])
    lens = Lens((height, width), matrix, np.zeros(0))
    return lens, CameraObservations(boxes, replace(seen.keypoints, xy=back(seen.keypoints.xy)))


@pytest.mark.parametrize("turn", [90, 270])
@thinned(("preset", "height"), [("terrace", None), ("basketball", None), ("construction", None), ("terrace", 6.0)])
def test_the_rotation_that_puts_people_upright_is_found(preset: str, height: float | None, turn: int) -> None:
    made = scene(preset, height=height)
    for name in made.rig.names:
        lens, seen = sideways(made, name, turn)
        assert rotation_of_sideways(lens, CameraObservations(seen.boxes), 1.72) == turn
        assert rotation_of_sideways(lens, seen, 1.72) == turn
        # A camera on its side is calibrated by keypoints as any other.
        assert rotation_of_sideways(lens, CameraObservations(keypoints=seen.keypoints), 1.72) == 0
        assert not is_upside_down(lens, CameraObservations(seen.boxes), 1.72)
        right = made.observations[name]
        assert rotation_of_sideways(made.rig[name].lens, CameraObservations(right.boxes), 1.72) == 0
        assert rotation_of_sideways(made.rig[name].lens, right, 1.72) == 0


def test_a_camera_on_its_side_is_one_error_with_its_remedy() -> None:
    made = scene()
    lens, seen = sideways(made, "C2", 270)
    boxes = {name: made.observations[name].boxes for name in made.rig.names} | {"C2": seen.boxes}
    with pytest.raises(passerby.InputError, match=r"camera C2: people lie on their side: .* set rotate = 270 \(") as error:
        passerby.calibrate_observations(
            {camera.name: camera.lens for camera in made.rig} | {"C2": lens}, boxes, fps=5.0, association={"mode": "given"}
        )
    assert "more fault" not in str(error.value)


def test_many_people_beyond_the_image_are_an_error() -> None:
    """A picture within the picture, or a crop: the boxes of one camera are so low that half of them end below the image."""
    made = scene()
    width, height = made.rig["C3"].lens.size
    boxes = {name: made.observations[name].boxes for name in made.rig.names}
    ends = boxes["C3"].ltwh[:, 1] + boxes["C3"].ltwh[:, 3]
    low = replace(boxes["C3"], ltwh=boxes["C3"].ltwh + (0.0, height - np.median(ends), 0.0, 0.0))
    with pytest.raises(passerby.InputError, match=rf"camera C3: .* the {width} x {height} image .*offset"):
        passerby.calibrate_observations(made.rig, boxes | {"C3": low}, fps=5.0, association={"mode": "given"})


@thinned(("preset", "seed"), [("construction", 100), ("terrace", 102), ("construction", 7)])
def test_bodies_that_are_cut_off_and_drawn_whole_are_no_error(preset: str, seed: int) -> None:
    made = scene(preset, seed, height=6.0)
    cameras = {name: {"intrinsics": Path("r"), "tracks": Path("t")} for name in made.rig.names}
    declared = Scene.model_validate({"cameras": cameras, "association": {"mode": "given"}})
    readings, beyond = [], 0
    for camera in made.rig:
        joints = made.observations[camera.name].keypoints
        low, high = joints.xy.min(axis=1), joints.xy.max(axis=1)
        whole = Boxes(joints.frame, joints.identity, np.concatenate([low, high - low], axis=1), np.ones(len(joints)))
        beyond += int((high > camera.lens.size).any(axis=1).sum())
        readings.append(input_from_memory(declared, camera.name, camera.lens, whole, Keypoints.empty()))
    assert beyond > 20
    assert faults_of_people(declared, readings) == []


def test_people_that_passerby_detected_itself_are_not_suspected_of_another_size() -> None:
    made = scene()
    declared = Scene.model_validate(
        {"cameras": {n: {"intrinsics": Path("r"), "video": Path("cam0.mp4")} for n in made.rig.names}}
    )
    camera = made.rig["C1"]
    half = scaled(0.3)(made.observations["C1"].boxes, camera.lens.size)
    reading = input_from_memory(declared, "C1", camera.lens, half, Keypoints.empty())
    reading.boxes_path = Path("cam0.mp4")
    assert [one.code for one in findings_of_people(declared, [reading])] == ["people_in_part_of_image"]
    reading.video = VideoInfo(Path("cam0.mp4"), camera.lens.size, "h264", 25.0, False, 25.0, None, None)
    assert findings_of_people(declared, [reading]) == []


def two_terraces(camera_height: float, step: float, distance: float, seed: int) -> tuple[Lens, Boxes]:
    """Boxes of people on two levels `distance` metres apart, the near one `step` metres higher than the far one."""
    filmed = film(SimulationOptions(preset="terrace", seconds=30.0, people=6, seed=seed))
    lens = Lens((1280, 720), np.array([[914.0, 0, 640], [0, 914, 360], [0, 0, 1]]), np.zeros(0))
    state, present = filmed.motion.at(np.arange(150) / 5.0)
    joints, near = pose_joints(state, filmed.heights), np.arange(6) % 2 == 0
    shift = np.where(near[:, None], (0.0, -distance / 2, max(step, 0.0)), (0.0, distance / 2, max(-step, 0.0)))
    centre = np.array([0.0, -(distance / 2 + 5.5), camera_height])
    camera = Camera("C1", lens, Pose.from_centre(looking_at(centre, np.array([0.0, 0.0, 0.8 + abs(step) / 2])), centre))
    view = observe_camera(camera, joints + shift[None, :, None], filmed.heights, present)
    seen = (view.inside > 0.9) & (view.hidden < 0.2)
    box = view.box[seen]
    box = box + np.random.default_rng(seed).normal(0, 0.02, box.shape) * (box[:, 3:] - box[:, 1:2])
    frame, person = np.nonzero(seen)
    return lens, Boxes(frame + 1, person + 1, np.column_stack([box[:, :2], box[:, 2:] - box[:, :2]]), np.ones(len(box)))


@thinned(("step", "distance", "seed"), [(-3.0, 5.0, 1), (-3.0, 8.0, 1), (1.5, 5.0, 1), (1.5, 5.0, 2)], every=2)
def test_people_on_two_terraces_are_not_upside_down(step: float, distance: float, seed: int) -> None:
    lens, boxes = two_terraces(3.0, step, distance, seed)
    seen = CameraObservations(boxes)
    assert len(boxes) > 300
    assert not is_upside_down(lens, seen, 1.72)
    assert rotation_of_sideways(lens, seen, 1.72) == 0
