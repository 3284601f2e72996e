"""Lenses of simulated cameras: what they are drawn from, and that the people they show are where the lens shows them."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.lenses import SHARED, TYPICAL, VARIED, before_fold, draw_lenses, fold_radius
from passerby.simulation.observe import find_whole_in_view

PICTURE = (1280, 720)


def drawn(kind: str, count: int = 400) -> list[Lens]:
    rng = np.random.default_rng(5)
    children = rng.spawn(count)
    lens_of = draw_lenses(kind, PICTURE, rng)
    return [lens_of(child) for child in children]


def test_varied_lenses_cover_their_ranges() -> None:
    lenses = drawn(VARIED)
    widths = np.array([lens.focal / PICTURE[0] for lens in lenses])
    assert 0.5 <= widths.min() < 0.52
    assert 1.9 < widths.max() <= 2.0
    assert np.median(widths) == pytest.approx(1.0, abs=0.1)  # log-uniform: the middle of the logarithms
    k1 = np.array([lens.distortions[0] for lens in lenses])
    assert -0.30 <= k1.min() < -0.28
    assert 0.03 < k1.max() <= 0.05
    assert not any(lens.distortions[1:].any() for lens in lenses)
    off = np.array([lens.matrix[:2, 2] for lens in lenses]) - np.array(PICTURE) / 2
    assert np.abs(off).max() <= 0.01 * PICTURE[0]
    assert np.abs(off).max() > 0.009 * PICTURE[0]


@pytest.mark.parametrize("kind", [TYPICAL, VARIED, SHARED])
def test_every_pixel_has_a_ray(kind: str) -> None:
    width, height = PICTURE
    corners = np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=np.float64)
    for lens in drawn(kind, 150):
        rays = lens.bearings(corners)
        assert np.isfinite(rays).all()
        assert before_fold(lens, rays).all()


def test_a_shared_lens_is_one_but_for_its_principal_point() -> None:
    rig = simulate(SimulationOptions(seconds=0.4, lenses=SHARED, seed=3)).rig
    first, *others = [camera.lens for camera in rig]
    for lens in others:
        assert lens.focal == first.focal
        assert lens.distortions.tolist() == first.distortions.tolist()
        assert lens.matrix[:2, 2].tolist() != first.matrix[:2, 2].tolist()
    another = simulate(SimulationOptions(seconds=0.4, lenses=SHARED, seed=4)).rig
    assert another["C1"].lens.focal != first.focal


def test_lenses_change_neither_where_cameras_stand_nor_how_people_move() -> None:
    typical, varied = (simulate(SimulationOptions(seconds=1.0, lenses=kind)) for kind in (TYPICAL, VARIED))
    np.testing.assert_array_equal(typical.joints3d, varied.joints3d)
    for a, b in zip(typical.rig, varied.rig, strict=True):
        np.testing.assert_array_equal(a.centre, b.centre)
        assert a.lens.focal != b.lens.focal


def test_the_fold_is_where_the_image_radius_is_largest() -> None:
    def lens(focal: float, *distortions: float, fisheye: bool = False) -> Lens:
        return Lens(PICTURE, np.diag([focal, focal, 1.0]), np.array([*distortions, 0.0, 0.0]), fisheye)

    radii = np.linspace(0, 4, 40001)
    image = radii * (1 - 0.2 * radii**2 + 0.01 * radii**4)
    assert fold_radius(lens(1000.0, -0.2, 0.01)) == pytest.approx(radii[np.argmax(np.diff(image) < 0)], abs=1e-3)
    for never in (drawn(TYPICAL, 1)[0], lens(1000.0, 0.1, 0.0), lens(300.0, -0.1, 0.0, fisheye=True)):
        assert fold_radius(never) == np.inf


def test_who_is_beyond_the_fold_is_not_seen() -> None:
    """A lens of one negative coefficient shows what is far aside in the middle of the image, which no real lens does."""
    lens = Lens(PICTURE, np.array([[640.0, 0, 640], [0, 640.0, 360], [0, 0, 1]]), np.array([-0.1, 0.0, 0.0, 0.0]))
    camera = Camera("C1", lens, Pose(np.eye(3), np.zeros(3)))
    aside, ahead, behind = [[3.1, 0.0, 1.0]], [[1.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]]
    ghost = camera.project(np.array(aside))[0]
    assert 0 < ghost[0] < PICTURE[0]
    assert find_whole_in_view(camera, np.array([aside, ahead, behind])).tolist() == [False, True, False]
