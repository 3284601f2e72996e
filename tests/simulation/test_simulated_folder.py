"""A scene folder reads back as what was simulated; and a site: its plan, and that cameras look at their surroundings only."""

import csv
import re
import tomllib
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from metrics.identities import identity_agreement
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene
from passerby.simulation import write_scene
from passerby.simulation.lenses import draw_lenses
from passerby.simulation.sites import SiteOptions, simulate_site, write_site
from passerby.simulation.sites.plan import airport
from passerby.simulation.sites.site import PICTURE, QuickLens
from passerby.simulation.sites.walkers import NOWHERE, walk
from support.scenes.simulated import scene


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


FAULTS = {"seconds": 3.0, "box_noise": 0.02, "false_boxes": 0.1, "identity_swaps": 0.2, "clock_offsets": 0.2}


def test_a_scene_folder_reads_back_with_the_truth_beside_it(tmp_path):
    simulated = scene(**FAULTS)
    path = write_scene(simulated, tmp_path / "terrace", keypoints=True)
    declared = Scene.load(path)
    assert path == tmp_path / "terrace" / "scene.toml"
    assert (declared.association.mode, declared.scene.fps) == ("given", simulated.options.fps)
    assert tuple(declared.cameras) == simulated.rig.names
    lenses, truth = read_rig(path.parent / "intrinsics.toml"), read_rig(path.parent / "truth.toml")
    for camera in simulated.rig:
        entry, seen = declared.cameras[camera.name], simulated.observations[camera.name]
        boxes, joints = read_boxes(declared.resolve(entry.tracks)), read_keypoints(declared.resolve(entry.keypoints))
        sorted_boxes, sorted_joints = (one.take(np.lexsort((one.identity, one.frame))) for one in (seen.boxes, seen.keypoints))
        np.testing.assert_array_equal(boxes.frame, sorted_boxes.frame)
        np.testing.assert_array_equal(boxes.identity, sorted_boxes.identity)
        np.testing.assert_allclose(boxes.ltwh, sorted_boxes.ltwh, atol=1e-5)
        np.testing.assert_allclose(joints.xy, sorted_joints.xy, atol=1e-3)
        np.testing.assert_allclose(joints.score, sorted_joints.score)
        assert lenses[camera.name].pose is None
        np.testing.assert_allclose(lenses[camera.name].lens.matrix, camera.lens.matrix)
        np.testing.assert_allclose(truth[camera.name].centre, camera.centre, atol=1e-9)
        np.testing.assert_allclose(truth[camera.name].pose.R_cw, camera.pose.R_cw, atol=1e-9)

    folder = path.parent
    heights = {int(row["id"]): float(row["height_m"]) for row in rows_of(folder / "heights.csv")}
    assert heights == pytest.approx(simulated.heights, abs=1e-4)
    rows = rows_of(folder / "ground_positions.csv")
    assert len(rows) == np.isfinite(simulated.ground_positions[..., 0]).sum()
    for row in rows:
        true = simulated.ground_positions[int(row["frame"]) - 1, int(row["id"]) - 1]
        assert (float(row["x_m"]), float(row["y_m"])) == pytest.approx(tuple(true), abs=1e-4)
    content = tomllib.loads((folder / "simulation.toml").read_text())
    assert content["clock_offsets_s"] == pytest.approx(simulated.clock_offsets)
    assert content["options"]["box_noise"] == 0.02


ASSOCIATION = {"unrelated_ids": True, "tracklet_seconds": 2.0, "embeddings": "distinct", "camera_fps": (5.0, 10.0, 5.0, 5.0)}


def test_a_folder_whose_identities_are_to_be_found(tmp_path):
    simulated = scene(**FAULTS, **ASSOCIATION)
    folder = write_scene(simulated, tmp_path / "s", keypoints=True).parent
    declared = tomllib.loads((folder / "scene.toml").read_text())
    assert declared["association"]["mode"] == "combined"
    assert declared["scene"]["fps"] == 5.0
    assert [table.get("fps") for table in declared["cameras"].values()] == [None, 10.0, None, None]
    tracks = {}
    for name, table in declared["cameras"].items():
        seen, tracks[name] = simulated.observations[name], read_boxes(folder / table["tracks"])
        with np.load(folder / table["embeddings"]) as archive:
            np.testing.assert_array_equal(archive["frame"], tracks[name].frame)
            embeddings = archive["embeddings"]
        assert embeddings.dtype == np.float32
        # Row by row: the box that was written is the one that this embedding belongs to.
        same = (seen.boxes.frame == tracks[name].frame[:, None]) & np.isclose(
            seen.boxes.ltwh, tracks[name].ltwh[:, None], atol=1e-5
        ).all(axis=-1)
        np.testing.assert_array_equal(same.sum(axis=1), 1)
        np.testing.assert_allclose(embeddings, seen.boxes.embedding[np.argmax(same, axis=1)], atol=1e-6)
        np.testing.assert_array_equal(tracks[name].identity, seen.boxes.identity[np.argmax(same, axis=1)])
    truth = {name: read_boxes(folder / "truth" / f"{name}.txt") for name in tracks}
    agreement = identity_agreement(tracks, truth, simulated.true_clocks)
    assert agreement.boxes_true == agreement.boxes_identified == sum(len(boxes) for boxes in simulated.truth.values())
    assert agreement.boxes_without_truth == 0
    assert identity_agreement(truth, truth, simulated.true_clocks).recall == 1.0
    options = tomllib.loads((folder / "simulation.toml").read_text())["options"]
    assert {key: tuple(v) if isinstance(v, list) else v for key, v in options.items() if key in ASSOCIATION} == ASSOCIATION


