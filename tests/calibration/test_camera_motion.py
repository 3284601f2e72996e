"""What is told of a camera that moved or zoomed, and what of its people is left out."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.camera_motion import MARGIN_S, DetectedMotion, _without
from passerby.core.cameras import Pose
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.hypotheses.changes import PoseChange

FPS = 25.0
MAIN = Pose(np.eye(3), np.zeros(3))
CHANGE = PoseChange(
    1, 1, at_start=False, at_end=False, main=MAIN, other=Pose.from_centre(np.eye(3), np.array([0.3, 0.0, 0.4])), gain=100.0,
    sigmas=50.0, shift=0.2,
)  # fmt: skip


def motion(first: int, last: int, *, fps: float | None = FPS, zoom: float = 1.0, **ends: bool) -> DetectedMotion:
    """Of camera B, whose frames `first` to `last` were left out."""
    return DetectedMotion("B", first, last, fps, replace(CHANGE, zoom=zoom, **ends))


@pytest.mark.parametrize(
    ("moved", "frames", "seconds", "left_out"),
    [
        (motion(501, 1000, at_end=True), [501, 501], [20.0, 20.0], "after"),
        (motion(1, 500, at_start=True), [501, 501], [20.0, 20.0], "before"),
        (motion(501, 751), [501, 751], [20.0, 30.0], "between"),
    ],
)
def test_a_move_is_told_with_when_it_was_or_with_there_and_back(
    moved: DetectedMotion, frames: list[int], seconds: list[float], left_out: str
) -> None:
    told = moved.finding
    severity = "notice" if left_out == "between" else "doubt"  # the rig is right before and after
    assert (told.code, told.severity, told.cameras) == ("camera_moved", severity, ("B",))
    assert told.values["frames"] == frames
    assert told.values["seconds"] == pytest.approx(seconds)
    assert told.values["left_out"] == left_out
    assert told.values["metres"] == pytest.approx(0.5)
    assert told.values["factor"] is None
    # What a scene file takes are whole seconds that lie outside the margin of the move.
    assert seconds[0] - MARGIN_S - 1 < told.values["until_s"] <= seconds[0] - MARGIN_S
    assert seconds[1] + MARGIN_S <= told.values["from_s"] < seconds[1] + MARGIN_S + 1


@pytest.mark.parametrize(("ends", "factor"), [({"at_end": True}, 1.25), ({}, 1.25), ({"at_start": True}, 0.8)])
def test_a_zoom_is_told_as_the_picture_changed_in_the_course_of_time(ends: dict[str, bool], factor: float) -> None:
    """1.25 times the focal length before is 0.8 times after; without a frame rate it is told in frames alone."""
    told = motion(501, 1000, fps=None, zoom=1.25, **ends).finding
    assert told.code == "camera_moved"
    assert told.values["factor"] == pytest.approx(factor)
    assert told.values["frames"] == ([501, 1000] if not ends else [501, 501] if "at_end" in ends else [1001, 1001])
    assert told.values["seconds"] is told.values["until_s"] is told.values["from_s"] is None


@pytest.mark.parametrize(("fps", "margin"), [(20.0, 10), (4.0, 2)])
def test_half_a_second_before_and_after_is_left_out_as_well_and_of_that_camera_only(fps: float, margin: int) -> None:
    frame = np.arange(1, 101)
    boxes = Boxes(frame, np.zeros(100, int), np.full((100, 4), 50.0), np.ones(100))
    joints = Keypoints(frame, np.zeros(100, int), np.full((100, 1, 2), 50.0), np.ones((100, 1)), ("head",))
    seen = Observations({name: CameraObservations(boxes, joints) for name in "AB"}, fps)
    rest = _without(seen, motion(40, 60, fps=fps))
    left = [*range(1, 40 - margin), *range(60 + margin + 1, 101)]
    assert rest["B"].boxes.frame.tolist() == rest["B"].keypoints.frame.tolist() == left
    assert len(rest["A"].boxes) == len(rest["A"].keypoints) == 100
