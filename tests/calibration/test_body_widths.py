"""How wide people are by a rig: boxes made by hand around people of a known width."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.calibration.diagnostics.body_widths import MIN_BOXES, body_widths, doubts_of_widths
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.simulation.placement import looking_at

LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]), np.zeros(4))
SPOTS = ((-9.0, -8.0, 3.1), (9.0, -7.0, 2.7))
N = MIN_BOXES


def rig() -> Rig:
    aim = np.array([0.0, 0.0, 0.9])
    return Rig(tuple(
        Camera(f"C{n}", LENS, Pose.from_centre(looking_at(np.array(spot), aim), np.array(spot)))
        for n, spot in enumerate(SPOTS, start=1)
    ))  # fmt: skip


def seen(cameras: Rig, places: np.ndarray, width_m: float, identity: int = 1) -> Observations:
    """Everybody as a box of this width about the place (N, 3), frame by frame."""
    found = {}
    for camera in cameras:
        across = np.cross(places - camera.centre, [0.0, 0.0, 1.0])
        across *= width_m / 2 / np.linalg.norm(across, axis=1)[:, None]
        one, other = camera.project(places - across), camera.project(places + across)
        left, px = np.minimum(one[:, 0], other[:, 0]), np.abs(one[:, 0] - other[:, 0])
        ltwh = np.column_stack([left, (one[:, 1] + other[:, 1]) / 2 - 1.5 * px, px, 3 * px])
        boxes = Boxes(np.arange(1, len(places) + 1), np.full(len(places), identity), ltwh, np.ones(len(places)))
        found[camera.name] = CameraObservations(boxes, Keypoints.empty())
    return Observations(found)


def people(count: int = N) -> tuple[np.ndarray, np.ndarray]:
    places = np.column_stack([np.random.default_rng(0).uniform(-2, 2, (count, 2)), np.full(count, 0.9)])
    return np.column_stack([np.arange(1, count + 1), np.ones(count)]), places


def test_widths_are_in_metres_at_the_people() -> None:
    keys, places = people()
    widths = body_widths(rig(), seen(rig(), places, 0.6), keys, places)
    assert len(widths) == 2 * N
    np.testing.assert_allclose(widths, 0.6, rtol=0.01)


@pytest.mark.parametrize(("width_m", "grown", "told"), [
    (0.6, 1.0, False), (1.2, 1.0, True), (0.35, 1.0, True), (0.6, 2.0, True), (1.2, 0.5, False),
])  # fmt: skip
def test_only_widths_that_people_do_not_have_are_told(width_m: float, grown: float, told: bool) -> None:
    keys, places = people()
    found = doubts_of_widths(rig(), seen(rig(), places, width_m), keys, places, grown)
    assert [one.code for one in found] == ["boxes_misshapen"] * told
    if told:
        assert found[0].values["width_m"] == pytest.approx(width_m * grown, rel=0.03)


def test_boxes_at_the_border_of_nobody_who_is_placed_and_too_few_say_nothing() -> None:
    keys, places = people()
    wide = seen(rig(), places, 1.2)
    assert doubts_of_widths(rig(), wide, keys[: N // 4], places[: N // 4]) == []
    assert len(body_widths(rig(), seen(rig(), places, 1.2, identity=7), keys, places)) == 0
    assert len(body_widths(rig(), wide, np.zeros((0, 2)), np.zeros((0, 3)))) == 0
    cut = {
        name: CameraObservations(
            Boxes(own.boxes.frame, own.boxes.identity, own.boxes.ltwh * [0, 1, 1, 1], own.boxes.score), Keypoints.empty()
        )
        for name, own in wide.cameras.items()
    }  # fmt: skip
    assert len(body_widths(rig(), Observations(cut), keys, places)) == 0


@pytest.mark.parametrize(("count", "told"), [(MIN_BOXES - 1, False), (MIN_BOXES, True)])
def test_just_enough_boxes_are_enough_to_tell(count: int, told: bool) -> None:
    keys, places = people(count)
    one = Rig(rig().cameras[:1])
    assert len(doubts_of_widths(one, seen(one, places, 1.2), keys, places)) == told
