"""Pictures are varied as far as the options say and no further."""

import numpy as np
import pytest

from passerby.training.options import TrainOptions
from passerby.training.pictures import ERASED_AREA, ERASED_ASPECT, ERASED_COLOUR, augment

NONE = {"flip": 0.0, "shift": 0.0, "erasing": 0.0, "colour": 0.0}
SIZE = (64, 32)
MEAN = np.array(ERASED_COLOUR).round().astype(int)


def options(**chosen):
    return TrainOptions(**{**NONE, **chosen})


def noise(seed=0, low=0, high=256):
    return np.random.default_rng(seed).integers(low, high, (*SIZE, 3)).astype(np.uint8)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_nothing_is_asked_for():
    shown = noise()
    for seed in range(20):
        np.testing.assert_array_equal(augment(shown, options(), rng(seed)), shown)


def test_the_picture_given_stays():
    shown = noise()
    for seed in range(20):
        augment(shown, options(flip=0.5, shift=0.1, erasing=1, colour=0.3), rng(seed))
    np.testing.assert_array_equal(shown, noise())


def test_the_same_draws_give_the_same_picture():
    chosen = options(flip=0.5, shift=0.08, erasing=0.5, colour=0.2)
    first = [augment(noise(), chosen, rng(seed)) for seed in range(20)]
    for seed, shown in enumerate(first):
        np.testing.assert_array_equal(augment(noise(), chosen, rng(seed)), shown)
        assert shown.shape == (*SIZE, 3)
        assert shown.dtype == np.uint8
        assert shown.flags.c_contiguous
    assert len({shown.tobytes() for shown in first}) == 20


def test_mirrored_always_and_half_of_the_time():
    shown = noise()
    for seed in range(20):
        np.testing.assert_array_equal(augment(shown, options(flip=1), rng(seed)), shown[:, ::-1])
    mirrored = [not np.array_equal(augment(shown, options(flip=0.5), rng(seed)), shown) for seed in range(400)]
    assert 160 < sum(mirrored) < 240  # 4 standard deviations about 200


def test_erased_is_one_rectangle_within_its_bounds():
    shown = noise(low=200)  # no pixel of the mean colour
    areas, aspects, places = [], [], []
    for seed in range(300):
        found = augment(shown, options(erasing=1), rng(seed))
        changed = (found != shown).any(axis=2)
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        assert changed.sum() == (bottom - top) * (right - left), "a rectangle, whole"
        assert (np.abs(found[changed].astype(int) - MEAN) <= 1).all()
        # Half a pixel of rounding on each side.
        height, width = bottom - top, right - left
        assert (height - 0.5) * (width - 0.5) <= ERASED_AREA[1] * shown[..., 0].size
        assert (height + 0.5) * (width + 0.5) >= ERASED_AREA[0] * shown[..., 0].size
        assert (height - 0.5) / (width + 0.5) <= ERASED_ASPECT[1]
        assert (height + 0.5) / (width - 0.5) >= ERASED_ASPECT[0]
        areas.append(changed.mean())
        aspects.append(height / width)
        places.append((top, left))
    assert min(areas) < 0.05
    assert max(areas) > 0.3
    assert min(aspects) < 0.5
    assert max(aspects) > 2
    assert len(set(places)) > 200


@pytest.mark.parametrize("size", [(16, 16), (3, 40), (40, 3)])
def test_small_pictures_are_erased_within_themselves(size):
    shown = np.full((*size, 3), 255, np.uint8)
    for seed in range(100):
        found = augment(shown, options(erasing=1, shift=0.5, flip=0.5, colour=1), rng(seed))
        assert found.shape == shown.shape


def test_erased_as_often_as_asked_for():
    shown = noise(low=200)
    erased = [not np.array_equal(augment(shown, options(erasing=0.25), rng(seed)), shown) for seed in range(400)]
    assert 65 < sum(erased) < 135  # 4 standard deviations about 100


def test_shifted_by_no_more_than_asked_for():
    shown = noise(low=200)
    offsets = set()
    most = round(0.1 * SIZE[0])
    for seed in range(300):
        found = augment(shown, options(shift=0.1), rng(seed)).astype(int)
        matches = [
            (down, right)
            for down in range(-most, most + 1)
            for right in range(-most, most + 1)
            if np.array_equal(
                found[max(0, -down) : SIZE[0] - max(0, down), max(0, -right) : SIZE[1] - max(0, right)],
                shown[max(0, down) : SIZE[0] - max(0, -down), max(0, right) : SIZE[1] - max(0, -right)],
            )
        ]
        assert len(matches) == 1
        down, right = matches[0]
        outside = np.ones(SIZE, bool)
        outside[max(0, -down) : SIZE[0] - max(0, down), max(0, -right) : SIZE[1] - max(0, right)] = False
        assert (np.abs(found[outside] - MEAN) <= 1).all()
        offsets.add(matches[0])
    assert {down for down, _ in offsets} == {right for _, right in offsets} == set(range(-most, most + 1))


def test_colour_changes_by_no_more_than_asked_for():
    """Of a picture of one colour the contrast is nothing: what is left is brightness times each channel's gain."""
    most = 0.2
    shown = np.full((*SIZE, 3), 100, np.uint8)
    found = np.array([augment(shown, options(colour=most), rng(seed))[0, 0] for seed in range(400)]) / 100
    assert found.min() >= (1 - most) * (1 - most / 2) - 0.005
    assert found.max() <= (1 + most) * (1 + most / 2) + 0.005
    assert found.min() < 0.8
    assert found.max() > 1.2
    ratio = found.max(axis=1) / found.min(axis=1)
    assert ratio.max() <= (1 + most / 2) / (1 - most / 2) + 0.02
    assert ratio.max() > 1.1, "the channels have gains of their own"


def test_colour_is_a_straight_line_about_the_mean():
    """Brightness, contrast and gain as described, worked out pixel by pixel."""
    shown = noise(low=80, high=160)
    for seed in range(20):
        draws = rng(seed)
        brightness, contrast = draws.uniform(-0.2, 0.2, 2)
        gain = 1 + draws.uniform(-0.1, 0.1, 3)
        middle = shown.mean()
        wanted = ((shown - middle) * (1 + contrast) + middle) * (1 + brightness) * gain
        found = augment(shown, options(colour=0.2), rng(seed))
        np.testing.assert_allclose(found, wanted.clip(0, 255), atol=0.51)


def test_what_is_too_bright_stays_white():
    shown = np.full((*SIZE, 3), 250, np.uint8)
    found = [augment(shown, options(colour=1), rng(seed)) for seed in range(50)]
    assert max(one.max() for one in found) == 255
    assert all((one[0, 0] == one).all() for one in found)