def test_only_the_truth_tells_the_clocks_offsets(tmp_path):
    """What a calibration reads is the same whatever the offsets are said to be, the boxes apart."""
    texts = []
    for offsets in ((0.0, 0.0, 0.0, 0.0), (0.0, 1.37, -2.11, 3.3)):
        folder = write_scene(scene(seconds=3.0, clock_offsets=offsets, **ASSOCIATION), tmp_path / str(offsets[1]) / "s").parent
        texts.append([(folder / name).read_text() for name in ("scene.toml", "intrinsics.toml")])
        assert min(read_boxes(path).frame.min() for path in (folder / "tracks").iterdir()) == 1
    assert texts[0] == texts[1]


def test_an_earlier_simulation_is_replaced_as_a_whole_and_a_scene_holds_only_what_its_method_needs(tmp_path):
    write_scene(scene(seconds=1.0, cameras=5), tmp_path / "s", keypoints=True)
    write_scene(scene(seconds=1.0), tmp_path / "s")
    assert sorted(path.name for path in (tmp_path / "s" / "tracks").iterdir()) == [f"C{i}.txt" for i in (1, 2, 3, 4)]
    assert not {"truth", "embeddings", "keypoints"} & {path.name for path in (tmp_path / "s").iterdir()}
    assert [path.name for path in tmp_path.iterdir()] == ["s"]
    tall = write_scene(scene(seconds=1.0, person_height_mean_m=1.83), tmp_path / "tall")
    for path in (tmp_path / "s" / "scene.toml", tall):
        assert "reference" not in path.read_text()
        assert max(len(number) for number in re.findall(r"= (\d+\.\d+)", path.read_text())) <= len("0.022875")


def test_other_peoples_files_are_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="something other"):
        write_scene(scene(seconds=1.0), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(InputError, match="is a file"):
        write_scene(scene(seconds=1.0), tmp_path / "thesis.tex")


def test_a_failure_halfway_leaves_nothing(tmp_path, monkeypatch):
    write_scene(scene(seconds=1.0), tmp_path / "s")
    before = (tmp_path / "s" / "tracks" / "C1.txt").read_text()
    broken = Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr("passerby.simulation.write.write_boxes", broken)
    with pytest.raises(InputError, match="No space left"):
        write_scene(scene(seconds=2.0), tmp_path / "s")
    assert (tmp_path / "s" / "tracks" / "C1.txt").read_text() == before
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


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


def test_a_camera_reports_the_same_whether_or_not_others_were_asked_and_boxes_stand_where_people_do(small):
    alone = simulate_site(SMALL).camera(1)
    seen = [camera for camera, _ in zip(small.cameras(), range(2), strict=False)][-1]
    assert np.array_equal(alone.seen.boxes.ltwh, seen.seen.boxes.ltwh)
    assert np.array_equal(alone.true_identity, seen.true_identity)
    # By the true camera, its clock and the floor's height, a box's lower edge is at the person's feet.
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


def test_tracklets_mean_nothing_in_another_camera_and_hold_one_person_each():
    own = simulate_site(replace(SMALL, tracklet_seconds=4.0, false_boxes=0.1)).camera(0)
    number, true = own.seen.boxes.identity, own.true_identity
    assert ((number == UNKNOWN) == (true == UNKNOWN)).all()
    assert (number == UNKNOWN).any()
    pairs = np.unique(np.column_stack([number, true])[number != UNKNOWN], axis=0)
    assert len(pairs) == len(np.unique(pairs[:, 0])) > len(np.unique(pairs[:, 1]))


def test_the_folder_holds_the_truth_of_overlaps_floors_and_clocks(tmp_path):
    site = simulate_site(SiteOptions(cameras=8, people=6, seconds=4.0, seed=804, embeddings="distinct"))
    path = write_site(site, tmp_path / "site")
    scene = tomllib.loads(path.read_text())
    assert scene["association"] == {"mode": "combined", "max_offset_s": 10.0}
    shared = {(row["camera_a"], row["camera_b"]): float(row["shared_m2"]) for row in rows_of(path.with_name("overlaps.csv"))}
    assert shared == {(f"C{a + 1}", f"C{b + 1}"): area for (a, b), area in site.shared_m2.items()}
    offsets = [float(row["clock_offset_s"]) for row in rows_of(path.with_name("cameras.csv"))]
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


def test_a_quick_lens_has_the_pixels_of_the_lens():
    rng = np.random.default_rng(0)
    lens = draw_lenses("typical", PICTURE, rng)(rng)
    points = rng.uniform((-3, -2, -1), (3, 2, 5), (200, 3))
    assert np.allclose(QuickLens.of(lens).project_rays(points), lens.project_rays(points), atol=1e-8, equal_nan=True)
