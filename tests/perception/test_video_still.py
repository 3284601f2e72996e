"""One picture of a video: the right one, whether it is reached from the beginning or from a key frame."""

import itertools

import av
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.perception.video import VideoReader, probe
from passerby.perception.video_still import key_picture, still
from support.scenes.puppet_videos import wall, write_video

SIZE = (160, 96)
COUNT = 700


def counted(count=COUNT):
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
    return probe(write_video(tmp_path_factory.mktemp("still") / "steady.mp4", counted(), 25.0))


@pytest.fixture(scope="module")
def variable(tmp_path_factory):
    """Times that no rate explains."""
    seconds = itertools.accumulate(itertools.cycle([0.03, 0.05, 0.11]), initial=0.0)
    return probe(write_video(tmp_path_factory.mktemp("still") / "variable.mp4", counted(400), 20.0, seconds))


def one_of(info, number, pictures):
    """The still of one number by a budget of so many pictures."""
    return still(info, np.array([number]), np.ones(1), few(pictures))


def few(pictures):
    return pictures * SIZE[0] * SIZE[1]


@pytest.mark.parametrize("number", [1, 249, 250, 251, 700])
@pytest.mark.parametrize("budget", [2000, 260])
def test_the_wanted_picture_is_found(steady, number, budget):
    found = one_of(steady, number, budget)
    assert (found.number, number_of(found.picture)) == (number, number)
    assert found.seconds == pytest.approx((number - 1) / 25)


@pytest.mark.parametrize("budget", [2000, 260])
def test_numbers_of_a_variable_rate_are_hundredths_of_a_second(variable, budget):
    assert variable.variable
    every = [(frame.number, number_of(frame.picture)) for frame in VideoReader(variable)]
    for number, told in (every[0], every[123], every[-1]):
        found = one_of(variable, number, budget)
        assert (found.number, number_of(found.picture)) == (number, told)
    assert one_of(variable, every[50][0] + 1, budget) is None


def test_of_pictures_near_a_key_frame_the_worthiest_is_taken(steady):
    """Too far behind its key frame: one that is nearer and nearly as good stands in for it."""
    numbers = np.arange(5, 701, 5)
    worth = np.where(numbers % 20 == 0, 5.0, 1.0)
    worth[numbers == 480] = 9.0
    assert still(steady, numbers, worth, few(2000)).number == 480
    found, again = (still(steady, numbers, worth, few(30)) for _ in range(2))
    assert found.number != 480
    assert (found.number % 20, number_of(found.picture)) == (0, found.number)
    assert np.array_equal(found.picture, again.picture)


def test_a_picture_that_is_not_there_is_not_found(steady):
    assert [one_of(steady, 5000, budget) for budget in (2000, 30)] == [None, None]
    assert still(steady, np.zeros(0, int), np.zeros(0)) is None


def test_a_file_that_went_away_or_is_no_video_is_told_of(tmp_path):
    info = probe(write_video(tmp_path / "gone.mp4", counted(5), 25.0))
    info.path.unlink()
    with pytest.raises(InputError, match="no such file"):
        still(info, np.array([3]), np.ones(1))
    info.path.write_bytes(b"nothing")
    with pytest.raises(InputError):
        key_picture(info.path, 0.0)


@pytest.mark.parametrize("second", [0.0, 9.9, 10.01, 20.1, 500.0])
def test_the_key_frame_before_a_second(steady, second):
    with av.open(str(steady.path)) as container:
        keys = [float(packet.pts * packet.time_base) for packet in container.demux(video=0) if packet.is_keyframe]
    found, picture = key_picture(steady.path, second)
    assert found == pytest.approx(max(key for key in keys if key <= second))
    assert number_of(picture) == round(found * 25) + 1
