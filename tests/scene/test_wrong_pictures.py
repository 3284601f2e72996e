"""Boxes from smaller pictures than the lens is for, and people on their heads, let no rig be accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.core.cameras import Lens
from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.findings.finding import doubt
from passerby.scene.intrinsics_checks import smaller_picture
from passerby.scene.upside_down import doubt_of_upside_down, fits_better_turned
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
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
def test_boxes_of_a_half_size_picture_are_told(given: bool) -> None:
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
def test_boxes_of_a_second_stream_of_all_cameras_are_told(factor: float, size: str) -> None:
    made = scene()
    found = calibrated(made, made.rig.names, scaled(factor))
    assert found.verdict != "accepted"
    assert sum(f"seem to be detected in images of {size}" in reason for reason in found.reasons) == 4


@pytest.mark.system
@pytest.mark.parametrize("changed", [("C2",), ("C1", "C2", "C3", "C4")])
@pytest.mark.parametrize("preset", ["terrace", "construction"])
def test_people_who_keep_to_a_corner_of_the_picture_are_not_accused(changed: tuple[str, ...], preset: str) -> None:
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


def test_people_cut_off_at_the_border_of_a_second_stream_tell_its_size() -> None:
    found = smaller_picture(walkers((1920, 1080), 0.5), (1920, 1080))
    assert found is not None
    assert found[1] == (960, 540)
    assert smaller_picture(walkers((1920, 1080), 1.0), (1920, 1080)) is None


def test_people_who_stop_short_of_a_line_are_not_cut_off() -> None:
    whole = walkers((1920, 1080), 1.0)
    inside = whole[(whole[:, 2] < 960) & (whole[:, 3] < 540)]
    assert len(inside) > 100
    assert smaller_picture(inside, (1920, 1080)) is None
    one = np.tile([400.0, 300.0, 480.0, 540.0], (400, 1))
    assert smaller_picture(np.concatenate([inside, one]), (1920, 1080)) is None


@thinned(("preset", "height"), [("terrace", None), ("basketball", None), ("construction", None), ("terrace", 4.0)], quick=2)
def test_a_flip_top_to_bottom_is_told_and_right_pictures_are_not(preset: str, height: float | None) -> None:
    made = scene(preset, height=height)
    for camera in made.rig:
        boxes = made.observations[camera.name].boxes
        told = doubt_of_upside_down(camera.name, camera.lens, CameraObservations(boxes), 1.72)
        assert told is None
        wrong = CameraObservations(flipped(boxes, camera.lens.size))
        assert fits_better_turned(camera.lens, wrong, 1.72) > 1.2
    wrong = CameraObservations(flipped(made.observations["C1"].boxes, made.rig["C1"].lens.size))
    told = doubt_of_upside_down("C1", made.rig["C1"].lens, wrong, 1.72)
    assert told == doubt("image_upside_down", "C1")


@pytest.mark.parametrize("height", [1.2, 8.0])
def test_where_both_ways_fit_alike_nothing_is_said(height: float) -> None:
    made = scene(height=height)
    for camera in made.rig:
        assert doubt_of_upside_down(camera.name, camera.lens, made.observations[camera.name], 1.72) is None


@pytest.mark.system
@pytest.mark.parametrize("change", [flipped, upside_down])
def test_no_rig_with_a_picture_turned_over_is_accepted(change: Change) -> None:
    found = calibrated(scene(), ("C2",), change)
    assert found.verdict != "accepted"
    assert doubt("image_upside_down", "C2") in found.doubts


def test_joints_tell_themselves() -> None:
    made = scene()
    camera = made.rig["C1"]
    joints = made.observations["C1"].keypoints
    assert doubt_of_upside_down("C1", camera.lens, CameraObservations(keypoints=joints), 1.72) is None
    turned = Keypoints(
        joints.frame, joints.identity, (0, camera.lens.size[1]) + joints.xy * (1, -1), joints.score, joints.joints
    )
    told = doubt_of_upside_down("C1", camera.lens, CameraObservations(keypoints=turned), 1.72)
    assert told == doubt("image_upside_down", "C1")


@pytest.mark.slow
def test_findings_of_the_files_are_told_with_the_path(tmp_path: Path) -> None:
    lens = Lens((1920, 1080), np.array([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]), np.zeros(0))
    extent = walkers((1920, 1080), 0.5)
    extent = extent[(extent[:, 2:] > extent[:, :2] + 1).all(axis=1)]
    frame = np.arange(len(extent)) + 1
    boxes = Boxes(
        frame, np.zeros(len(extent)), np.column_stack([extent[:, :2], extent[:, 2:] - extent[:, :2]]), np.ones(len(extent))
    )
    other = replace(boxes, ltwh=boxes.ltwh + [0, 0, 0, 5.0])
    found = passerby.calibrate_observations(
        {"A": lens, "B": lens}, {"A": boxes, "B": other.take(frame % 2 == 0)}, fps=5.0, association={"mode": "given"}
    )
    assert found.verdict != "accepted"
    assert any("camera A: all people lie within 960 x 540 of the 1920 x 1080 image" in reason for reason in found.reasons)
