"""Colours differ from the page, light and dark, and from each other."""

import itertools

import numpy as np
import pytest

from passerby.core.colours import CAMERA_COLOURS, NOBODY, PERSON_COLOURS, camera_colour, person_colour

# Machado, Oliveira, Fernandes 2009, full protanopia, deuteranopia and tritanopia, on linear sRGB.
SIGHTS = {
    "all": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour):
    values = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def contrast(colour, other):
    bright = sorted(float(TO_XYZ[1] @ linear(one)) + 0.05 for one in (colour, other))
    return bright[1] / bright[0]


def lab(colour, sight):
    x = TO_XYZ @ np.clip(np.array(SIGHTS[sight]) @ linear(colour), 0, 1) / (0.9505, 1.0, 1.089)
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_each_colour_is_readable_on_white_and_on_near_black():
    for colour in {*CAMERA_COLOURS, *PERSON_COLOURS, NOBODY}:
        assert min(contrast(colour, ground) for ground in ("#ffffff", "#111111")) >= 3, colour


@pytest.mark.parametrize("sight", SIGHTS)
@pytest.mark.parametrize(("colours", "least"), [(CAMERA_COLOURS, 18), (PERSON_COLOURS, 15)])
def test_any_two_colours_differ_for_every_kind_of_sight(colours, least, sight):
    apart = [np.linalg.norm(lab(a, sight) - lab(b, sight)) for a, b in itertools.combinations(colours, 2)]
    assert min(apart) >= least


def test_colours_repeat_and_an_unknown_person_has_one_of_its_own():
    assert camera_colour(len(CAMERA_COLOURS)) == camera_colour(0)
    assert person_colour(len(PERSON_COLOURS) + 3) == person_colour(3)
    assert person_colour(-1) == NOBODY not in PERSON_COLOURS
