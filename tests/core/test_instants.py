"""Cameras with clocks of their own at common instants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.core.synchronisation import TimeSteps, find_common_time_steps, resample_to_common_steps

SPEED = np.array([35.0, -12.0, 3.0, 8.0])
"""How the walker's box changes, pixels a second."""
FIRST = np.array([300.0, 200.0, 60.0, 180.0])


def walker(clock: Clock, frames: np.ndarray, identity: int = 4) -> Boxes:
    """A box that changes evenly in time, as a camera with this clock sees it."""
    ltwh = FIRST + clock.seconds(frames)[:, None] * SPEED
    embedding = np.column_stack([np.cos(frames), np.sin(frames)])
    return Boxes(frames, np.full(len(frames), identity), ltwh, 0.5 + 0.01 * (frames % 10), embedding)


def as_seen(boxes: dict[str, Boxes]) -> Observations:
    return Observations({name: CameraObservations(rows) for name, rows in boxes.items()})


def brought(clocks: dict[str, Clock], boxes: dict[str, Boxes], **options: object) -> Observations:
    return resample_to_common_steps(as_seen(boxes), clocks, **options)  # type: ignore[arg-type]


def steps_of(clocks: dict[str, Clock], boxes: dict[str, Boxes]) -> TimeSteps:
    return find_common_time_steps(as_seen(boxes), clocks)


def walkers(clocks: dict[str, Clock], seconds: float = 8.0) -> dict[str, Boxes]:
    return {name: walker(clock, np.arange(1, int(seconds * clock.fps) + 1)) for name, clock in clocks.items()}


def assert_true_everywhere(found: Observations) -> None:
    """Every box is where the walker is at its instant."""
    for name, seen in found.cameras.items():
        clock = found.clocks[name]
        assert clock.fps == found.fps
        at = FIRST + clock.seconds(seen.boxes.frame)[:, None] * SPEED
        np.testing.assert_allclose(seen.boxes.ltwh, at, atol=1e-8, err_msg=name)


@settings(max_examples=60, deadline=None)
@given(
    offsets=st.lists(st.floats(-5, 5), min_size=3, max_size=3),
    rates=st.lists(st.sampled_from([2.0, 5.0, 7.0, 25.0, 30000 / 1001]), min_size=3, max_size=3),
)
def test_an_even_motion_is_met_exactly_and_no_sample_counts_twice(offsets: list[float], rates: list[float]) -> None:
    clocks = {f"C{n}": Clock(fps, offset) for n, (fps, offset) in enumerate(zip(rates, offsets, strict=True))}
    given_boxes = walkers(clocks)
    found = brought(clocks, given_boxes)
    assert_true_everywhere(found)
    for name, seen in found.cameras.items():
        frame = seen.boxes.frame
        assert len(np.unique(frame)) == len(frame)
        assert len(frame) <= len(given_boxes[name]), "a sample counts twice"
        # All instants within the walk, or as many as there are samples, but for the ends.
        least = min(8.0 * found.fps, 8.0 * clocks[name].fps) - 2  # type: ignore[operator]
        assert len(frame) >= np.floor(least) - 1


def test_cameras_whole_frames_apart_or_not_apart_keep_every_bit() -> None:
    shifts, frames = {"A": 0, "B": -7, "C": 123}, np.array([2, 3, 9, 40, 41])
    clocks = {name: Clock(10.0, shift / 10) for name, shift in shifts.items()}
    rows = {
        name: Boxes(frames, [5, 5, -1, 5, 6], FIRST + np.random.default_rng(n).uniform(0, 9, (5, 4)), np.full(5, 0.3 + n))
        for n, name in enumerate(clocks)
    }
    found = brought(clocks, rows)
    for name, shift in shifts.items():
        np.testing.assert_array_equal(found[name].boxes.frame, frames + shift)
        for column in ("identity", "ltwh", "score"):
            np.testing.assert_array_equal(getattr(found[name].boxes, column), getattr(rows[name], column))
    clocks = {"A": Clock(29.97, 3.1), "B": Clock(29.97, 3.1)}
    boxes = walkers(clocks)
    found = brought(clocks, boxes)
    for name, own in boxes.items():
        for column in ("frame", "identity", "ltwh", "score", "embedding"):
            np.testing.assert_array_equal(getattr(found[name].boxes, column), getattr(own, column))


def test_the_grid_is_the_usual_rate_and_the_busiest_camera_of_it() -> None:
    clocks = {"A": Clock(25.0, 0.013), "B": Clock(25.0, 0.2), "C": Clock(1.0, 0.4), "D": Clock(50.0, 0.1), "E": Clock(1.0)}
    boxes = walkers(clocks) | {"B": walker(clocks["B"], np.arange(1, 400)), "E": Boxes.empty()}
    assert steps_of(clocks, boxes) == TimeSteps(clocks["B"])
    found = brought(clocks, boxes)
    np.testing.assert_array_equal(found["B"].boxes.ltwh, boxes["B"].ltwh)
    assert len(found["C"].boxes) == len(boxes["C"])  # each sample at its nearest instant, but none turned into many
    # Of rates that are equally usual the slower.
    assert steps_of({**clocks, "A": Clock(1.0)}, boxes).clock.fps == 1.0


