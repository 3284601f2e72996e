import cv2
import numpy as np
import pytest

from passerby.perception.reid import StripesEmbedder

BACKGROUND = ((90, 120, 90), (150, 150, 160))


def person(jacket, trousers, background=BACKGROUND[0], seed=1, width=40, height=100) -> np.ndarray:
    """A picture (BGR) of somebody 30 % of the box wide at (60, 40), with sensor noise."""
    picture = np.empty((200, 200, 3))
    picture[:] = background
    middle = slice(60 + int(0.3 * width), 60 + int(0.7 * width))
    picture[40 : 40 + height // 6, middle] = (120, 150, 200)
    picture[40 + height // 6 : 40 + height // 2, middle] = jacket
    picture[40 + height // 2 : 40 + height, middle] = trousers
    noisy = picture + np.random.default_rng(seed).normal(0, 6, picture.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def box(width=40.0, height=100.0) -> np.ndarray:
    return np.array([[60.0, 40.0, width, height]])


PEOPLE = [
    ((20, 20, 20), (120, 60, 30)),
    ((30, 30, 180), (20, 20, 20)),
    ((200, 200, 200), (120, 60, 30)),
    ((40, 160, 40), (200, 200, 200)),
    ((120, 60, 30), (30, 30, 180)),
    ((30, 30, 180), (120, 60, 30)),
]


def similarities(first: list[np.ndarray], second: list[np.ndarray]) -> np.ndarray:
    embed = StripesEmbedder()
    a, b = (np.vstack([embed(picture, box()) for picture in pictures]) for pictures in (first, second))
    return a @ b.T


def test_boxes_together_are_boxes_apart_bit_for_bit():
    embed, picture = StripesEmbedder(), person(*PEOPLE[1])
    rng = np.random.default_rng(2)
    boxes = np.hstack([rng.uniform(0, 80, (70, 2)), rng.uniform((20, 40), (100, 110), (70, 2))])
    apart = np.vstack([embed(picture, one[None]) for one in boxes])
    np.testing.assert_array_equal(embed(picture, boxes), apart)


@pytest.mark.parametrize("exposed", [False, True], ids=["another background", "other exposure and white balance"])
def test_the_same_clothes_in_another_camera_are_the_most_similar(exposed):
    first = [person(*clothes, seed=k) for k, clothes in enumerate(PEOPLE)]
    gain = np.array([1.25, 1.0, 0.8]) * 0.75
    if exposed:
        second = [np.clip(person(*c, seed=50 + k) * gain + 12, 0, 255).astype(np.uint8) for k, c in enumerate(PEOPLE)]
    else:
        second = [person(*clothes, background=BACKGROUND[1], seed=100 + k) for k, clothes in enumerate(PEOPLE)]
    similar = similarities(first, second)
    np.testing.assert_array_equal(similar.argmax(axis=1), np.arange(len(PEOPLE)))
    if not exposed:
        np.testing.assert_array_equal(similar.argmax(axis=0), np.arange(len(PEOPLE)))


def test_jacket_and_trousers_exchanged_are_another_person():
    similar = similarities([person(*PEOPLE[4])], [person(*PEOPLE[4], seed=9), person(*PEOPLE[5], seed=9)])[0]
    assert similar[0] > similar[1] + 0.2


def test_a_person_nearer_and_farther_looks_the_same():
    embed = StripesEmbedder()
    near = person(*PEOPLE[3])
    far = cv2.resize(near, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)
    similar = embed(near, box())[0] @ embed(far, box() * 0.4)[0]
    assert similar > 0.95


def test_black_and_white_pictures_have_vectors_too():
    for grey in (0, 255):
        vectors = StripesEmbedder()(np.full((200, 200, 3), grey, dtype=np.uint8), box())
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-6)
