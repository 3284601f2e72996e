"""Parts of a recording: one picture, key frames, stretches, and a quick look all over it."""

import itertools
from dataclasses import replace

import av
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import Boxes, Keypoints
from passerby.perception.overview import look_over
from passerby.perception.plan import Plan
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
from passerby.perception.video_still import key_picture, still
from passerby.perception.watching import CameraJob
from support.scenes.numbered_videos import number_in, written
from support.scenes.puppet_videos import film, puppets, wall, write_video

SIZE = (160, 96)


def counted(count):
    """Pictures that tell their number by ten squares, before a wall that moves."""
    behind = wall(SIZE, 1)
    for number in range(1, count + 1):
        picture = np.roll(behind, number, axis=1)
        for bit in range(10):
            picture[8:20, 8 + 14 * bit : 18 + 14 * bit] = 255 if number >> bit & 1 else 0
        yield picture


def number_of(picture):
    return sum(1 << bit for bit in range(10) if picture[14, 13 + 14 * bit].mean() > 127)


@pytest.fixture(scope="module")
def steady(tmp_path_factory):
    return probe(write_video(tmp_path_factory.mktemp("still") / "steady.mp4", counted(700), 25.0))


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    return probe(written(tmp_path_factory.mktemp("numbers") / "a.mp4", 240))


def pixels(pictures):
    return pictures * SIZE[0] * SIZE[1]


def still_of(info, number, pictures):
    """The still of one number by a budget of so many pictures."""
    return still(info, np.array([number]), np.ones(1), pixels(pictures))


@pytest.mark.parametrize("budget", [2000, 260])
def test_the_wanted_picture_is_found(steady, tmp_path, budget):
    """Whether it is reached from the beginning or from a key frame; numbers of a variable rate are hundredths of a second."""
    for number in (1, 249, 250, 251, 700):
        found = still_of(steady, number, budget)
        assert (found.number, number_of(found.picture)) == (number, number)
        assert found.seconds == pytest.approx((number - 1) / 25)
    assert (still_of(steady, 5000, budget), still(steady, np.zeros(0, int), np.zeros(0))) == (None, None)
    seconds = itertools.accumulate(itertools.cycle([0.03, 0.05, 0.11]), initial=0.0)
    variable = probe(write_video(tmp_path / "variable.mp4", counted(400), 20.0, seconds))
    assert variable.variable
    every = [(frame.number, number_of(frame.picture)) for frame in VideoReader(variable)]
    for number, shown in (every[0], every[123], every[-1]):
        found = still_of(variable, number, budget)
        assert (found.number, number_of(found.picture)) == (number, shown)
    assert still_of(variable, every[50][0] + 1, budget) is None


def test_of_pictures_near_a_key_frame_the_worthiest_is_taken(steady):
    """Too far behind its key frame: one that is nearer and nearly as good stands in for it."""
    numbers = np.arange(5, 701, 5)
    worth = np.where(numbers % 20 == 0, 5.0, 1.0)
    worth[numbers == 480] = 9.0
    assert still(steady, numbers, worth, pixels(2000)).number == 480
    found, again = (still(steady, numbers, worth, pixels(30)) for _ in range(2))
    assert found.number != 480
    assert (found.number % 20, number_of(found.picture)) == (0, found.number)
    assert np.array_equal(found.picture, again.picture)
    assert still_of(steady, 5000, 30) is None


def test_a_file_that_went_away_or_is_no_video_is_an_error(tmp_path):
    info = probe(write_video(tmp_path / "gone.mp4", counted(5), 25.0))
    info.path.unlink()
    with pytest.raises(InputError, match="no such file"):
        still(info, np.array([3]), np.ones(1))
    info.path.write_bytes(b"nothing")
    with pytest.raises(InputError):
        key_picture(info.path, 0.0)


def test_the_key_frame_before_a_second(steady):
    with av.open(str(steady.path)) as container:
        keys = [float(packet.pts * packet.time_base) for packet in container.demux(video=0) if packet.is_keyframe]
    for second in (0.0, 9.9, 10.01, 20.1, 500.0):
        found, picture = key_picture(steady.path, second)
        assert found == pytest.approx(max(key for key in keys if key <= second))
        assert number_of(picture) == round(found * 25) + 1


