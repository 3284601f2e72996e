"""From files without identities to a rig, odd, poor and wrong input included: small terraces, compared with their truth."""

import json
import re
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

import passerby
from metrics.identities import identity_agreement
from passerby.cli.main import run
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.simulation import SimulationOptions, simulate, write_scene
from support.paths import DOCS
from support.scenes.boxes_of_walks import boxes_of

pytestmark = pytest.mark.system

FAULTS = {"seconds": 20.0, "box_noise": 0.02, "missing": 0.1, "unrelated_ids": True, "tracklet_seconds": 4.0}


HEIGHTS = (1.75, 1.62, 1.85, 1.7, 1.68)
FRAMES = 150


def terrace(folder, association=None, **options):
    """A simulated terrace and the path of its scene file, with its table [association] replaced."""
    simulated = simulate(SimulationOptions(**{**FAULTS, **options}))
    path = write_scene(simulated, folder / "scene")
    if association is not None:
        declare(path, association=association)
    return simulated, path


def declare(path, **tables):
    path.write_text(tomli_w.dumps({**tomllib.loads(path.read_text()), **tables}))


def declare_fps(path, camera, fps):
    cameras = tomllib.loads(path.read_text())["cameras"]
    declare(path, cameras={**cameras, camera: {**cameras[camera], "fps": fps}})


def edit(path, camera, change):
    """Change what a camera saw."""
    file = path.parent / "tracks" / f"{camera}.txt"
    boxes = change(read_boxes(file))
    write_boxes(file, boxes.take(np.lexsort((boxes.identity, boxes.frame))))


def registered(calibration):
    return [camera.name for camera in calibration.rig if camera.pose is not None]


def assert_near_truth(calibration, truth, names=None, mm=30.0, degrees=0.14, verdict="accepted"):
    """The cameras, all unless named, nearly as near as given identities bring them: 16 mm and 0.08 degrees on these boxes."""
    assert registered(calibration) == list(names or truth.names), calibration.reasons
    assert verdict in (None, calibration.verdict), calibration.reasons
    errors = compare(calibration.rig.posed(), Rig(tuple(camera for camera in truth if camera.name in registered(calibration))))
    assert errors.similarity.mean_position_mm < mm
    assert errors.similarity.mean_orientation_deg < degrees


def one_sentence(sentences, *parts):
    assert any(all(part in text for part in parts) for text in sentences), sentences


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """A terrace whose tracklets mean nothing elsewhere, and its calibration."""
    folder = tmp_path_factory.mktemp("plain")
    simulated, path = terrace(folder)
    calibration = passerby.calibrate(path)
    calibration.write(folder / "out")
    return simulated, path, calibration, folder / "out"


@pytest.mark.smoke
def test_people_without_identities_are_found_and_the_rig_is_near_the_truth(plain):
    simulated, _, calibration, out = plain
    assert_near_truth(calibration, simulated.rig)
    assert {clock.offset_s for clock in calibration.association.clocks.values()} == {0.0}
    found = {name: read_boxes(out / "tracks" / f"{name}.txt") for name in simulated.rig.names}
    agreement = identity_agreement(found, simulated.truth)
    assert agreement.precision > 0.97
    assert agreement.recall > 0.85


@pytest.mark.smoke
def test_the_report_tells_how_each_pair_was_found(plain):
    simulated, _, _, out = plain
    association = json.loads((out / "calibration.json").read_text())["association"]
    pairs = {tuple(pair["cameras"]): pair for pair in association["pairs"]}
    assert set(pairs) == {(a, b) for a in simulated.rig.names for b in simulated.rig.names if a < b}
    assert all(pair["route"] == "tracks" for pair in pairs.values())
    assert any(pair["used"] and pair["runner_up"] < 1 for pair in pairs.values())
    for pair in pairs.values():
        if pair["used"]:
            assert pair["matched_tracklets"] > 0
            assert pair["matches"] > 0
            assert pair["offset_s"] == pytest.approx(0, abs=0.15)


