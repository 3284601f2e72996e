"""Agreement of sightings under a known rig."""

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.geometry import ray_consensus
from passerby.geometry.ray_consensus import Consensus, misses_by_instant, reassign_outliers, vote_points
from support.scenes.people_and_rigs import ring

N = 30
GROUND = 0.9
TOLERANCE = 10.0


def poses(rig: Rig) -> list[np.ndarray]:
    return [np.array([getattr(camera.pose, name) for camera in rig]) for name in ("R_cw", "centre")]


def run(rig: Rig, camera: np.ndarray, *seen: np.ndarray, height: tuple[float, float] | None = None) -> Consensus:
    """The vote of sightings: camera, block, ray and tangent."""
    return vote_points(camera, *seen, np.full(len(camera), TOLERANCE), N, *poses(rig), height=height)


def case(rig: Rig, rng: np.random.Generator, noise_px: float = 1.0) -> tuple[np.ndarray, ...]:
    """(N, 3) points, and camera, block, ray and tangent of each sighting; every camera sees every point."""
    points = np.column_stack([rng.uniform(-2.5, 2.5, (N, 2)), np.full(N, GROUND)])
    camera, block = (grid.ravel() for grid in np.meshgrid(np.arange(len(rig)), np.arange(N), indexing="ij"))
    rays = []
    for item in rig:
        pixels = item.project(points)
        rays.append(item.lens.bearings(pixels + noise_px * rng.normal(size=pixels.shape)))
    bearing = np.concatenate(rays)
    return points, camera, block, bearing, rig.cameras[0].lens.tangents(bearing)


def test_exchanged_people_are_thrown_out_of_one_camera_only_and_go_back_to_whom_they_show() -> None:
    rig = ring(4)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(1))
    # Only people who stand apart: within the tolerance an exchange is none.
    a, b = 0, int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
    rows = [2 * N + a, 2 * N + b]
    bearing[rows], tangent[rows] = bearing[rows[::-1]], tangent[rows[::-1]]
    found = run(rig, camera, block, bearing, tangent)
    np.testing.assert_array_equal(np.flatnonzero(~found.inlier), rows)
    np.testing.assert_allclose(found.points, points, atol=0.05)
    # At another instant nobody may be taken over.
    for instant, whose in ((np.zeros(N, dtype=int), [b, a]), (np.arange(N), [-1, -1])):
        expected = block.copy()
        expected[rows] = whose
        tolerance = np.full(len(camera), TOLERANCE)
        given = reassign_outliers(found, camera, block, instant[block], instant, bearing, tangent, tolerance, *poses(rig))
        np.testing.assert_array_equal(given, expected)


def test_one_of_four_who_sees_another_head_is_left_out() -> None:
    """All four sightings are within the tolerance of a place between the heads, but not of each other."""
    rig = ring(4)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(4), noise_px=0.0)
    points[0] = [0.0, 0.0, GROUND]
    above = points[:1] + [0.0, 0.0, 1.25 * TOLERANCE * 8.0 / rig.cameras[0].lens.focal]
    for c, item in enumerate(rig):
        bearing[c * N] = item.lens.bearings(item.project(points[:1] if c < 3 else above))[0]
    tangent = rig.cameras[0].lens.tangents(bearing)
    between = 0.75 * points[0] + 0.25 * above[0]
    for c, item in enumerate(rig):
        off = np.linalg.norm(item.project(between[None]) - item.project(points[:1] if c < 3 else above))
        assert off < TOLERANCE
    found = run(rig, camera, block, bearing, tangent)
    np.testing.assert_array_equal(np.flatnonzero(~found.inlier), [3 * N])
    np.testing.assert_allclose(found.points[0], points[0], atol=1e-6)
    np.testing.assert_allclose(found.points[1:], points[1:], atol=1e-6)


def test_rays_that_meet_behind_their_cameras_do_not_agree() -> None:
    rig = ring(4)
    _, camera, block, bearing, tangent = case(rig, np.random.default_rng(5), noise_px=0.0)
    two = (block == 0) & (camera < 2)
    others = block > 0
    bearing[two] *= -1.0
    seen = two | others
    found = run(rig, camera[seen], block[seen], bearing[seen], tangent[seen])
    assert np.isnan(found.points[0]).all()
    assert not found.inlier[block[seen] == 0].any()
    assert np.isfinite(found.points[1:]).all()


def test_a_third_of_wrong_sightings_is_borne() -> None:
    rig, rng = ring(6), np.random.default_rng(2)
    points, camera, block, bearing, tangent = case(rig, rng)
    wrong = np.zeros(len(camera), dtype=bool)
    for person in range(N):
        wrong[rng.choice(6, 2, replace=False) * N + person] = True
    astray = rig.cameras[0].lens.bearings(rng.uniform((0, 0), (1280, 720), (int(wrong.sum()), 2)))
    bearing[wrong], tangent[wrong] = astray, rig.cameras[0].lens.tangents(astray)
    found = run(rig, camera, block, bearing, tangent)
    assert found.inlier[~wrong].mean() > 0.99
    assert found.inlier[wrong].mean() < 0.05
    assert np.median(np.linalg.norm(found.points - points, axis=1)) < 0.03