def test_stretches_cover_a_recording_once_and_an_unknown_length_is_not_divided(numbers):
    for seconds, count in ((10.0, 1), (44.0, 1), (60.0, 2), (3600.0, 120)):
        stretches = cut_into_stretches(5.0, 5.0 + seconds)
        assert (len(stretches), stretches[0].begin_s, stretches[-1].end_s) == (count, 5.0, 5.0 + seconds)
        assert all(one.end_s == after.begin_s for one, after in itertools.pairwise(stretches))
    unknown, timed = replace(numbers, seconds=None), replace(numbers, frame_times=(0.0, 0.04))
    assert [is_divisible(one) for one in (numbers, unknown, timed)] == [True, False, False]


@pytest.mark.parametrize("rate", [None, 10.0, 0.5])
def test_the_parts_of_a_video_have_the_frames_of_the_whole(numbers, rate):
    whole = [(frame.number, number_in(frame.picture)) for frame in VideoReader(numbers, rate)]
    found, expected = [], 0
    for stretch in (Stretch(0.0, 3.2), Stretch(3.2, 6.4), Stretch(6.4, 9.6)):
        part = part_of_video(numbers, stretch)
        frames = list(VideoReader(part, rate))
        assert all(stretch.begin_s <= frame.seconds < stretch.end_s for frame in frames)
        found += [(frame.number, number_in(frame.picture)) for frame in frames]
        expected += expected_count(part, rate)
    # The first frame of a part is the first one at or after a tick of the rate, as of the whole.
    assert set(whole) <= set(found)
    assert len(found) - len(whole) <= (0 if rate is None else 2)
    assert abs(expected - len(found)) <= 3


def test_key_frames_are_found_without_what_lies_between(numbers):
    wanted, inside = [0.2, 0.21, 3.0, 5.5, 9.55], Stretch(4.0, 8.0)
    part, whole = part_of_video(numbers, inside), part_of_video(numbers, Stretch(0.0, 20.0))
    for video, seconds in ((numbers, wanted), (whole, wanted), (part, spread_evenly(inside, 4))):
        frames = list(key_frames(video, seconds))
        assert [number_in(frame.picture) for frame in frames] == [frame.number for frame in frames]
        assert len(frames) == 4, "each once"
        if video is not part:  # There is a key frame every second at least.
            assert all(0 <= second - frame.seconds <= 1 for frame, second in zip(frames, np.delete(wanted, 1), strict=True))


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


def test_people_seen_by_two_cameras_count_and_new_places_count_more():
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


def test_a_quick_look_sees_people_where_they_stand(tmp_path):
    """The people that it sees stand where somebody is, within a cell of the ranking's; of all people it sees most."""
    made, progress = puppets(40.0, 3.0, 1, 4), []
    film(made, tmp_path, key_every=3)
    info = probe(tmp_path / "C1.mp4")
    job = CameraJob("C1", info, 3.0, Plan(None, None, None), tmp_path / "shelf")
    found = look_over(job, lambda done, total: progress.append(done))
    assert progress == sorted(progress)
    seconds, count, true = found.seconds, found.count, made.boxes["C1"]
    assert 36 <= len(seconds) <= 41, "a key frame every second"
    assert (np.diff(seconds) > 0).all()
    feet = (true.ltwh[:, :2] + true.ltwh[:, 2:] * (0.5, 1.0)) / info.size
    shown = np.rint(seconds * 3.0).astype(int) + 1
    pairs = zip(np.repeat(shown, count).tolist(), found.feet, strict=True)
    off = [np.linalg.norm(feet[true.frame == number] - place, axis=1).min(initial=1.0) for number, place in pairs]
    assert (np.array(off) < 1 / 8).mean() > 0.9
    assert count.sum() > 0.6 * np.isin(true.frame, shown).sum()
    np.testing.assert_array_equal(look_over(job, lambda done, total: None).feet, found.feet)


def test_a_camera_that_was_moved_between_two_stretches_is_a_fault(numbers):
    wide = np.random.default_rng(3).integers(0, 255, (30, 50)).astype(np.uint8).repeat(10, axis=0).repeat(10, axis=1)

    def stretch(begin_s, shift):
        summary = {"moves": [], "broken": 0, "first_broken_s": None, "ended_early": None, "shake_px": 0.0}
        view = np.ascontiguousarray(wide[:270, shift : shift + 480])
        return VideoObservations(Boxes.empty(), Keypoints.empty(), 10, summary, begin_s=begin_s, view=view)

    def faults(*shifts):
        parts = [stretch(30.0 * k, shift) for k, shift in enumerate(shifts)]
        return join_stretches(parts, (480, 270)).faults("C1", numbers)

    assert faults(0, 0, 1) == []
    [fault] = faults(0, 0, 8, 8)
    assert "the camera moves 60.0 s after the start, by 8 pixels, and stays there" in fault
