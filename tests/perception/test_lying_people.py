"""Videos whose people are found once their images are turned."""

import cv2
import numpy as np
import pytest

from passerby.perception.lying_people import turn_that_shows_people
from passerby.perception.pictures import Detections
from passerby.perception.video import TURNS, probe
from support.scenes.puppet_videos import write_video


def upright_picture(number: int) -> np.ndarray:
    """Red heads above blue trousers, two of them."""
    picture = np.full((240, 320, 3), 128, np.uint8)
    for left in (60 + number, 200 - number):
        picture[60:100, left : left + 40] = (0, 0, 255)
        picture[100:180, left : left + 40] = (255, 0, 0)
    return picture


class HeadsAboveTrousers:
    """Finds people who stand: red right above blue."""

    @property
    def identity(self):
        return {}

    def __call__(self, frame):
        picture = frame.picture.astype(int)
        red, blue = picture[..., 2] - picture[..., 0] > 100, picture[..., 0] - picture[..., 2] > 100
        standing = (red[:-8] & blue[8:]).any(axis=0)
        found = int(np.count_nonzero(np.diff(standing.astype(int)) == 1))
        return Detections(np.tile([10.0, 10.0, 20.0, 60.0], (found, 1)), np.full(found, 0.9))


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_the_turn_that_shows_people_is_found(tmp_path, turn):
    """A video filmed so that `turn` degrees clockwise stand its people upright."""
    pictures = [upright_picture(number) for number in range(30)]
    filmed = [one if turn == 0 else cv2.rotate(one, TURNS[turn]) for one in pictures]
    path = write_video(tmp_path / "a.mp4", iter(filmed), 5.0)
    assert turn_that_shows_people(probe(path), HeadsAboveTrousers()) == turn
    assert turn_that_shows_people(probe(path).turned(turn), HeadsAboveTrousers()) == 0
