"""Pictures are varied as far as the options say and no further."""

import numpy as np
import pytest

from passerby.training.options import TrainOptions
from passerby.training.pictures import augment

NONE = {"flip": 0.0, "shift": 0.0, "erasing": 0.0, "colour": 0.0}
SIZE = (64, 32)
MEAN = np.array([104, 116, 124])
"""Blue, green and red of ImageNet's mean."""


def varied(shown, draws, **chosen):
    options = TrainOptions(**{**NONE, **chosen})
    return [augment(shown, options, rng(seed)) for seed in range(draws)]


def noise(seed=0, low=0, high=256):
    return np.random.default_rng(seed).integers(low, high, (*SIZE, 3)).astype(np.uint8)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_the_same_draws_give_the_same_picture_and_the_one_given_stays():
    shown, chosen = noise(), {"flip": 0.5, "shift": 0.08, "erasing": 0.5, "colour": 0.2}
    first, again = varied(shown, 20, **chosen), varied(shown, 20, **chosen)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
        assert (one.shape, one.dtype, one.flags.c_contiguous) == ((*SIZE, 3), np.uint8, True)
    assert len({one.tobytes() for one in first}) == 20
    np.testing.assert_array_equal(shown, noise())
    np.testing.assert_array_equal(varied(shown, 20), [shown] * 20, "nothing is asked for")


@pytest.mark.parametrize(("what", "share"), [("flip", 0.5), ("erasing", 0.25)])
def test_mirrored_and_erased_as_often_as_asked_for(what, share):
    shown = noise(low=200)
    changed = sum(not np.array_equal(one, shown) for one in varied(shown, 400, **{what: share}))
    assert abs(changed - 400 * share) < 4 * np.sqrt(400 * share * (1 - share))  # standard deviations
    np.testing.assert_array_equal(varied(shown, 20, flip=1), [shown[:, ::-1]] * 20, "always")


def test_erased_is_one_rectangle_within_its_bounds():
    shown = noise(low=200)  # no pixel of the mean colour
    areas, aspects, places = [], [], set()
    for found in varied(shown, 300, erasing=1):
        changed = (found != shown).any(axis=2)
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        height, width = np.ptp(rows) + 1, np.ptp(columns) + 1
        assert changed.sum() == height * width, "a rectangle, whole"
        assert (np.abs(found[changed].astype(int) - MEAN) <= 1).all()
        # Half a pixel of rounding on each side.
        assert (height - 0.5) * (width - 0.5) <= 0.4 * changed.size
        assert (height + 0.5) * (width + 0.5) >= 0.02 * changed.size
        assert (height - 0.5) / (width + 0.5) <= 3.33
        assert (height + 0.5) / (width - 0.5) >= 0.3
        areas.append(changed.mean())
        aspects.append(height / width)
        places.add((rows[0], columns[0]))
    assert min(areas) < 0.05 < 0.3 < max(areas)
    assert min(aspects) < 0.5 < 2 < max(aspects)
    assert len(places) > 200
    for size in ((16, 16), (3, 40), (40, 3)):
        small = np.full((*size, 3), 255, np.uint8)
        assert {one.shape for one in varied(small, 100, erasing=1, shift=0.5, flip=0.5, colour=1)} == {small.shape}


def test_shifted_by_no_more_than_asked_for():
    shown, most = noise(low=200), round(0.1 * SIZE[0])
    offsets, ways = set(), range(-most, most + 1)

    def part(*shift):
        return tuple(slice(max(0, by), length - max(0, -by)) for length, by in zip(SIZE, shift, strict=True))

    for found in varied(shown, 300, shift=0.1):
        ((down, right),) = [
            (down, right)
            for down in ways
            for right in ways
            if np.array_equal(found[part(-down, -right)], shown[part(down, right)])
        ]
        outside = np.ones(SIZE, bool)
        outside[part(-down, -right)] = False
        assert (np.abs(found[outside].astype(int) - MEAN) <= 1).all()
        offsets.add((down, right))
    assert {down for down, _ in offsets} == {right for _, right in offsets} == set(ways)


def test_colour_is_a_straight_line_about_the_mean():
    """Brightness, contrast and each channel's gain as described, worked out pixel by pixel."""
    shown = noise(low=80, high=160)
    for seed, found in enumerate(varied(shown, 20, colour=0.2)):
        draws = rng(seed)
        brightness, contrast = draws.uniform(-0.2, 0.2, 2)
        gain = 1 + draws.uniform(-0.1, 0.1, 3)
        wanted = ((shown - shown.mean()) * (1 + contrast) + shown.mean()) * (1 + brightness) * gain
        np.testing.assert_allclose(found, wanted.clip(0, 255), atol=0.51)
    found = varied(np.full((*SIZE, 3), 250, np.uint8), 50, colour=1)
    assert max(one.max() for one in found) == 255, "what is too bright stays white"
    assert all((one[0, 0] == one).all() for one in found)
