"""When a camera recorded nothing: gaps in its own frames, at the instants of all cameras."""

import numpy as np

from passerby.association.result import Association
from passerby.calibration.unrecorded import unrecorded_instants
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations


def boxes(frame: list[int]) -> Boxes:
    return Boxes(np.array(frame), np.ones(len(frame), int), np.full((len(frame), 4), 50.0), np.ones(len(frame)))


def associated(clocks: dict[str, Clock], grid: dict[str, Clock]) -> Association:
    """A saw somebody's box at instants 1 to 20, B somebody's joints at 31 to 40."""
    joints = Keypoints(np.arange(31, 41), np.ones(10, int), np.full((10, 1, 2), 50.0), np.ones((10, 1)), ("head",))
    cameras = {"A": CameraObservations(boxes(list(range(1, 21)))), "B": CameraObservations(Boxes.empty(), joints)}
    instants = Observations(cameras, 5.0, grid)
    return Association(instants, instants, clocks)


def test_instants_within_a_gap_are_those_between_the_frames_at_its_ends() -> None:
    """Those frames themselves were recorded; nobody asks for an instant at which nobody was seen."""
    found = unrecorded_instants({"A": [(5.0, 9.0), (18.0, 33.0)], "B": [(90.0, 95.0)]}, associated({}, {}))
    assert {name: instants.tolist() for name, instants in found.items()} == {"A": [6, 7, 8, 19, 20, 31, 32], "B": []}


def test_a_gap_counts_in_the_cameras_own_frames() -> None:
    """B has 25 frames a second, where the instants are 5 a second, and began 1 s later: instant 31, after 6 s, is frame 126."""
    grid, clocks = {"B": Clock(5.0)}, {"B": Clock(25.0, 1.0)}
    found = unrecorded_instants({"B": [(125.0, 132.0)]}, associated(clocks, grid))
    assert found["B"].tolist() == [31, 32]


def test_where_nothing_lies_within_a_gap_everything_was_recorded() -> None:
    nobody = Observations({"A": CameraObservations()})
    some, none = associated({}, {}), Association(nobody, nobody, {})
    for spans, seen in (([], some), ([(3.0, 4.0)], some), ([(1.0, 9.0)], none)):
        assert unrecorded_instants({"A": spans}, seen)["A"].tolist() == []
