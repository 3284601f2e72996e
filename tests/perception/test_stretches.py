"""Stretches of a recording, and a quick look at key frames."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from passerby.core.observations import Boxes, Keypoints
from passerby.perception.stretches import (
    Overview,
    Stretch,
    cut_into_stretches,
    find_window,
    is_divisible,
    key_frames,
    part_of_video,
    rank_stretches,
    spread_evenly,
)
from passerby.perception.video import VideoReader, expected_count, probe
from passerby.perception.video_observations import VideoObservations, join_stretches
from support.scenes.numbered_videos import number_in, written


@pytest.mark.parametrize(("seconds", "count"), [(10.0, 1), (44.0, 1), (60.0, 2), (3600.0, 120)])
def test_stretches_cover_a_recording_once(seconds, count):
    stretches = cut_into_stretches(5.0, 5.0 + seconds)
    assert (len(stretches), stretches[0].begin_s, stretches[-1].end_s) == (count, 5.0, 5.0 + seconds)
    assert all(one.end_s == after.begin_s for one, after in pairwise(stretches))


@pytest.mark.parametrize("rate", [None, 10.0, 0.5])
def test_the_parts_of_a_video_have_the_frames_of_the_whole(tmp_path, rate):
    info = probe(written(tmp_path / "a.mp4", 240))
    whole = [(frame.number, number_in(frame.picture)) for frame in VideoReader(info, rate)]
    found, expected = [], 0
    for stretch in (Stretch(0.0, 3.2), Stretch(3.2, 6.4), Stretch(6.4, 9.6)):
        part = part_of_video(info, stretch)
        frames = list(VideoReader(part, rate))
        assert all(stretch.begin_s <= frame.seconds < stretch.end_s for frame in frames)
        found += [(frame.number, number_in(frame.picture)) for frame in frames]
        expected += expected_count(part, rate)
    # The first frame of a part is the first one at or after a tick of the rate, as of the whole.
    assert set(whole) <= set(found)
    assert len(found) - len(whole) <= (0 if rate is None else 2)
    assert abs(expected - len(found)) <= 3


def test_key_frames_are_found_without_what_lies_between(tmp_path):
    info = probe(written(tmp_path / "a.mp4", 240))
    wanted, inside = [0.2, 0.21, 3.0, 5.5, 9.55], Stretch(4.0, 8.0)
    part = part_of_video(info, inside)
    for video, seconds in ((info, wanted), (part_of_video(info, Stretch(0.0, 20.0)), wanted), (part, spread_evenly(inside, 4))):
        frames = list(key_frames(video, seconds))
        assert [number_in(frame.picture) for frame in frames] == [frame.number for frame in frames]
        assert len(frames) == 4, "each once"
        if video is not part:  # There is a key frame every second at least.
            assert all(0 <= second - frame.seconds <= 1 for frame, second in zip(frames, np.delete(wanted, 1), strict=True))


def test_a_video_of_unknown_length_is_not_divided(tmp_path):
    info = probe(written(tmp_path / "a.mp4", 50))
    unknown, timed = replace(info, seconds=None), replace(info, frame_times=(0.0, 0.04))
    assert [is_divisible(one) for one in (info, unknown, timed)] == [True, False, False]


@pytest.mark.parametrize(
    ("whole", "stretch", "window"),
    [((0, 3600), (0, 30), (0, 300)), ((0, 3600), (3570, 3600), (3300, 3600)), ((10, 70), (40, 70), (10, 70))],
)
def test_the_empty_scene_is_learnt_near_a_stretch(whole, stretch, window):
    assert find_window(Stretch(*whole), Stretch(*stretch)) == Stretch(*window)


def looks(*people):
    """An overview with one look every ten seconds; for each, where people stand."""
    feet = [np.array(one, dtype=float).reshape(-1, 2) for one in people]
    return Overview(10.0 * np.arange(len(people)) + 5.0, np.array([len(one) for one in feet]), np.concatenate(feet))


def test_people_whom_two_cameras_see_count_and_new_places_count_more():
    """The second of two alike comes after a place that is new; one camera's people teach nothing; nor does an empty room.
    A stretch without a look comes last."""
    stretches = tuple(Stretch(10.0 * k, 10.0 * (k + 1)) for k in range(5))
    here, there, far, middle = (0.1, 0.9), (0.9, 0.9), (0.5, 0.1), (0.5, 0.5)
    overviews = {
        "A": looks([], [here, there], [here, there], [here], [far, middle]),
        "B": looks([], [here, there], [here, there], [], [far, middle]),
    }
    assert rank_stretches(stretches, overviews) == [1, 4, 2, 0, 3]
    halves = tuple(Stretch(5.0 * k, 5.0 * (k + 1)) for k in range(4))
    assert rank_stretches(halves, dict.fromkeys("AB", looks([middle], [(0.2, 0.5)]))) == [1, 3, 0, 2]


def test_a_camera_that_was_moved_between_two_stretches_is_a_fault(tmp_path):
    info = probe(written(tmp_path / "a.mp4", 24))
    wide = np.random.default_rng(3).integers(0, 255, (30, 50)).astype(np.uint8).repeat(10, axis=0).repeat(10, axis=1)

    def stretch(begin_s, shift):
        summary = {"moves": [], "broken": 0, "first_broken_s": None, "ended_early": None, "shake_px": 0.0}
        view = np.ascontiguousarray(wide[:270, shift : shift + 480])
        return VideoObservations(Boxes.empty(), Keypoints.empty(), 10, summary, begin_s=begin_s, view=view)

    def faults(*shifts):
        parts = [stretch(30.0 * k, shift) for k, shift in enumerate(shifts)]
        return join_stretches(parts, (480, 270)).faults("C1", info)

    assert faults(0, 0, 1) == []
    [fault] = faults(0, 0, 8, 8)
    assert "the camera moves 60.0 s after the start, by 8 pixels, and stays there" in fault
