"""Whole scenes: areas, cameras, lenses, motion and boxes as declared."""

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose
from passerby.simulation import PRESETS, SimulationOptions, simulate
from passerby.simulation.lenses import SHARED, TYPICAL, VARIED, before_fold, draw_lenses, fold_radius
from passerby.simulation.observe import find_whole_in_view
from support.scenes.simulated import edges_of, scene

PICTURE = (1280, 720)
PICTURES = {"terrace": (720, 576), "basketball": (720, 576), "construction": (1352, 760)}
EVERY_PRESET = pytest.mark.parametrize("preset", list(PRESETS))


def equal(first, second):
    for name in first.rig.names:
        a, b = first.observations[name], second.observations[name]
        if not np.array_equal(a.boxes.ltwh, b.boxes.ltwh) or not np.array_equal(a.boxes.identity, b.boxes.identity):
            return False
        if not np.array_equal(a.keypoints.xy, b.keypoints.xy):
            return False
    return True


@pytest.mark.slow
def test_same_options_give_the_same_scene_and_another_seed_another():
    options = {"box_noise": 0.02, "missing": 0.1, "identity_swaps": 0.2, "false_boxes": 0.1, "clock_offsets": 0.2}
    chosen = SimulationOptions(seconds=4.0, **options)
    assert equal(simulate(chosen), simulate(chosen))
    assert not equal(simulate(chosen), simulate(SimulationOptions(seconds=4.0, seed=1, **options)))


@pytest.mark.slow
def test_faults_do_not_change_cameras_motion_or_each_other():
    clean, faulty = scene(), scene(box_noise=0.05, missing=0.3, joint_noise_px=2.0, identity_swaps=0.3, clock_offsets=0.4)
    np.testing.assert_array_equal(clean.joints3d, faulty.joints3d)
    for a, b in zip(clean.rig, faulty.rig, strict=True):
        np.testing.assert_array_equal(a.centre, b.centre)
    noisy, thinned = edges_of(scene(box_noise=0.05), "C2"), edges_of(scene(box_noise=0.05, missing=0.3), "C2")
    both = np.isfinite(noisy) & np.isfinite(thinned)
    assert both.any()
    np.testing.assert_array_equal(noisy[both], thinned[both])


@EVERY_PRESET
def test_area_cameras_and_people_are_as_declared(preset):
    simulated, declared = scene(preset=preset), PRESETS[preset]
    ground = simulated.ground_positions[np.isfinite(simulated.ground_positions[..., 0])]
    half = np.array(declared.area_m) / 2
    assert (np.abs(ground) <= half).all()
    assert (np.ptp(ground, axis=0) > half).all()
    assert len(simulated.rig) == 4
    assert len(simulated.heights) == declared.people
    for camera in simulated.rig:
        assert camera.lens.size == PICTURES[preset]
        assert camera.centre[2] == pytest.approx(declared.camera_height_m, abs=0.06)
        assert (np.abs(camera.centre[:2]) > half).all()
        field = 2 * np.degrees(np.arctan(camera.lens.size[0] / 2 / camera.lens.focal))
        assert 60 <= field <= 75


