"""Lenses in other models: what is held is held exactly, and what a fit says of itself is true."""

import re
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens
from passerby.interchange.formats import lens_models as lm
from passerby.interchange.formats.format import Losses
from support.tiers import thinned

SIZE = (1280, 720)
MATRIX = np.array([[900.0, 0, 652], [0, 911, 349], [0, 0, 1]])
RATIONAL = np.array([-0.21, 0.06, 0.0012, -0.0017, 0.01, 0.021, -0.012, 0.004])
PINHOLES = (lm.PINHOLE, lm.RADTAN_4, lm.RADTAN_5, lm.RATIONAL_8, lm.PRISM_12, lm.TILTED_14)


def lens_with(*coefficients, fisheye=False, matrix=MATRIX):
    return Lens(SIZE, matrix, np.array(coefficients), fisheye)


@pytest.mark.parametrize(
    ("coefficients", "first"),
    [
        ((), lm.PINHOLE),
        ((-0.2, 0, 0, 0, 0), lm.RADTAN_4),
        ((*RATIONAL[:4], 0.01), lm.RADTAN_5),
        (tuple(RATIONAL), lm.RATIONAL_8),
        ((*RATIONAL, 0, 0.001, 0, 0), lm.PRISM_12),
        ((*RATIONAL, 0, 0, 0, 0, 0, 0.01), lm.TILTED_14),
    ],
)
def test_the_simplest_model_that_holds_a_lens(coefficients, first):
    losses = Losses()
    lens, model = lm.express_lens(Camera("C", lens_with(*coefficients)), PINHOLES, losses)
    assert model is first
    assert losses.told == ()
    rays = np.random.default_rng(0).uniform((-0.6, -0.35, 1), (0.6, 0.35, 1), (50, 3))
    np.testing.assert_allclose(lens.project_rays(rays), lens_with(*coefficients).project_rays(rays), atol=1e-9)


SKEWED = MATRIX + np.array([[0, 30.0, 0], [0, 0, 0], [0, 0, 0]])


def fine_error(lens, other):
    """Over four times as many pixels across and down as fits are judged on."""
    across, down = (np.linspace(-0.5, length - 0.5, 4 * n) for length, n in zip(SIZE, lm.GRID, strict=True))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = lens.bearings(pixels)
    known = np.isfinite(rays).all(axis=1)
    if not other.fisheye:
        known &= rays[:, 2] >= np.cos(np.radians(lm.WIDEST_PINHOLE_DEG))
    return np.linalg.norm(other.project_rays(rays[known]) - lens.project_rays(rays[known]), axis=1).max()


@thinned("seed", range(6))
@pytest.mark.parametrize("model", [lm.PINHOLE, lm.RADTAN_5, lm.RATIONAL_8, replace(lm.RADTAN_4, one_focal=True, centred=True)])
def test_the_told_error_is_true_of_any_lens(seed, model):
    rng = np.random.default_rng(seed)
    skewed = MATRIX + np.array([[0, rng.uniform(1, 4), 0], [0, 0, 0], [0, 0, 0]])
    fisheye = np.diag([0.5, 0.5, 1]) @ MATRIX + np.array([[0, 0, 320], [0, 0, 175], [0, 0, 0]])
    for lens in (
        lens_with(matrix=skewed),
        lens_with(*RATIONAL * rng.uniform(0.7, 1.3, 8), *rng.normal(0, 0.001, 4), *rng.normal(0, 0.02, 2)),
        lens_with(*rng.normal(0, (0.02, 0.01, 0.003, 0.001)), fisheye=True, matrix=fisheye),
    ):
        losses = Losses()
        found, _ = lm.express_lens(Camera("C", lens), (model,), losses)
        stated = float(re.search(r"up to ([\d.e+-]+) px off", losses.told[0])[1])
        assert fine_error(lens, found) <= stated
        if model.one_focal:
            assert found.matrix[0, 0] == found.matrix[1, 1]
            assert found.matrix[:2, 2].tolist() == [639.5, 359.5]


@pytest.mark.parametrize(
    "model", [lm.RADTAN_5, replace(lm.PRISM_12, centred=True), replace(lm.TILTED_14, skew=True, one_focal=True)]
)
def test_derivatives_are_those_of_differences(model):
    lens = lm._drop_unsupported(lens_with(*RATIONAL, 1e-3, -1e-3, 5e-4, 2e-4, 0.01, -0.02, matrix=SKEWED), model)
    rays = np.random.default_rng(1).uniform((-0.6, -0.35, 1), (0.6, 0.35, 1.2), (30, 3))
    numbers = lm._numbers(lens, model)
    found = lm._slopes(lens, model, rays)
    assert found.shape == (60, numbers.size)
    for index, number in enumerate(numbers):
        step = np.zeros(numbers.size)
        step[index] = 1e-6 * max(1.0, abs(number))
        ahead, behind = (lm._lens(lens, model, numbers + sign * step).project_rays(rays).ravel() for sign in (1, -1))
        difference = (ahead - behind) / (2 * step[index])
        np.testing.assert_allclose(found[:, index], difference, atol=1e-4 * np.abs(difference).max())


def test_a_fit_that_fails_is_no_lens(monkeypatch):
    """Another model is tried then, or the caller reports the error."""

    def broken(*arguments, **named):
        raise np.linalg.LinAlgError("SVD did not converge")

    rays = lm.Rays.of(lens_with(*RATIONAL))
    assert lm.fit_lens_model(rays, lm.RADTAN_5, lens_with()) is not None
    monkeypatch.setattr(lm, "least_squares", broken)
    assert lm.fit_lens_model(rays, lm.RADTAN_5, lens_with()) is None


@pytest.mark.parametrize(("pixels", "told"), [(0.0123, "0.013"), (1.0, "1.1"), (123.4, "130"), (9.85, "10"), (0, "1e-09")])
def test_errors_are_rounded_up(pixels, told):
    assert lm._round_up(pixels) == told


def test_a_lens_without_any_ray_is_an_error():
    with pytest.raises(InputError, match=r"camera C: its lens .* cannot even be fitted"):
        lm.express_lens(Camera("C", lens_with(-3.0, 0, 0, 0, matrix=np.diag([30.0, 30, 1]))), (lm.PINHOLE,), Losses())
