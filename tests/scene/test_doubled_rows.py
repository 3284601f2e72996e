"""A person twice in one frame of a camera: the better row is used and it is told; where that is the rule, it is an error."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, Keypoints
from passerby.scene.reading import read_camera
from passerby.scene.scene import Scene
from passerby.scene.used_rows import MOST_DOUBLED, remove_duplicates
from passerby.simulation import SimulationOptions, simulate
from support.scenes.handmade_files import rows, write_scene


def boxes(*given: tuple[float, ...]) -> Boxes:
    """Of (frame, identity, left, score)."""
    table = np.array(given)
    ltwh = np.column_stack([table[:, 2], np.full((len(table), 3), [10.0, 40.0, 110.0])])
    return Boxes(table[:, 0], table[:, 1], ltwh, table[:, 3])


def test_the_row_of_the_higher_score_is_kept() -> None:
    kept, doubled = remove_duplicates(boxes((1, 1, 100, 0.9), (2, 1, 300, 0.4), (2, 1, 102, 0.8), (3, 1, 104, 0.9)))
    assert kept.ltwh[:, 0].tolist() == [100, 102, 104]
    assert (doubled.second, doubled.repeated, doubled.first) == (1, 0, (2, 1))


@pytest.mark.parametrize("swapped", [False, True])
def test_of_equal_scores_the_row_nearest_to_its_neighbours_in_time_is_kept(swapped: bool) -> None:
    two = [(2, 1, 300, 1), (2, 1, 104, 1)]
    kept, _ = remove_duplicates(boxes((1, 1, 100, 1), (1, 2, 300, 1), *(two[::-1] if swapped else two), (3, 1, 108, 1)))
    assert kept.ltwh[kept.identity == 1, 0].tolist() == [100, 104, 108]


def test_without_neighbours_the_first_row_is_kept() -> None:
    kept, _ = remove_duplicates(boxes(*[(2, 1, 300, 1), (2, 1, 104, 1)], *[(n, 2, 500, 1) for n in range(60)]))
    assert kept.ltwh[kept.identity == 1, 0].tolist() == [300]


def test_unknown_people_may_be_many_in_a_frame_but_not_the_same_row_twice() -> None:
    kept, doubled = remove_duplicates(boxes((1, -1, 100, 1), (1, -1, 200, 1), (1, -1, 100, 1), (2, -1, 100, 1)))
    assert (kept.ltwh[:, 0].tolist(), (doubled.second, doubled.repeated)) == ([100, 200, 100], (0, 1))


def test_joints_of_the_higher_confidence_are_kept() -> None:
    xy = np.arange(12.0).reshape(3, 2, 2)
    joints = Keypoints(
        np.array([1, 1, 2]), np.array([5, 5, 5]), xy, np.array([[0.2, 0.9], [0.8, 0.9], [1, 1]]), ("nose", "hip")
    )
    kept, doubled = remove_duplicates(joints)
    assert kept.xy.tolist() == xy[1:].tolist()
    assert doubled is not None


def test_rows_that_stand_once_are_left_alone():
    sound = boxes((1, 1, 100, 1), (1, 2, 100, 1), (2, 1, 100, 1))
    kept, doubled = remove_duplicates(sound)
    assert kept is sound
    assert doubled is None


def test_a_class_number_for_an_id_is_an_error() -> None:
    _, doubled = remove_duplicates(boxes(*[(frame, 1, 100 * one, 1) for frame in range(100) for one in range(2)]))
    assert doubled.is_rule
    _, doubled = remove_duplicates(boxes(*[(frame, 1, 100, 1) for frame in range(100)], (7, 1, 100, 1)))
    assert doubled.second == 1 < MOST_DOUBLED * 101
    assert not doubled.is_rule


@pytest.mark.parametrize("association", ['mode = "given"', 'mode = "combined"'])
def test_one_row_too_many_in_a_file_is_told_by_check(tmp_path, capsys, association):
    files = {"A.txt": rows(frames=30) + "30,2,700,300,40,110,1,-1,-1,-1\n"}
    scene = write_scene(tmp_path, files=files, association=association)
    assert run(["check", str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (finding,) = [one for one in told["findings"] if "another row" in one]
    assert finding == (
        f"{tmp_path / 'A.txt'}: camera A: 1 of 61 rows repeat an identity that has another row in the same frame "
        "(first: id 2 in frame 30): the better row of each is used"
    )
    assert told["cameras"][0]["boxes"] == 60


def test_embeddings_stay_with_their_rows(tmp_path: Path) -> None:
    files = {"A.txt": rows(frames=30) + "30,2,700,300,40,110,0.5,-1,-1,-1\n"}
    scene = write_scene(tmp_path, files=files, association='mode = "combined"')
    np.savez(tmp_path / "A.npz", embeddings=np.eye(61, dtype=np.float32))
    text = scene.read_text().replace('tracks = "A.txt"', 'tracks = "A.txt"\nembeddings = "A.npz"')
    scene.write_text(text)
    reading = read_camera(Scene.load(scene), "A")
    assert not reading.faults
    assert reading.boxes.embedding.argmax(axis=1).tolist() == list(range(60))


@pytest.mark.system
@pytest.mark.parametrize("given", [True, False])
def test_one_doubled_row_changes_no_calibration(given: bool) -> None:
    made = simulate(SimulationOptions(seconds=15.0, cameras=3, seed=3, box_noise=0.01, unrelated_ids=not given))
    lenses = {camera.name: camera.lens for camera in made.rig}
    seen = {name: made.observations[name].boxes for name in made.rig.names}
    table = {"mode": "given" if given else "combined"}
    first = passerby.calibrate_observations(lenses, seen, fps=5.0, association=table)
    double = seen["C2"].take(np.array([40]))
    double = replace(double, ltwh=double.ltwh + 60.0, score=np.array([0.01]))
    more = Boxes(
        *[np.concatenate([getattr(one, key) for one in (seen["C2"], double)]) for key in ("frame", "identity", "ltwh", "score")]
    )
    second = passerby.calibrate_observations(lenses, seen | {"C2": more}, fps=5.0, association=table)
    assert second.verdict == first.verdict == "accepted"
    assert any("camera C2: 1 of" in finding for finding in second.findings)
    for name in made.rig.names:
        assert np.array_equal(first.rig[name].pose.centre, second.rig[name].pose.centre)


@pytest.mark.slow
def test_doubled_joints_in_memory_are_told_and_too_many_are_an_error() -> None:
    made = simulate(SimulationOptions(seconds=10.0, cameras=2, seed=3))
    lenses = {camera.name: camera.lens for camera in made.rig}
    joints = {name: made.observations[name].keypoints for name in made.rig.names}
    doubled = joints["C1"].take(np.r_[np.arange(len(joints["C1"])), 7])
    found = passerby.calibrate_observations(lenses, keypoints=joints | {"C1": doubled}, fps=5.0, association={"mode": "given"})
    assert any("keypoints: camera C1: 1 of" in finding for finding in found.findings)
    alike = replace(joints["C1"], identity=np.ones(len(joints["C1"])))
    with pytest.raises(InputError, match="which is too often for a mistake"):
        passerby.calibrate_observations(lenses, keypoints=joints | {"C1": alike}, fps=5.0, association={"mode": "given"})