@EVERY_PRESET
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_camera_sees_most_of_the_area(preset, seed):
    simulated = simulate(SimulationOptions(preset=preset, seed=seed, seconds=0.2))
    x, y = np.meshgrid(*[np.linspace(-side / 2, side / 2, 15) for side in PRESETS[preset].area_m])
    feet = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    for camera in simulated.rig:
        seen = np.ones(len(feet), dtype=bool)
        for up in (0.0, 1.72):
            pixels = np.nan_to_num(camera.project(feet + np.array([0, 0, up])), nan=-1.0)
            seen &= ((pixels > 0) & (pixels < camera.lens.size)).all(axis=1)
        assert seen.mean() > 0.75


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_any_number_of_cameras_stands_around_the_area_and_looks_in(count):
    simulated = scene(cameras=count, seconds=1.0, camera_height_m=4.0)
    assert simulated.rig.names == tuple(f"C{i + 1}" for i in range(count))
    centres = np.array([camera.centre for camera in simulated.rig])
    assert (np.abs(centres[:, :2]) / (np.array([7.0, 11.0]) / 2)).max(axis=1).min() > 1
    np.testing.assert_allclose(centres[:, 2], 4.0, atol=0.06)
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + 99 * np.eye(count)
    assert apart.min() > 2.5
    for camera in simulated.rig:
        pixel = camera.project(np.array([[0.0, 0.0, 0.8]]))[0]
        assert (np.abs(pixel - np.array(camera.lens.size) / 2) < 0.15 * np.array(camera.lens.size)).all()


@pytest.mark.slow
@EVERY_PRESET
def test_boxes_hold_the_projected_joints(preset):
    """Without noise and occlusion, every box that the picture does not cut holds the person's joints; feet and head end it."""
    simulated = scene(preset=preset, occlusion=False)
    checked = 0
    for camera in simulated.rig:
        edges = edges_of(simulated, camera.name)
        width, height = camera.lens.size
        whole = (edges[..., :2] > 0).all(-1) & (edges[..., 2] < width) & (edges[..., 3] < height)
        for frame, person in np.argwhere(whole):
            pixels = camera.project(simulated.joints3d[frame, person])
            left, top, right, bottom = edges[frame, person]
            assert (pixels > (left, top)).all()
            assert (pixels < (right, bottom)).all()
            # Ankles are 4 % of the height over the soles, eyes 5.5 % under the crown; a toe may point at the camera.
            assert bottom - pixels[15:17, 1].max() < 0.17 * (bottom - top)
            if simulated.upright[frame, person]:
                assert pixels[:5, 1].min() - top < 0.09 * (bottom - top)
            checked += 1
    assert checked > 500


@pytest.mark.slow
@EVERY_PRESET
def test_boxes_of_upright_people_tell_their_height(preset):
    """Foot ray to the true ground position, then the height at which the box's top passes over it."""
    simulated = scene(preset=preset, occlusion=False, seconds=20.0)
    ratios = []
    for camera in simulated.rig:
        edges = edges_of(simulated, camera.name)
        for frame, person in np.argwhere(simulated.upright & np.isfinite(edges[..., 0]) & (edges[..., 1] > 0)):
            ground = np.array([*simulated.ground_positions[frame, person], 0.0])
            rows = camera.project(ground + np.linspace(1.2, 2.3, 111)[:, None] * [0, 0, 1])[:, 1]
            reached = np.interp(-edges[frame, person, 1], -rows, np.linspace(1.2, 2.3, 111))
            ratios.append(reached / simulated.heights[int(simulated.identities[person])])
    assert 0.95 < np.median(ratios) < 1.01
    assert np.std(ratios) < 0.06


@pytest.mark.slow
def test_speeds_are_those_of_the_presets():
    def speeds(preset):
        simulated = scene(preset=preset, seconds=20.0)
        steps = np.linalg.norm(np.diff(simulated.ground_positions, axis=0), axis=-1) * simulated.options.fps
        return steps[np.isfinite(steps)]

    assert np.quantile(speeds("terrace"), 0.99) < 1.9
    assert 0.8 < np.median(speeds("terrace")) < 1.5
    assert 2.5 < np.quantile(speeds("basketball"), 0.95) < 4.2
    assert np.mean(speeds("construction") < 0.2) > 0.3


@pytest.mark.slow
def test_construction_people_crouch_about_a_third_of_the_time():
    shares = []
    for seed in range(3):
        simulated = simulate(SimulationOptions(preset="construction", seed=seed, cameras=1, occlusion=False))
        there = np.isfinite(simulated.ground_positions[..., 0])
        shares.append(1 - simulated.upright[there].mean())
    assert 0.25 < np.mean(shares) < 0.45


