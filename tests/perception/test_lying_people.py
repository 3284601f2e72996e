"""Videos whose people are found once their images are turned."""

import cv2
import numpy as np
import pytest

from passerby.perception.background import BackgroundDetector, learn_background, plan_sampling
from passerby.perception.opening import turn_that_shows_people
from passerby.perception.pictures import Detections
from passerby.perception.video import TURNS, VideoReader, probe
from support.scenes.puppet_videos import pictures as pictures_of
from support.scenes.puppet_videos import puppets, write_video


def upright_picture(number: int) -> np.ndarray:
    """Red heads above blue trousers, two of them."""
    picture = np.full((240, 320, 3), 128, np.uint8)
    for left in (60 + number, 200 - number):
        picture[60:100, left : left + 40] = (0, 0, 255)
        picture[100:180, left : left + 40] = (255, 0, 0)
    return picture


def heads_above_trousers(frame):
    """Finds people who stand: red right above blue."""
    picture = frame.picture.astype(int)
    red, blue = picture[..., 2] - picture[..., 0] > 100, picture[..., 0] - picture[..., 2] > 100
    standing = (red[:-8] & blue[8:]).any(axis=0)
    found = int(np.count_nonzero(np.diff(standing.astype(int)) == 1))
    return Detections(np.tile([10.0, 10.0, 20.0, 60.0], (found, 1)), np.full(found, 0.9))


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_the_turn_that_shows_people_is_found(tmp_path, turn):
    """A video filmed so that `turn` degrees clockwise stand its people upright."""
    upright = (upright_picture(number) for number in range(30))
    filmed = upright if turn == 0 else (cv2.rotate(one, TURNS[turn]) for one in upright)
    info = probe(write_video(tmp_path / "a.mp4", filmed, 5.0))
    assert turn_that_shows_people(info, heads_above_trousers) == turn
    assert turn_that_shows_people(info.turned(turn), heads_above_trousers) == 0


@pytest.mark.parametrize("turn", [90, 270])
def test_background_subtraction_sees_people_on_their_side(tmp_path, turn):
    """Whether these stand on their heads after a turn it cannot see."""
    made = puppets(24.0, 5.0, 2, 3)
    pictures = [cv2.rotate(picture, TURNS[turn]) for picture in pictures_of(made, "C1")]
    path = write_video(tmp_path / "a.mp4", iter(pictures), made.fps)
    for degrees, expected in ((0, {90, 270}), (turn, {0})):
        info = probe(path).turned(degrees)
        sampling = plan_sampling(info.seconds)
        model = learn_background(VideoReader(info, rate=1.0 / sampling.interval_s), sampling)
        assert turn_that_shows_people(info, BackgroundDetector(model)) in expected
