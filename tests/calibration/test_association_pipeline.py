"""From files without identities to a rig, through everything between: small simulated terraces, judged by their truth."""

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
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.simulation import SimulationOptions, simulate, write_scene
from support.paths import DOCS

pytestmark = pytest.mark.system

FAULTS = {"seconds": 20.0, "box_noise": 0.02, "missing": 0.1, "unrelated_ids": True, "tracklet_seconds": 4.0}


def terrace(folder, association=None, **options):
    """A simulated terrace and the path of its scene file, with its table [association] replaced."""
    simulated = simulate(SimulationOptions(**{**FAULTS, **options}))
    path = write_scene(simulated, folder / "scene")
    if association is not None:
        declare(path, association=association)
    return simulated, path


def declare(path, **tables):
    path.write_text(tomli_w.dumps({**tomllib.loads(path.read_text()), **tables}))


def assert_near_truth(calibration, simulated, mm=30.0, degrees=0.14):
    """All cameras, nearly as near as given identities bring them: these to 16 mm and 0.08 degrees on the same boxes."""
    judged = compare(calibration.rig, simulated.rig)
    assert registered(calibration) == list(simulated.rig.names), calibration.reasons
    assert calibration.verdict == "accepted", calibration.reasons
    assert judged.similarity.mean_position_mm < mm
    assert judged.similarity.mean_orientation_deg < degrees


def registered(calibration):
    return [camera.name for camera in calibration.rig if camera.pose is not None]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """A terrace whose tracklets mean nothing elsewhere, and its calibration."""
    folder = tmp_path_factory.mktemp("plain")
    simulated, path = terrace(folder)
    calibration = passerby.calibrate(path)
    calibration.write(folder / "out")
    return simulated, path, calibration, folder / "out"


@pytest.mark.smoke
def test_people_whom_nobody_has_identified(plain):
    simulated, _, calibration, out = plain
    assert_near_truth(calibration, simulated)
    found = {name: read_boxes(out / "tracks" / f"{name}.txt") for name in simulated.rig.names}
    judged = identity_agreement(found, simulated.truth)
    assert judged.precision > 0.97
    assert judged.recall > 0.85


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


def test_cameras_that_did_not_start_together(tmp_path):
    simulated, path = terrace(tmp_path, clock_offsets=(0.0, 2.3, -1.4, 3.0))
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated)
    calibration.write(tmp_path / "out")
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    found = np.array([camera["time_offset_s"] for camera in report["cameras"]])
    true = np.array([simulated.clock_offsets[camera["name"]] for camera in report["cameras"]])
    np.testing.assert_allclose(found - found[0], true - true[0], atol=0.15)
    assert all(0 < camera["time_offset_sigma_s"] < 0.1 for camera in report["cameras"][1:])


def test_clocks_that_agree_are_left_alone_where_the_scene_says_so(tmp_path):
    simulated, path = terrace(tmp_path, {"mode": "trajectory", "max_offset_s": 0.0})
    calibration = passerby.calibrate(path)
    assert_near_truth(calibration, simulated)
    assert {clock.offset_s for clock in calibration.association.clocks.values()} == {0.0}


def test_frame_rates_that_differ(tmp_path):
    simulated, path = terrace(tmp_path, camera_fps=(5.0, 10.0, 6.0, 5.0))
    assert_near_truth(passerby.calibrate(path), simulated)


def test_detections_only(tmp_path):
    simulated, path = terrace(tmp_path)
    for file in (path.parent / "tracks").iterdir():
        boxes = read_boxes(file)
        write_boxes(file, replace(boxes, identity=np.full(len(boxes), -1)))
    cameras = tomllib.loads(path.read_text())["cameras"]
    declare(
        path,
        association={"mode": "trajectory"},
        cameras={name: {"intrinsics": table["intrinsics"], "detections": table["tracks"]} for name, table in cameras.items()},
    )
    assert_near_truth(passerby.calibrate(path), simulated)


def test_looks_alone(tmp_path):
    simulated, path = terrace(tmp_path, {"mode": "appearance"}, embeddings="distinct")
    assert_near_truth(passerby.calibrate(path), simulated)


def test_looks_and_motion(tmp_path):
    simulated, path = terrace(tmp_path, embeddings="distinct")
    assert_near_truth(passerby.calibrate(path), simulated)


def test_looks_that_tell_nothing_do_no_harm(tmp_path):
    simulated, path = terrace(tmp_path, embeddings="alike")
    assert_near_truth(passerby.calibrate(path), simulated)


def test_looks_alone_that_tell_nothing_are_refused(tmp_path):
    _, path = terrace(tmp_path, {"mode": "appearance"}, embeddings="alike")
    calibration = passerby.calibrate(path)
    assert calibration.verdict == "refused"
    assert calibration.exit_status == 3
    assert registered(calibration) == []
    assert "embeddings do not distinguish people" in calibration.reasons[0]


def test_a_camera_that_saw_nobody_does_not_keep_the_others_from_it(tmp_path):
    simulated, path = terrace(tmp_path)
    (path.parent / "tracks" / "C3.txt").write_text("")
    calibration = passerby.calibrate(path)
    assert registered(calibration) == ["C1", "C2", "C4"]
    assert compare(calibration.rig, simulated.rig).similarity.mean_position_mm < 30
    assert calibration.exit_status == 3
    assert any("C3" in finding.cameras for finding in calibration.diagnostics)


def test_cameras_without_common_ground_are_told_apart(tmp_path):
    simulated, path = terrace(tmp_path, cameras=5, people=14, groups=(3, 2))
    calibration = passerby.calibrate(path)
    assert registered(calibration) == ["C1", "C2", "C3"]
    assert compare(calibration.rig, simulated.rig).similarity.mean_position_mm < 30
    assert calibration.exit_status == 3
    assert ("C4", "C5") in [doubt.cameras for doubt in calibration.doubts], calibration.reasons


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
