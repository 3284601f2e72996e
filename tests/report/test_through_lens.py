"""Lines of the world in a picture: where the camera projects them, and nowhere else."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.core.cameras import Camera, Lens, Pose
from passerby.report.through_lens import View, simplify_polyline, spacing_of
from support.report.drawings import distance_to

LENSES = {
    "pinhole": Lens((1280, 720), np.array([[800.0, 0, 639.5], [0, 800.0, 359.5], [0, 0, 1]]), np.zeros(0)),
    "barrel": Lens(
        (1280, 720), np.array([[600.0, 0, 650.0], [0, 610.0, 350.0], [0, 0, 1]]),
        np.array([-0.25, 0.08, 0.001, -0.001, -0.008]),
    ),
    "fisheye": Lens(
        (1000, 1000), np.array([[320.0, 0, 499.5], [0, 320.0, 499.5], [0, 0, 1]]), np.array([0.02, -0.01, 0.003, 0.0]),
        fisheye=True,
    ),
}  # fmt: skip


def looking(lens, height=3.0, pitch=20.0, roll=5.0):
    """A camera above the origin that looks along y and down."""
    ahead = Rotation.from_euler("x", -90 - pitch, degrees=True).as_matrix()
    R_cw = Rotation.from_euler("z", roll, degrees=True).as_matrix() @ ahead
    return Camera("C", lens, Pose.from_centre(R_cw, np.array([0.0, 0.0, height])))


def lines():
    """Lines of the ground around the camera, some behind it, some far away."""
    along = np.arange(-40.0, 41.0, 4.0)
    begin = [(x, -60.0, 0.0) for x in along] + [(-60.0, y, 0.0) for y in along]
    end = [(x, 120.0, 0.0) for x in along] + [(120.0, y, 0.0) for y in along]
    return np.array(begin), np.array(end)


@pytest.mark.parametrize("kind", LENSES)
@pytest.mark.parametrize("pitch", [-5.0, 20.0, 70.0])
def test_lines_are_where_the_camera_projects_them(kind, pitch):
    camera = looking(LENSES[kind], pitch=pitch)
    view, (begin, end) = View(camera), lines()
    drawn = view.segments(begin, end)
    share = np.linspace(0, 1, 1501)[:, None]
    covered = 0
    for a, b, stretches in zip(begin, end, drawn, strict=True):
        pixels, inside = view.points(a + share * (b - a))
        assert np.allclose(pixels[inside], camera.project(a + share[inside] * (b - a)))
        covered += np.count_nonzero(inside)
        if np.count_nonzero(inside) > 5:
            away = np.min([distance_to(pixels[inside], one) for one in stretches], axis=0)
            assert away.max() < 0.5
        for one in stretches:
            assert (one >= -0.5 - 1e-3).all()
            assert (one <= np.array(camera.lens.size) - 0.5 + 1e-3).all()
            # Back through the lens every corner lies on the line again.
            ray = camera.lens.bearings(np.clip(one, -0.5, np.array(camera.lens.size) - 0.5)) @ camera.pose.R_cw
            normal = np.cross(a - camera.centre, b - camera.centre)
            assert np.abs(ray @ normal / np.linalg.norm(normal)).max() < 1e-4
    assert covered > 50


def test_lines_end_at_the_border_and_do_not_fold_back():
    camera = looking(LENSES["barrel"], pitch=10.0)
    view = View(camera)
    ends = [stroke[k] for line in view.segments(*lines()) for stroke in line for k in (0, -1)]
    size = np.array(camera.lens.size)
    on_border = np.min([np.abs(np.array(ends) + 0.5).min(axis=1), np.abs(np.array(ends) - size + 0.5).min(axis=1)], axis=0)
    world = [view.points(point)[0] for point in lines()]
    own = np.min(
        [np.linalg.norm(np.array(ends)[:, None] - np.nan_to_num(one, nan=1e6), axis=2).min(axis=1) for one in world], axis=0
    )
    assert np.minimum(on_border, own).max() < 0.05
    # Far outside the view the polynomial folds: the pixel is in the picture, the point is not.
    tan = np.linspace(0.5, 4.0, 400)
    rays = np.column_stack([tan, np.zeros(400), np.ones(400)])
    pixels, inside = view.seen(rays)
    within = ((pixels >= 0) & (pixels <= size)).all(axis=1)
    assert np.count_nonzero(within & ~inside) > 20
    assert inside[0]


@pytest.mark.parametrize("kind", LENSES)
def test_the_horizon_is_where_level_rays_go(kind):
    camera = looking(LENSES[kind], pitch=8.0, roll=12.0)
    for stroke in View(camera).horizon():
        rays = camera.lens.bearings(np.clip(stroke, -0.5, np.array(camera.lens.size) - 0.5)) @ camera.pose.R_cw
        assert np.abs(rays[:, 2]).max() < 1e-3
    assert sum(len(stroke) for stroke in View(camera).horizon()) >= 2
    assert View(looking(LENSES["pinhole"], pitch=80.0)).horizon() == []


def test_straight_lines_lose_their_corners():
    line = np.column_stack([np.linspace(0, 100, 50), np.linspace(0, 30, 50)])
    assert len(simplify_polyline(line)) == 2
    angle = np.linspace(0, np.pi, 200)
    arc = 100 * np.column_stack([np.cos(angle), np.sin(angle)])
    kept = simplify_polyline(arc, 0.5)
    assert 8 < len(kept) < 40
    assert distance_to(arc, kept).max() <= 0.5


def test_grids_stay_coarse_enough():
    assert spacing_of(10) == 1
    assert spacing_of(30) == 2
    assert spacing_of(130) == 10
    assert spacing_of(1e9) == 500
