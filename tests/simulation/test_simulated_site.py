"""A simulated site: its plan, who sees what, and that nothing but a camera's own surroundings is looked at."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN
from passerby.simulation.lenses import draw_lenses
from passerby.simulation.sites import SiteOptions, simulate_site, write_site
from passerby.simulation.sites.plan import airport
from passerby.simulation.sites.site import PICTURE, QuickLens
from passerby.simulation.sites.walkers import NOWHERE, walk

SMALL = SiteOptions(cameras=16, seed=801, seconds=10.0)


@pytest.fixture(scope="module")
def small():
    return simulate_site(SMALL)


@pytest.mark.parametrize("count", [8, 13, 14, 1000])
def test_every_camera_has_a_place_and_floors_are_chained_by_stairs(count):
    plan = airport(count, np.random.default_rng(0))
    floors = plan.floors
    assert len(floors) == count
    assert np.ptp(np.bincount(floors)) <= 1
    for mount in plan.mounts:
        zone = plan.zones[mount.zone]
        assert zone.floor == mount.floor
        assert (np.array(zone.low) < mount.ground).all()
        assert (np.array(zone.high) > mount.ground).all()
    stairs = {tuple(sorted(plan.zones[zone].floor for zone in link.zones)) for link in plan.links if link.seconds > 0}
    assert stairs == {(floor, floor + 1) for floor in range(floors.max())}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [801, 802])
def test_cameras_share_ground_with_two_to_six_others_and_never_with_another_floor(seed):
    site = simulate_site(SiteOptions(cameras=30, people=20, seed=seed, seconds=1.0))
    floors = site.plan.floors
    assert len(set(floors.tolist())) > 1
    assert all(floors[a] == floors[b] for a, b in site.shared_m2)
    degree = np.bincount(np.array([pair for pair, area in site.shared_m2.items() if area >= 5]).ravel(), minlength=30)
    assert 2 <= degree.min() <= degree.max() <= 6


def test_walls_bar_the_view_and_doors_do_not(small):
    hall = next(k for k, mount in enumerate(small.plan.mounts) if small.plan.zones[mount.zone].kind == "hall")
    sight, zone = small.sights[hall], small.plan.zones[small.plan.mounts[hall].zone]
    places = (sight.cells + 0.5) * 0.5
    inside = ((places > zone.low) & (places < zone.high)).all(axis=1)
    assert inside.mean() > 0.9
    door = next(link for link in small.plan.links if link.seconds == 0 and small.plan.mounts[hall].zone in link.zones)
    sides = np.sort(np.concatenate(door.ends)[:, 0])
    outside = places[~inside]
    from_camera = np.array(small.plan.mounts[hall].ground)
    for place in outside:
        at_wall = from_camera + (zone.low[1] - from_camera[1]) / (place[1] - from_camera[1]) * (place - from_camera)
        assert sides[0] - 0.5 <= at_wall[0] <= sides[-1] + 0.5


def test_people_walk_at_walking_speed_stay_in_zones_and_change_floors():
    options = SiteOptions(cameras=16, seed=803, people=20, seconds=120.0)
    plan = airport(options.cameras, options.rng(0))
    walkers = walk(plan, options)
    times = np.arange(0.0, 120.0, 0.5)
    xy, floor = walkers.places(np.arange(20), times)
    speed = np.linalg.norm(np.diff(xy, axis=0), axis=-1) / 0.5
    on_floor = (floor[:-1] != NOWHERE) & (floor[1:] != NOWHERE)
    assert speed[on_floor].max() < 2.1
    assert set(np.unique(floor)) == {NOWHERE, 0, 1}
    for person in range(20):
        for at, number in zip(xy[:, person], floor[:, person], strict=True):
            if number != NOWHERE:
                assert any(x0 - 1e-6 <= at[0] <= x1 + 1e-6 and y0 - 1e-6 <= at[1] <= y1 + 1e-6
                           for x0, y0, x1, y1 in plan.free(int(number)))  # fmt: skip


def test_a_camera_reports_the_same_whether_or_not_others_were_asked(small):
    alone = simulate_site(SMALL).camera(1)
    seen = [camera for camera, _ in zip(small.cameras(), range(2), strict=False)][-1]
    assert np.array_equal(alone.seen.boxes.ltwh, seen.seen.boxes.ltwh)
    assert np.array_equal(alone.true_identity, seen.true_identity)


def test_boxes_stand_where_the_true_people_do(small):
    """By the true camera, its clock and the floor's height, a box's lower edge is at the person's feet."""
    index = 2
    own, camera = small.camera(index), small.rig.cameras[index]
    boxes = own.truth
    times = (boxes.frame - 1) / SMALL.fps + small.clock_offsets_s[index]
    off = []
    for person, time, (left, top, width, height) in zip(boxes.identity - 1, times, boxes.ltwh, strict=True):
        state, floor = small.walkers.state(np.array([person]), np.array([time]))
        assert floor[0, 0] == small.plan.mounts[index].floor
        if top + height < PICTURE[1] - 1 and 1 < left < PICTURE[0] - width - 1:
            foot = camera.project(np.array([[*state.xy[0, 0], small.plan.floor_z_m[floor[0, 0]]]]))[0]
            off.append(abs(top + height - foot[1]) / height)
    assert len(off) > 20
    assert np.median(off) < 0.03


