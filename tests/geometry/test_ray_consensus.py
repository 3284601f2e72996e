"""Agreement of sightings under a known rig."""

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.geometry import ray_consensus
from passerby.geometry.ray_consensus import Consensus, misses_by_instant, reassign_outliers, vote_points
from support.scenes.exact_sightings import poses_of
from support.scenes.people_and_rigs import ring

N = 30
GROUND = 0.9
TOLERANCE = 10.0


def run(rig: Rig, camera: np.ndarray, *seen: np.ndarray, height: tuple[float, float] | None = None) -> Consensus:
    """The vote of sightings: camera, block, ray and tangent."""
    return vote_points(camera, *seen, np.full(len(camera), TOLERANCE), N, *poses_of(rig), height=height)


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


def test_exchanged_people_are_thrown_out_of_one_camera_only_and_exchanged_back() -> None:
    rig = ring(4)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(1))
    # Only people who stand apart: within the tolerance an exchange is none.
    a, b = 0, int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
    rows = [2 * N + a, 2 * N + b]
    bearing[rows], tangent[rows] = bearing[rows[::-1]], tangent[rows[::-1]]
    found = run(rig, camera, block, bearing, tangent)
    np.testing.assert_array_equal(np.flatnonzero(~found.inlier), rows)
    np.testing.assert_allclose(found.points, points, atol=0.05)
    # At another instant no person may be taken over.
    for instant, whose in ((np.zeros(N, dtype=int), [b, a]), (np.arange(N), [-1, -1])):
        expected = block.copy()
        expected[rows] = whose
        tolerance = np.full(len(camera), TOLERANCE)
        given = reassign_outliers(found, camera, block, instant[block], instant, bearing, tangent, tolerance, *poses_of(rig))
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


def test_a_third_of_wrong_sightings_is_borne() -> None:
    rig, rng = ring(6), np.random.default_rng(2)
    points, camera, block, bearing, tangent = case(rig, rng)
    wrong = np.zeros(len(camera), dtype=bool)
    for person in range(N):
        wrong[rng.choice(6, 2, replace=False) * N + person] = True
    false = rig.cameras[0].lens.bearings(rng.uniform((0, 0), (1280, 720), (int(wrong.sum()), 2)))
    bearing[wrong], tangent[wrong] = false, rig.cameras[0].lens.tangents(false)
    found = run(rig, camera, block, bearing, tangent)
    assert found.inlier[~wrong].mean() > 0.99
    assert found.inlier[wrong].mean() < 0.05
    assert np.median(np.linalg.norm(found.points - points, axis=1)) < 0.03


def test_no_point_is_where_rays_are_alone_or_do_not_meet_or_meet_behind_their_cameras() -> None:
    """Block 4: rays up into the sky, sideways and into the ground. Block 7: one ray. Block 8: none. Block 9: backwards."""
    rig = ring(3)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(3))
    for c, pixel in enumerate([(640.0, 5.0), (20.0, 700.0), (1260.0, 20.0)]):
        ray = rig.cameras[c].lens.bearings(np.array([pixel]))
        bearing[c * N + 4], tangent[c * N + 4] = ray[0], rig.cameras[c].lens.tangents(ray)[0]
    bearing[block == 9] *= -1.0
    kept = ~((block == 7) & (camera > 0)) & (block != 8) & ~((block == 9) & (camera == 2))
    found = run(rig, camera[kept], block[kept], bearing[kept], tangent[kept])
    nowhere = np.isin(np.arange(N), [4, 7, 8, 9])
    assert np.isnan(found.points[nowhere]).all()
    assert not found.inlier[nowhere[block[kept]]].any()
    np.testing.assert_allclose(found.points[~nowhere], points[~nowhere], atol=0.06)
    assert np.isnan(run(rig, camera[:0], block[:0], bearing[:0], tangent[:0]).points).all()


def test_the_expected_height_decides_between_two_pairs() -> None:
    """Of four cameras two see a bird above and two a person below: votes are equal, the height is not."""
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


def test_misses_are_the_pixels_between_each_sighting_and_all_points_of_its_instant() -> None:
    """Each pair comes once and in order; a point that is missing meets no sighting."""
    rig = ring(3)
    points, camera, block, bearing, tangent = case(rig, np.random.default_rng(7), noise_px=3.0)
    points[4] = np.nan
    R, centre = poses_of(rig)
    of_point = np.arange(N) % 4
    instant = of_point[block]
    instant[camera == 2] = 9  # at which there is no point
    parts = misses_by_instant(points, of_point, camera, instant, bearing, tangent, R, centre)
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


def test_parts_of_another_size_give_the_same_people_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many sightings with wrong names at one instant go to the same people, however few pairs are looked at at once."""
    rig, rng = ring(4), np.random.default_rng(8)
    _, camera, block, bearing, tangent = case(rig, rng)
    named = block.copy()
    wrong = np.flatnonzero((camera == 3) & (block % 2 == 0))
    named[wrong] = np.roll(named[wrong], 1)
    consensus = run(rig, camera, named, bearing, tangent)
    same, tolerance = np.zeros(N, dtype=int), np.full(len(camera), TOLERANCE)
    given = (consensus, camera, named, same[named], same, bearing, tangent, tolerance, *poses_of(rig))
    found = reassign_outliers(*given)
    assert np.count_nonzero(found[wrong] == block[wrong]) > len(wrong) / 2
    monkeypatch.setattr(ray_consensus, "STEP", 50)
    np.testing.assert_array_equal(reassign_outliers(*given), found)