@pytest.mark.slow
def test_heights_follow_the_options():
    heights = np.array(list(scene(people=200, seconds=0.2, cameras=1).heights.values()))
    assert heights.mean() == pytest.approx(1.72, abs=0.02)
    assert heights.std() == pytest.approx(0.09, abs=0.015)
    tall = scene(people=50, seconds=0.2, cameras=1, person_height_mean_m=1.9, person_height_sd_m=0.0)
    np.testing.assert_allclose(list(tall.heights.values()), 1.9)


@pytest.mark.slow
def test_occlusion_takes_boxes_away_and_hides_joints():
    crowd = {"people": 40, "seconds": 2.0}
    hidden, free = scene(**crowd), scene(**crowd, occlusion=False)
    n_hidden, n_free = (sum(len(seen.boxes) for seen in one.observations.cameras.values()) for one in (hidden, free))
    assert 0.3 * n_free < n_hidden < 0.85 * n_free
    few, alone = scene(people=1), scene(people=1, occlusion=False)
    assert equal(few, alone)
    for name in hidden.rig.names:
        inside, whole = edges_of(hidden, name), edges_of(free, name)
        both = np.isfinite(inside[..., 0]) & np.isfinite(whole[..., 0])
        assert (inside[both][:, :2] >= whole[both][:, :2]).all()
        assert (inside[both][:, 2:] <= whole[both][:, 2:]).all()
        smaller = (inside[both] != whole[both]).any(axis=1)
        assert 0.05 < smaller.mean() < 0.6
        shown = hidden.observations[name].keypoints.score > 0
        assert shown.mean() < (free.observations[name].keypoints.score > 0).mean() - 0.05


@pytest.mark.slow
def test_the_nearer_person_hides_the_farther_one():
    """Of two people whose boxes overlap by more than 90 %, the one with the lower feet (the nearer) is still there."""
    crowd = {"people": 30, "seconds": 2.0}
    hidden, free = scene(**crowd), scene(**crowd, occlusion=False)
    lost_near = lost_far = 0
    for camera in free.rig:
        edges, kept = edges_of(free, camera.name), np.isfinite(edges_of(hidden, camera.name)[..., 0])
        distance = np.linalg.norm(free.ground_positions - camera.centre[:2], axis=-1)
        for frame in range(len(free.frames)):
            low = np.maximum(edges[frame, :, None, :2], edges[frame, None, :, :2])
            high = np.minimum(edges[frame, :, None, 2:], edges[frame, None, :, 2:])
            shared = np.prod(np.maximum(high - low, 0), axis=-1)
            mine = np.prod(edges[frame, :, 2:] - edges[frame, :, :2], axis=-1)
            np.fill_diagonal(shared, 0)
            nearest = np.nanargmin(distance[frame])
            lost_near += int(np.isfinite(edges[frame, nearest, 0]) and not kept[frame, nearest])
            behind = (shared / mine[:, None] > 0.9) & (distance[frame][:, None] > distance[frame][None, :] + 0.5)
            far = behind.any(axis=1)
            lost_far += int((far & ~kept[frame]).sum())
    assert lost_near == 0
    assert lost_far > 20


def test_clock_offsets_show_the_world_at_another_time():
    offset = 0.4  # two frames at 5 per second
    early = scene(people=1, occlusion=False)
    late = scene(people=1, occlusion=False, clock_offsets=(0.0, offset, 0.0, -offset))
    assert late.clock_offsets == {"C1": 0.0, "C2": offset, "C3": 0.0, "C4": -offset}
    for name, shift in (("C1", 0), ("C2", 2), ("C4", -2)):
        a, b = edges_of(early, name), edges_of(late, name)
        a, b = (a[shift:], b[: len(b) - shift]) if shift >= 0 else (a[:shift], b[-shift:])
        assert np.isfinite(a).mean() > 0.5
        np.testing.assert_allclose(a, b, atol=0.02)
    offsets = np.array(list(scene(cameras=20, people=1, seconds=1.0, clock_offsets=0.5).clock_offsets.values()))
    assert offsets[0] == 0
    assert np.abs(offsets).max() <= 0.5
    assert offsets.std() > 0.15