def test_tracklets_mean_nothing_in_another_camera_and_hold_one_person_each(small):
    own = simulate_site(replace(SMALL, tracklet_seconds=4.0, false_boxes=0.1)).camera(0)
    number, true = own.seen.boxes.identity, own.true_identity
    assert ((number == UNKNOWN) == (true == UNKNOWN)).all()
    assert (number == UNKNOWN).any()
    pairs = np.unique(np.column_stack([number, true])[number != UNKNOWN], axis=0)
    assert len(pairs) == len(np.unique(pairs[:, 0])) > len(np.unique(pairs[:, 1]))


def test_a_quick_lens_has_the_pixels_of_the_lens():
    rng = np.random.default_rng(0)
    lens = draw_lenses("typical", PICTURE, rng)(rng)
    points = rng.uniform((-3, -2, -1), (3, 2, 5), (200, 3))
    assert np.allclose(QuickLens.of(lens).project_rays(points), lens.project_rays(points), atol=1e-8, equal_nan=True)


def test_the_folder_holds_the_truth_of_overlaps_floors_and_clocks(tmp_path):
    site = simulate_site(SiteOptions(cameras=8, people=6, seconds=4.0, seed=804, embeddings="distinct"))
    path = write_site(site, tmp_path / "site")
    scene = tomllib.loads(path.read_text())
    assert scene["association"] == {"mode": "combined", "max_offset_s": 10.0}

    def rows(name):
        with path.with_name(name).open() as file:
            return list(csv.DictReader(file))

    shared = {(row["camera_a"], row["camera_b"]): float(row["shared_m2"]) for row in rows("overlaps.csv")}
    assert shared == {(f"C{a + 1}", f"C{b + 1}"): area for (a, b), area in site.shared_m2.items()}
    offsets = [float(row["clock_offset_s"]) for row in rows("cameras.csv")]
    assert np.allclose(offsets, site.clock_offsets_s, atol=1e-6)
    assert offsets[0] == 0.0
    assert [len(list((path.parent / name).iterdir())) for name in ("embeddings", "tracks")] == [8, len(scene["cameras"])]


@pytest.mark.parametrize(
    ("name", "value"),
    [("cameras", 7), ("cameras", 1001), ("people", 0), ("preset", "terrace"), ("clock_offsets", (1.0, 2.0)), ("missing", 2.0),
     ("camera_height_m", 1.0), ("seconds", -1.0)],
)  # fmt: skip
def test_bad_options_are_named(name, value):
    with pytest.raises(InputError, match=name):
        SiteOptions(**{name: value})
