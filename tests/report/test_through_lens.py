"""Lines of the world in a picture: where the camera projects them, and nowhere else."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.core.cameras import Camera, Lens, Pose
from passerby.report.through_lens import View, simplify_polyline, spacing_of
from support.report.svg import distance_to
from support.tiers import thinned


def lens(size, fx, fy, x, y, *distortions, fisheye=False):
    return Lens(size, np.array([[fx, 0, x], [0, fy, y], [0, 0, 1]]), np.array(distortions), fisheye=fisheye)


WIDE = (1280, 720)
LENSES = {
    "pinhole": lens(WIDE, 800.0, 800.0, 639.5, 359.5),
    "barrel": lens(WIDE, 600.0, 610.0, 650.0, 350.0, -0.25, 0.08, 0.001, -0.001, -0.008),
    "fisheye": lens((1000, 1000), 320.0, 320.0, 499.5, 499.5, 0.02, -0.01, 0.003, 0.0, fisheye=True),
}
TURNING = lens(WIDE, 560.0, 560.0, 639.5, 359.5, -0.3, 0.0, 0.0, 0.0)
"""One coefficient, as of a lens without a calibration: it turns over within the picture."""
ALL = {**LENSES, "turning over": TURNING}


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


@pytest.mark.slow
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
    world = [np.nan_to_num(view.points(point)[0], nan=1e6) for point in lines()]
    own = np.min([np.linalg.norm(np.array(ends)[:, None] - one, axis=2).min(axis=1) for one in world], axis=0)
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


@pytest.mark.parametrize("kind", ALL)
@thinned("pitch", [20.0, -10.0, 75.0])
def test_vertical_edges_lie_along_the_plumb_lines(kind, pitch):
    camera = looking(ALL[kind], pitch=pitch)
    step = np.deg2rad(10)
    drawn = [stroke for line in View(camera).verticals(step) for stroke in line]
    assert len(drawn) > 4
    headings = []
    for stroke in drawn:
        rays = camera.lens.bearings(np.clip(stroke, -0.5, np.array(camera.lens.size) - 0.5)) @ camera.pose.R_cw
        off = (np.arctan2(rays[:, 1], rays[:, 0]) - np.pi / 2) / step
        assert (np.abs(off - np.rint(off)) * step * np.hypot(rays[:, 0], rays[:, 1]) < 1e-3).all()
        assert (np.diff(rays[:, 2]) > 0).all(), "from below upwards, without turning back"
        headings.append(int(np.rint(off[0])))
    # Posts on the ground, near and far, wherever they are seen.
    seen = 0
    for heading in range(36):
        for metres in (2.0, 9.0):
            x, y = -metres * np.sin(heading * step), metres * np.cos(heading * step)
            post = np.column_stack([np.full((50, 2), (x, y)), np.linspace(0, 3, 50)])
            pixels, inside = View(camera).points(post)
            steep = np.abs(np.arctan2(post[:, 2] - 3.0, metres)) < np.deg2rad(88)
            pixels = pixels[inside & steep]
            if len(pixels):
                seen += len(pixels)
                assert np.min([distance_to(pixels, stroke) for stroke in drawn], axis=0).max() < 0.5
    assert seen > 100


def test_nothing_is_drawn_where_the_lens_turned_over():
    camera = looking(TURNING, pitch=10.0)
    # No ray of it leads beyond this radius.
    rim = 560 * (2 / 3) / np.sqrt(3 * 0.3)
    view = View(camera)
    lines = [*view.horizon(), *(stroke for line in view.verticals(np.deg2rad(5)) for stroke in line)]
    radius = np.linalg.norm(np.concatenate(lines) - camera.lens.matrix[:2, 2], axis=1)
    assert rim - 5 < radius.max() < rim + 0.01


def test_straight_lines_lose_their_corners_and_grids_stay_coarse_enough():
    assert len(simplify_polyline(np.column_stack([np.linspace(0, 100, 50), np.linspace(0, 30, 50)]))) == 2
    angle = np.linspace(0, np.pi, 200)
    arc = 100 * np.column_stack([np.cos(angle), np.sin(angle)])
    kept = simplify_polyline(arc, 0.5)
    assert 8 < len(kept) < 40
    assert distance_to(arc, kept).max() <= 0.5
    assert [spacing_of(metres) for metres in (10, 30, 130, 1e9)] == [1, 2, 10, 500]