def test_the_same_input_gives_the_same_bytes_side_by_side_too(plain, tmp_path):
    _, path, _, out = plain
    with ThreadPoolExecutor(2) as executor:
        passerby.calibrate(path, executor=executor).write(tmp_path / "again")
    one, two = ({file.name: file.read_bytes() for file in folder.rglob("*.*")} for folder in (out, tmp_path / "again"))
    assert sorted(one) == ["C1.txt", "C2.txt", "C3.txt", "C4.txt", "calibration.json", "report.html", "rig.toml"]
    assert one == two


@pytest.mark.smoke
def test_every_figure_is_documented(plain):
    _, _, _, out = plain
    report = json.loads((out / "calibration.json").read_text())
    keys = {"fps", "time_offset_s", "time_offset_sigma_s"} | set(keys_of(report["association"])) - {"mode"}
    assert keys & set(report["cameras"][0]) >= {"fps", "time_offset_s", "time_offset_sigma_s"}
    text = (DOCS / "association.md").read_text()
    section = text.split("## What `calibration.json` says")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)`", section, re.MULTILINE)) == keys


def keys_of(value):
    """The keys of all tables in a JSON value."""
    if isinstance(value, list):
        for entry in value:
            yield from keys_of(entry)
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield key
            yield from keys_of(entry)


@pytest.mark.parametrize(
    ("association", "options"),
    [
        ({"mode": "trajectory", "max_offset_s": 0.0}, {}),
        (None, {"camera_fps": (5.0, 10.0, 6.0, 5.0)}),
        ({"mode": "appearance"}, {"embeddings": "distinct"}),
        (None, {"embeddings": "distinct"}),
        (None, {"embeddings": "alike"}),
    ],
    ids=["clocks that agree", "frame rates that differ", "looks alone", "looks and motion", "looks that tell nothing"],
)
def test_other_modes_rates_and_looks_bring_the_rig_as_near(tmp_path, association, options):
    simulated, path = terrace(tmp_path, association, **options)
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated.rig)
    if association == {"mode": "trajectory", "max_offset_s": 0.0}:
        assert {clock.offset_s for clock in calibration.association.clocks.values()} == {0.0}


def test_cameras_that_did_not_start_together(tmp_path):
    simulated, path = terrace(tmp_path, clock_offsets=(0.0, 2.3, -1.4, 3.0))
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated.rig)
    calibration.write(tmp_path / "out")
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    found = np.array([camera["time_offset_s"] for camera in report["cameras"]])
    true = np.array([simulated.clock_offsets[camera["name"]] for camera in report["cameras"]])
    np.testing.assert_allclose(found - found[0], true - true[0], atol=0.15)
    assert all(0 < camera["time_offset_sigma_s"] < 0.1 for camera in report["cameras"][1:])


def test_detections_only(tmp_path):
    simulated, path = terrace(tmp_path)
    for name in simulated.rig.names:
        edit(path, name, lambda boxes: replace(boxes, identity=np.full(len(boxes), -1)))
    tables = tomllib.loads(path.read_text())["cameras"].items()
    cameras = {name: {"intrinsics": table["intrinsics"], "detections": table["tracks"]} for name, table in tables}
    declare(path, association={"mode": "trajectory"}, cameras=cameras)
    assert_near_truth(passerby.calibrate(path), simulated.rig)


def test_looks_alone_that_tell_nothing_are_refused(tmp_path):
    _, path = terrace(tmp_path, {"mode": "appearance"}, embeddings="alike")
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "refused"
    assert calibration.exit_status == 3
    assert registered(calibration) == []
    assert "embeddings do not distinguish people" in calibration.reasons[0]


def test_a_camera_that_saw_no_person_is_named_and_the_others_are_calibrated(tmp_path, capsys):
    simulated, path = terrace(tmp_path)
    (path.parent / "tracks" / "C3.txt").write_text("")
    assert run(["calibrate", str(path), "-o", str(tmp_path / "out")]) == 3
    assert "camera C3 saw no person" in capsys.readouterr().err
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert [camera["registered"] for camera in report["cameras"]] == [True, True, False, True]
    assert compare(read_rig(tmp_path / "out" / "rig.toml"), simulated.rig).similarity.mean_position_mm < 30


def test_cameras_without_common_ground_are_separated(tmp_path):
    simulated, path = terrace(tmp_path, cameras=5, people=14, groups=(3, 2))
    calibration = passerby.calibrate(path)
    assert registered(calibration) == ["C1", "C2", "C3"]
    assert compare(calibration.rig, simulated.rig).similarity.mean_position_mm < 30
    assert calibration.exit_status == 3
    assert ("C4", "C5") in [doubt.cameras for doubt in calibration.doubts], calibration.reasons


def walking(rng):
    """All over the terrace."""
    points = rng.uniform(-1, 1, (60, 2)) * (3, 5)
    arrival = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]) / 1.2
    return np.column_stack([np.interp(np.arange(FRAMES) / 5, arrival, points[:, axis]) for axis in (0, 1)])


def standing(rng):
    return rng.uniform(-1, 1, 2) * (2.5, 4) + 0.02 * rng.standard_normal((FRAMES, 2))


def on_a_line(phase):
    """To and fro over 8 metres."""
    along = np.abs((np.arange(FRAMES) / 5 * 1.2 + phase) % 16 - 8) - 4
    return np.outer(along, (0.5, 0.87))


@pytest.fixture(scope="module")
def area():
    return simulate(SimulationOptions(preset="terrace", box_noise=0.02, seconds=30))


def seen(area, folder, ways, rng):
    """A scene of people on the given ways, in tracklets of four seconds whose numbers mean nothing."""
    walks = {number: (way, HEIGHTS[number % len(HEIGHTS)]) for number, way in enumerate(ways, start=1)}
    cameras = {}
    for k, (name, own) in enumerate(boxes_of(area.rig, walks, rng, noise=0.015).cameras.items()):
        boxes = own.boxes.take(rng.random(len(own.boxes)) > 0.1)
        number = np.unique(boxes.identity * 50 + (boxes.frame + 7 * k) // 20, return_inverse=True)[1]
        cameras[name] = CameraObservations(replace(boxes, identity=rng.permutation(number.max() + 1)[number] + 1))
    path = write_scene(replace(area, observations=Observations(cameras, 5.0)), folder / "scene")
    declare(path, association={"mode": "combined"})
    return path


def test_people_who_stand_among_walkers_do_no_harm(area, tmp_path):
    rng = np.random.default_rng(1)
    ways = [walking(rng), walking(rng), walking(rng), standing(rng), standing(rng)]
    assert_near_truth(passerby.calibrate(seen(area, tmp_path, ways, rng)), area.rig, mm=40.0, degrees=0.2)


@pytest.mark.parametrize(
    ("people", "seed", "told"),
    [("standing", 2, ("stand still", "record more people walking")), ("on one line", 3, ("on one straight line",))],
)
def test_people_who_only_stand_or_walk_on_one_line_are_not_enough(area, tmp_path, people, seed, told):
    """Where they stand may well fit, at any offset of the clocks."""
    rng = np.random.default_rng(seed)
    ways = [standing(rng) for _ in range(5)] if people == "standing" else [on_a_line(5 * k) for k in range(3)]
    calibration = passerby.calibrate(seen(area, tmp_path, ways, rng))
    assert calibration.exit_status == 3
    one_sentence(calibration.reasons, *told)


def test_one_person_and_two_cameras(tmp_path):
    simulated, path = terrace(tmp_path, cameras=2, people=1, seconds=40.0)
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated.rig, mm=40.0, degrees=0.6, verdict=None)


def test_two_cameras_at_one_place(area, tmp_path):
    rng = np.random.default_rng(1)
    own = area.rig["C2"]
    beside = Pose.from_centre(own.pose.R_cw, own.pose.centre + 0.12 * own.pose.R_cw[0])
    rig = Rig((*area.rig, Camera("C5", own.lens, beside)))
    five = replace(area, rig=rig, options=replace(area.options, cameras=5))
    calibration = passerby.calibrate(seen(five, tmp_path, [walking(rng) for _ in range(4)], rng))
    assert_near_truth(calibration, rig, mm=40.0, degrees=0.2)


def test_one_camera_found_twice_harms_no_pose_but_is_reported(tmp_path):
    simulated, path = terrace(tmp_path)
    rng = np.random.default_rng(4)
    boxes = simulated.truth["C2"]
    corners = np.column_stack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])
    corners += 0.02 * boxes.ltwh[:, 3:] * rng.standard_normal((len(boxes), 4))
    ltwh = np.column_stack([corners[:, :2], np.maximum(corners[:, 2:] - corners[:, :2], 2.0)])
    again = replace(boxes, ltwh=ltwh, identity=boxes.identity + 100 * (boxes.frame // 20))
    write_boxes(path.parent / "tracks" / "C5.txt", again)
    lenses = tomllib.loads((path.parent / "intrinsics.toml").read_text())
    lenses["C5"] = lenses["C2"] | ({"name": "C5"} if "name" in lenses["C2"] else {})
    (path.parent / "intrinsics.toml").write_text(tomli_w.dumps(lenses))
    cameras = tomllib.loads(path.read_text())["cameras"]
    declare(path, cameras={**cameras, "C5": {"intrinsics": "intrinsics.toml", "tracks": "tracks/C5.txt"}})
    calibration = passerby.calibrate(path)
    one_sentence(calibration.reasons, "cameras C2 and C5 show the same", "delete [cameras.C5]")
    whole = Rig((*simulated.rig, replace(simulated.rig["C2"], name="C5")))
    assert_near_truth(calibration, whole, mm=40.0, degrees=0.2, verdict=None)


def test_ids_that_change_from_frame_to_frame_are_detections(tmp_path):
    simulated, path = terrace(tmp_path)
    edit(path, "C3", lambda boxes: replace(boxes, identity=np.arange(1, len(boxes) + 1)))
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated.rig, mm=40.0, degrees=0.2)
    one_sentence(calibration.findings, "camera C3", "treated as detections")


def test_ids_that_change_person_and_false_boxes(tmp_path):
    simulated, path = terrace(tmp_path, identity_swaps=0.05, false_boxes=0.3)
    calibration = passerby.calibrate(path)
    assert "clock_drifts" not in [notice.code for notice in calibration.notices], "the clocks are sound"
    assert_near_truth(calibration, simulated.rig, mm=40.0, degrees=0.2)


@pytest.mark.parametrize("stated", [10.0, 2.5])
def test_a_frame_rate_that_is_far_off_is_reported_with_the_right_one(tmp_path, stated):
    simulated, path = terrace(tmp_path)
    declare_fps(path, "C3", stated)
    calibration = passerby.calibrate(path)
    assert calibration.exit_status == 3
    assert_near_truth(calibration, simulated.rig, ["C1", "C2", "C4"], 40.0, 0.2, None)
    (lost,) = [doubt for doubt in calibration.doubts if "C3" in doubt.cameras]
    fixed = lost.values["why"]["values"]["fixed_by"]
    assert (fixed["code"], fixed["cameras"][0]) == ("other_rate_fits", "C3")
    assert (fixed["values"]["fits_fps"], fixed["values"]["fps"]) == (pytest.approx(5.0), stated)
    one_sentence(calibration.reasons, "camera C3", f"at 5 frames per second instead of {stated:g}", "check its fps")


def test_clocks_that_differ_by_more_than_is_searched_for(tmp_path):
    """The first frames are not there, and nothing tells of it."""
    _, path = terrace(tmp_path, cameras=2, seconds=40.0)
    edit(path, "C2", lambda boxes: replace(boxes.take(boxes.frame > 45), frame=boxes.frame[boxes.frame > 45] - 45))
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "refused"
    assert calibration.exit_status == 3
    one_sentence(calibration.reasons, "the clock of C2 is 9.0 s behind the clock of C1", "max_offset_s = ")
    declare(path, association={"mode": "combined", "max_offset_s": 10.0})
    fixed = passerby.calibrate(path)
    assert fixed.verdict == "accepted", fixed.reasons
    assert fixed.association.clocks["C2"].offset_s == pytest.approx(9.0, abs=0.05)


@pytest.mark.parametrize("fps", [1.0, 2.0])
def test_slow_cameras_of_unknown_rate(tmp_path, fps):
    simulated, path = terrace(tmp_path, fps=fps, seconds=40.0, tracklet_seconds=0.0)
    declare(path, scene={"name": "of unknown rate"})
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated.rig, mm=40.0, degrees=0.2)
    one_sentence(calibration.findings, "no frame rate is given")
