"""A scene folder reads back as what was simulated."""

from __future__ import annotations

import csv
import re
import tomllib
from unittest.mock import Mock

import numpy as np
import pytest

from metrics.identities import identity_agreement
from passerby.common.errors import InputError
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene
from passerby.simulation import write_scene
from support.scenes.simulated import scene


@pytest.mark.parametrize("height", [1.72, 1.83])
def test_the_scene_file_holds_nothing_that_its_method_does_not_need(tmp_path, height):
    folder = write_scene(scene(seconds=1.0, person_height_mean_m=height), tmp_path / "s").parent
    text = (folder / "scene.toml").read_text()
    assert "reference" not in text
    assert max(len(number) for number in re.findall(r"= (\d+\.\d+)", text)) <= len("0.022875")
    assert not {"truth", "embeddings", "keypoints"} & {path.name for path in folder.iterdir()}


FAULTS = {"seconds": 3.0, "box_noise": 0.02, "false_boxes": 0.1, "identity_swaps": 0.2, "clock_offsets": 0.2}


def test_a_scene_folder_reads_back(tmp_path):
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


def test_the_truth_beside_it(tmp_path):
    simulated = scene(**FAULTS)
    folder = write_scene(simulated, tmp_path / "s").parent
    with (folder / "heights.csv").open() as file:
        heights = {int(row["id"]): float(row["height_m"]) for row in csv.DictReader(file)}
    assert heights == pytest.approx(simulated.heights, abs=1e-4)
    with (folder / "ground_positions.csv").open() as file:
        rows = list(csv.DictReader(file))
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
    judged = identity_agreement(tracks, truth, simulated.true_clocks)
    assert judged.boxes_true == judged.boxes_identified == sum(len(boxes) for boxes in simulated.truth.values())
    assert judged.boxes_without_truth == 0
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


def test_an_earlier_simulation_is_replaced_as_a_whole(tmp_path):
    write_scene(scene(seconds=1.0, cameras=5), tmp_path / "s", keypoints=True)
    write_scene(scene(seconds=1.0), tmp_path / "s")
    assert sorted(path.name for path in (tmp_path / "s" / "tracks").iterdir()) == [f"C{i}.txt" for i in (1, 2, 3, 4)]
    assert not (tmp_path / "s" / "keypoints").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


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