def test_where_nothing_agrees_there_is_no_point() -> None:
    rig = ring(3)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(3))
    # Block 4: one ray up into the sky, one sideways, one into the ground.
    for c, pixel in enumerate([(640.0, 5.0), (20.0, 700.0), (1260.0, 20.0)]):
        ray = rig.cameras[c].lens.bearings(np.array([pixel]))
        bearing[c * N + 4], tangent[c * N + 4] = ray[0], rig.cameras[c].lens.tangents(ray)[0]
    found = run(rig, camera, block, bearing, tangent)
    assert np.isnan(found.points[4]).all()
    assert not found.inlier[block == 4].any()
    others = np.arange(N) != 4
    np.testing.assert_allclose(found.points[others], points[others], atol=0.06)


def test_one_sighting_alone_and_no_sighting_at_all_are_no_point() -> None:
    rig = ring(3)
    _, camera, block, bearing, tangent = case(rig, np.random.default_rng(4))
    keep = ~((block == 7) & (camera > 0)) & (block != 8)
    found = run(rig, camera[keep], block[keep], bearing[keep], tangent[keep])
    assert np.isnan(found.points[[7, 8]]).all()
    assert np.isfinite(found.points[[6, 9]]).all()
    assert not found.inlier[block[keep] == 7].any()
    none = run(rig, camera[:0], block[:0], bearing[:0], tangent[:0])
    assert np.isnan(none.points).all()


def test_the_expected_height_decides_between_two_pairs() -> None:
    """Four cameras, two of which see a bird above and two a person below: votes are equal, the height is not."""
    rig = ring(4)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(5), noise_px=0.0)
    birds = points + (0.8, -0.5, 1.3)
    for c in (0, 2):
        rows = camera == c
        bearing[rows] = rig.cameras[c].lens.bearings(rig.cameras[c].project(birds))
        tangent[rows] = rig.cameras[c].lens.tangents(bearing[rows])
    seen = np.isfinite(bearing).all(axis=1)
    both = np.bincount(block[seen], minlength=N) == 4
    for height, expected in ((GROUND, points), (GROUND + 1.3, birds)):
        found = run(rig, camera[seen], block[seen], bearing[seen], tangent[seen], height=(height, 0.3))
        miss = np.linalg.norm(found.points - expected, axis=1)[both]
        assert np.mean(miss < 0.05) > 0.9, f"at {height} m"


def test_the_order_of_the_sightings_is_of_no_account() -> None:
    rig, rng = ring(4), np.random.default_rng(0)
    _, camera, block, bearing, tangent = case(rig, rng, noise_px=4.0)
    first = run(rig, camera, block, bearing, tangent)
    order = rng.permutation(len(camera))
    second = run(rig, camera[order], block[order], bearing[order], tangent[order])
    np.testing.assert_array_equal(first.inlier[order], second.inlier)
    np.testing.assert_allclose(first.points, second.points, atol=1e-9)


def test_points_of_an_instant_come_in_small_parts_with_those_of_a_sighting_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each sighting meets all points of its instant once, by the pixels between them; a point that is missing meets nobody."""
    rig = ring(3)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(7), noise_px=3.0)
    points[4] = np.nan
    R, centre = poses(rig)
    of_point = np.arange(N) % 4
    instant = of_point[block]
    instant[camera == 2] = 9  # at which there is no point
    monkeypatch.setattr(ray_consensus, "STEP", 20)
    parts = list(misses_by_instant(points, of_point, camera, instant, bearing, tangent, R, centre))
    assert len(parts) > 20
    most = np.bincount(of_point).max()
    assert all(0 < len(sighting) <= 20 + most for sighting, _, _ in parts)
    whole = [set(sighting.tolist()) for sighting, _, _ in parts]
    assert sum(map(len, whole)) == len(set.union(*whole)), "no sighting is in two parts"
    sighting, point, miss = (np.concatenate(column) for column in zip(*parts, strict=True))
    expected = [(m, n) for m in range(len(camera)) for n in range(N) if of_point[n] == instant[m] and n != 4]
    assert list(zip(sighting.tolist(), point.tolist(), strict=True)) == expected
    for c, own in enumerate(rig):
        rows = np.flatnonzero(camera[sighting] == c)
        toward = (R[c] @ (points[point[rows]] - centre[c]).T).T
        along = np.einsum("mi,mi->m", bearing[sighting[rows]], toward)
        beside = np.einsum("mki,mi->mk", tangent[sighting[rows]], toward) / along[:, None]
        ahead = along > 0.5 * np.linalg.norm(toward, axis=1)  # behind a camera there are no pixels
        assert ahead.any() == (c < 2), own.name
        np.testing.assert_allclose(miss[rows][ahead], np.linalg.norm(beside, axis=1)[ahead], rtol=1e-9)


def test_parts_of_another_size_give_away_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many sightings with wrong names at one instant go to the same people, however few pairs are looked at at once."""
    rig, rng = ring(4), np.random.default_rng(8)
    _, camera, block, bearing, tangent = case(rig, rng)
    named = block.copy()
    wrong = np.flatnonzero((camera == 3) & (block % 2 == 0))
    named[wrong] = np.roll(named[wrong], 1)
    consensus = run(rig, camera, named, bearing, tangent)
    same, tolerance = np.zeros(N, dtype=int), np.full(len(camera), TOLERANCE)
    given = (consensus, camera, named, same[named], same, bearing, tangent, tolerance, *poses(rig))
    found = reassign_outliers(*given)
    assert np.count_nonzero(found[wrong] == block[wrong]) > len(wrong) / 2
    monkeypatch.setattr(ray_consensus, "STEP", 50)
    np.testing.assert_array_equal(reassign_outliers(*given), found)