@settings(max_examples=80, deadline=None)
@given(
    fps=st.sampled_from([5.0, 12.5, 25.0, 30000 / 1001, 50.0, 60.0]),
    every=st.sampled_from([2, 3, 6, 12]),
    offsets=st.lists(st.floats(-5, 5), min_size=3, max_size=3),
    phases=st.lists(st.integers(0, 11), min_size=3, max_size=3),
)
def test_cameras_sampled_at_every_nth_frame_meet_at_the_samples(fps, every, offsets, phases):
    clocks = {f"C{n}": Clock(fps, offset) for n, offset in enumerate(offsets)}
    boxes = {
        name: walker(clock, np.arange(1 + phase, int(30 * fps), every))
        for (name, clock), phase in zip(clocks.items(), phases, strict=True)
    }
    found = brought(clocks, boxes)
    assert_true_everywhere(found)
    assert found.fps == pytest.approx(fps / every)
    steps = [set(seen.boxes.frame.tolist()) for seen in found.cameras.values()]
    seconds = [clock.seconds(boxes[name].frame) for name, clock in clocks.items()]
    together = min(own[-1] for own in seconds) - max(own[0] for own in seconds)
    # The first and the last sample may have no neighbour.
    assert len(set.intersection(*steps)) >= int(together * fps / every) - 2
    assert all(len(found[name].boxes) <= len(boxes[name]) for name in boxes), "a sample counts twice"


def test_samples_whole_steps_apart_keep_every_bit_and_are_counted_by_the_step() -> None:
    clocks = {"A": Clock(30.0), "B": Clock(30.0, -0.2), "C": Clock(30.0, 0.6)}
    boxes = {name: walker(clock, np.arange(3, 300, 6)) for name, clock in clocks.items()}
    steps = steps_of(clocks, boxes)
    assert steps == TimeSteps(clocks["A"], 6, 3)
    np.testing.assert_array_equal(steps.frames(np.array([1, 2, 10])), [3, 9, 57])
    found = brought(clocks, boxes)
    for name, shift in (("A", 0), ("B", -1), ("C", 3)):
        np.testing.assert_array_equal(found[name].boxes.frame, np.arange(1, 51) + shift)
        np.testing.assert_array_equal(found[name].boxes.ltwh, boxes[name].ltwh)
        np.testing.assert_allclose(found.clocks[name].seconds(found[name].boxes.frame), clocks[name].seconds(boxes[name].frame))


@pytest.mark.parametrize(
    "frames", [np.linspace(1, 200, 30).round(), np.linspace(1, 1600, 41).round(), np.array([3, 4, 40, 55, 61, 90, 133, 177])],
    ids=["steps of 6 and 7", "steps of 40, some of 39", "as somebody chose"],
)  # fmt: skip
def test_people_marked_in_the_same_frames_of_all_cameras_keep_every_bit(frames: np.ndarray) -> None:
    frames, clocks = frames.astype(np.int64), {"A": Clock(25.0), "B": Clock(25.0), "C": Clock(25.0, 0.4)}
    own = {"A": frames, "B": frames[1:-2], "C": np.delete(frames, 3) - 10}
    boxes = {name: walker(clock, own[name]) for name, clock in clocks.items()}
    assert steps_of(clocks, boxes) == TimeSteps(clocks["A"])
    found = brought(clocks, boxes)
    for name in clocks:
        np.testing.assert_array_equal(found[name].boxes.ltwh, boxes[name].ltwh)
        np.testing.assert_array_equal(found[name].boxes.frame, own[name] + (10 if name == "C" else 0))


def test_frames_that_only_some_cameras_share_are_brought_together() -> None:
    clocks = {"A": Clock(30.0), "B": Clock(30.0), "C": Clock(30.0)}
    frames = np.linspace(1, 400, 60).round().astype(np.int64)
    boxes = {name: walker(clock, frames + shift) for (name, clock), shift in zip(clocks.items(), (0, 0, 3), strict=True)}
    assert_true_everywhere(brought(clocks, boxes))
    assert steps_of(clocks, boxes).every > 1
    # Every second sample shared leaves the slower rate.
    two = {"A": walker(clocks["A"], np.arange(1, 600, 6)), "B": walker(clocks["B"], np.arange(1, 600, 3))}
    assert steps_of({name: clocks[name] for name in two}, two) == TimeSteps(clocks["A"], 6, 1)
    # Few samples between others do not make a camera fast.
    clocks = {"A": Clock(30.0), "B": Clock(30.0, 0.05)}
    frames = np.unique(np.concatenate([np.arange(1, 600, 6), [10, 11, 300]]))
    boxes = {"A": walker(clocks["A"], frames), "B": walker(clocks["B"], np.arange(1, 600, 6))}
    assert steps_of(clocks, boxes).every == 6
    found = brought(clocks, boxes)
    assert_true_everywhere(found)
    assert len(found["A"].boxes) == 100


