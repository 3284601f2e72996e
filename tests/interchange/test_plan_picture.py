"""Pictures of floor plans: turned as the file says, and what is none is told."""

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import LEAST_PX, decode_plan_picture, read_plan_picture


def encoded(height=20, width=30, ending=".png"):
    picture = np.zeros((height, width, 3), np.uint8)
    picture[:, :10] = (0, 0, 255)
    return cv2.imencode(ending, picture)[1].tobytes()


def test_a_picture_is_read_in_colours(tmp_path):
    (tmp_path / "plan.png").write_bytes(encoded())
    picture = read_plan_picture(tmp_path / "plan.png")
    assert (picture.shape, picture[5, 5].tolist(), picture[5, 25].tolist()) == ((20, 30, 3), [0, 0, 255], [0, 0, 0])


@pytest.mark.parametrize("content", [b"", encoded()[:30]])
def test_what_is_no_picture_is_told(tmp_path, content):
    (tmp_path / "plan.png").write_bytes(content)
    with pytest.raises(InputError, match=r"plan\.png: is no picture that can be read: give a PNG or JPEG"):
        read_plan_picture(tmp_path / "plan.png")


def test_what_the_decoder_does_not_take_is_told(monkeypatch):
    def broken(*arguments):
        raise cv2.error("too large")

    monkeypatch.setattr(cv2, "imdecode", broken)
    with pytest.raises(InputError, match=r"^the upload: is no picture that can be read"):
        decode_plan_picture(encoded(), "the upload")


def test_a_picture_of_a_few_pixels_is_no_plan(tmp_path):
    assert decode_plan_picture(encoded(LEAST_PX, LEAST_PX), "plan").shape == (LEAST_PX, LEAST_PX, 3)
    with pytest.raises(InputError, match="plan: is 30 x 7 pixels: give a picture of the plan"):
        decode_plan_picture(encoded(LEAST_PX - 1), "plan")
    with pytest.raises(InputError, match="no such file: a picture of the plan"):
        read_plan_picture(tmp_path / "none.png")