@pytest.mark.slow
def test_people_come_in_late_at_the_edge():
    simulated = scene(people=60, seconds=20.0, cameras=1, occlusion=False)
    there = np.isfinite(simulated.ground_positions[..., 0])
    late = ~there[0]
    assert 0.15 < late.mean() < 0.45
    assert there[-1].all()
    assert (np.diff(there.astype(int), axis=0) >= 0).all()


def drawn_lenses(kind, count=400):
    rng = np.random.default_rng(5)
    children = rng.spawn(count)
    lens_of = draw_lenses(kind, PICTURE, rng)
    return [lens_of(child) for child in children]


def test_varied_lenses_cover_their_ranges():
    lenses = drawn_lenses(VARIED)
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
def test_every_pixel_has_a_ray(kind):
    width, height = PICTURE
    corners = np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=np.float64)
    for lens in drawn_lenses(kind, 150):
        rays = lens.bearings(corners)
        assert np.isfinite(rays).all()
        assert before_fold(lens, rays).all()


def test_a_shared_lens_is_one_but_for_its_principal_point_and_no_lens_changes_cameras_and_people():
    rig = simulate(SimulationOptions(seconds=0.4, lenses=SHARED, seed=3)).rig
    first, *others = [camera.lens for camera in rig]
    for lens in others:
        assert lens.focal == first.focal
        assert lens.distortions.tolist() == first.distortions.tolist()
        assert lens.matrix[:2, 2].tolist() != first.matrix[:2, 2].tolist()
    another = simulate(SimulationOptions(seconds=0.4, lenses=SHARED, seed=4)).rig
    assert another["C1"].lens.focal != first.focal
    typical, varied = (simulate(SimulationOptions(seconds=1.0, lenses=kind)) for kind in (TYPICAL, VARIED))
    np.testing.assert_array_equal(typical.joints3d, varied.joints3d)
    for a, b in zip(typical.rig, varied.rig, strict=True):
        np.testing.assert_array_equal(a.centre, b.centre)
        assert a.lens.focal != b.lens.focal


def test_the_fold_is_where_the_image_radius_is_largest_and_beyond_it_no_person_is_seen():
    def lens(focal, *distortions, fisheye=False):
        return Lens(PICTURE, np.diag([focal, focal, 1.0]), np.array([*distortions, 0.0, 0.0]), fisheye)

    radii = np.linspace(0, 4, 40001)
    image = radii * (1 - 0.2 * radii**2 + 0.01 * radii**4)
    assert fold_radius(lens(1000.0, -0.2, 0.01)) == pytest.approx(radii[np.argmax(np.diff(image) < 0)], abs=1e-3)
    for never in (drawn_lenses(TYPICAL, 1)[0], lens(1000.0, 0.1, 0.0), lens(300.0, -0.1, 0.0, fisheye=True)):
        assert fold_radius(never) == np.inf
    # A lens of one negative coefficient shows what is far aside in the middle of the image, which no real lens does.
    lens = Lens(PICTURE, np.array([[640.0, 0, 640], [0, 640.0, 360], [0, 0, 1]]), np.array([-0.1, 0.0, 0.0, 0.0]))
    camera = Camera("C1", lens, Pose(np.eye(3), np.zeros(3)))
    aside, ahead, behind = [[3.1, 0.0, 1.0]], [[1.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]]
    ghost = camera.project(np.array(aside))[0]
    assert 0 < ghost[0] < PICTURE[0]
    assert find_whole_in_view(camera, np.array([aside, ahead, behind])).tolist() == [False, True, False]