def test_pictures_at_uneven_times_meet_at_most_steps() -> None:
    rng = np.random.default_rng(4)
    clocks = {f"C{n}": Clock(100.0, 0.37 * n) for n in range(3)}
    boxes = {name: walker(clock, np.cumsum(rng.integers(15, 26, 150))) for name, clock in clocks.items()}
    found = brought(clocks, boxes)
    assert_true_everywhere(found)
    frames = [seen.boxes.frame for seen in found.cameras.values()]
    assert all(len(np.unique(frame)) == len(frame) <= 150 for frame in frames)
    assert len(set(frames[0].tolist()).intersection(*(frame.tolist() for frame in frames[1:]))) > 100


def test_interpolation_spans_no_long_gap_mixes_no_people_and_uses_no_box_that_is_cut_off() -> None:
    clocks = {"A": Clock(10.0), "B": Clock(10.0, 0.05)}
    boxes = {"A": walker(clocks["A"], np.arange(1, 30)), "B": walker(clocks["B"], np.array([1, 2, 6, 7, 13, 14]))}
    found = brought(clocks, boxes)
    # Frame f of B lies halfway between instants f and f + 1. Frames 2 and 6 are 0.4 s apart, 7 and 13 are 0.6 s.
    np.testing.assert_array_equal(found["B"].boxes.frame, [2, 3, 7, 14])
    assert_true_everywhere(found)
    np.testing.assert_array_equal(brought(clocks, boxes, max_gap_s=0.3)["B"].boxes.frame, [2, 7, 14])
    two = Boxes([1, 2, 1, 2, 1], [3, 3, 8, 9, -1], np.tile(FIRST, (5, 1)), [0.9, 0.4, 1, 1, 1])
    found = brought(clocks, {**boxes, "B": two})
    assert (found["B"].boxes.identity.tolist(), found["B"].boxes.score.tolist()) == ([3], [0.4])
    ltwh = np.array([[0.0, 200, 30, 180], [10.0, 200, 60, 180], [25.0, 200, 60, 180]])
    border = {**boxes, "B": Boxes([1, 2, 3], [4, 4, 4], ltwh, np.ones(3))}
    assert brought(clocks, border)["B"].boxes.frame.tolist() == [2, 3]
    cut = brought(clocks, border, sizes={"A": (1280, 720), "B": (1280, 720)})["B"].boxes
    assert (cut.frame.tolist(), cut.ltwh[0].tolist()) == ([3], [17.5, 200, 60, 180])


def test_joints_move_along_and_doubt_stays() -> None:
    clocks = {"A": Clock(10.0), "B": Clock(10.0, 0.025)}
    xy = np.array([[[10.0, 20.0], [30.0, 40.0]], [[18.0, 20.0], [30.0, 48.0]]])
    joints = Keypoints([1, 2], [7, 7], xy, [[0.9, 0.0], [0.6, 0.8]], ("nose", "neck"))
    boxes = CameraObservations(walker(clocks["A"], np.arange(1, 9)))
    seen = Observations({"A": boxes, "B": CameraObservations(keypoints=joints)})
    found = resample_to_common_steps(seen, clocks)["B"].keypoints
    assert (found.frame.tolist(), found.score.tolist(), found.joints) == ([2], [[0.6, 0.0]], ("nose", "neck"))
    np.testing.assert_allclose(found.xy[0], [[16.0, 20.0], [30.0, 46.0]])


def test_a_missing_clock_a_rate_of_zero_and_a_doubled_identity_are_errors() -> None:
    boxes, clocks = walkers({"A": Clock(10.0), "B": Clock(10.0)}), {"A": Clock(10.0), "B": Clock(10.0)}
    twice = Boxes([1, 2, 2], [4, 4, 4], np.tile(FIRST, (3, 1)), np.ones(3))
    for own, seen, message in (
        ({"A": Clock(10.0)}, boxes, "camera B has no clock"),
        ({**clocks, "B": Clock(0.0)}, boxes, r"camera B.*fps = 0"),
        (clocks, {**boxes, "A": twice}, "camera A: identity 4 has two boxes in frame 2"),
        ({}, {}, "no camera"),
    ):
        with pytest.raises(InputError, match=message):
            brought(own, seen)
