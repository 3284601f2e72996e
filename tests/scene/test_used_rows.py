"""Rows of people that are used: not the same person twice in a frame, not excluded regions and spans, not other seconds."""

import json
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import passerby
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Boxes, Keypoints
from passerby.evaluation.metrics import compare
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.scene.inputs import SceneInputs, read_inputs
from passerby.scene.reading import read_camera
from passerby.scene.scene import Scene
from passerby.scene.used_rows import feet_of_keypoints, find_inside_any, remove_duplicates
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation import write_scene as write_simulated
from passerby.simulation.disturbances import Move, film_disturbed, rig_after
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
    xy, score = np.arange(12.0).reshape(3, 2, 2), np.array([[0.2, 0.9], [0.8, 0.9], [1, 1]])
    kept, doubled = remove_duplicates(Keypoints(np.array([1, 1, 2]), np.array([5, 5, 5]), xy, score, ("nose", "hip")))
    assert kept.xy.tolist() == xy[1:].tolist()
    assert doubled is not None
    sound = boxes((1, 1, 100, 1), (1, 2, 100, 1), (2, 1, 100, 1))
    kept, doubled = remove_duplicates(sound)
    assert kept is sound
    assert doubled is None


def test_of_equal_scores_the_row_nearest_to_its_neighbours_in_time_is_kept() -> None:
    """Without neighbours the first; of unknown people only the same row twice is one too many."""
    two = [(2, 1, 300, 1), (2, 1, 104, 1)]
    for rows_of_two in (two, two[::-1]):
        kept, _ = remove_duplicates(boxes((1, 1, 100, 1), (1, 2, 300, 1), *rows_of_two, (3, 1, 108, 1)))
        assert kept.ltwh[kept.identity == 1, 0].tolist() == [100, 104, 108]
    kept, _ = remove_duplicates(boxes(*two, *[(n, 2, 500, 1) for n in range(60)]))
    assert kept.ltwh[kept.identity == 1, 0].tolist() == [300]
    kept, doubled = remove_duplicates(boxes((1, -1, 100, 1), (1, -1, 200, 1), (1, -1, 100, 1), (2, -1, 100, 1)))
    assert (kept.ltwh[:, 0].tolist(), (doubled.second, doubled.repeated)) == ([100, 200, 100], (0, 1))


def test_an_identity_that_is_doubled_as_a_rule_is_no_mistake_of_single_rows() -> None:
    """As where the class number stands for the id."""
    _, doubled = remove_duplicates(boxes(*[(frame, 1, 100 * one, 1) for frame in range(100) for one in range(2)]))
    assert doubled.is_rule
    _, doubled = remove_duplicates(boxes(*[(frame, 1, 100, 1) for frame in range(100)], (7, 1, 100, 1)))
    assert (doubled.second, doubled.is_rule) == (1, False)


@pytest.mark.parametrize("association", ['mode = "given"', 'mode = "combined"'])
def test_one_row_too_many_in_a_file_is_a_finding_of_check_and_embeddings_stay_with_their_rows(tmp_path, capsys, association):
    files = {"A.txt": rows(frames=30) + "30,2,700,300,40,110,0.5,-1,-1,-1\n"}
    scene = write_scene(tmp_path, files=files, association=association)
    assert run(["check", str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (finding,) = [one for one in told["findings"] if "another row" in one]
    assert finding == (
        f"{tmp_path / 'A.txt'}: camera A: 1 of 61 rows repeat an identity that has another row in the same frame "
        "(first: id 2 in frame 30): the better row of each is used"
    )
    assert told["cameras"][0]["boxes"] == 60
    np.savez(tmp_path / "A.npz", embeddings=np.eye(61, dtype=np.float32))
    scene.write_text(scene.read_text().replace('tracks = "A.txt"', 'tracks = "A.txt"\nembeddings = "A.npz"'))
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
def test_doubled_joints_in_memory_are_a_finding_and_too_many_are_an_error() -> None:
    made = simulate(SimulationOptions(seconds=10.0, cameras=2, seed=3))
    lenses = {camera.name: camera.lens for camera in made.rig}
    joints = {name: made.observations[name].keypoints for name in made.rig.names}
    doubled = joints["C1"].take(np.r_[np.arange(len(joints["C1"])), 7])
    found = passerby.calibrate_observations(lenses, keypoints=joints | {"C1": doubled}, fps=5.0, association={"mode": "given"})
    assert any("keypoints: camera C1: 1 of" in finding for finding in found.findings)
    alike = replace(joints["C1"], identity=np.ones(len(joints["C1"])))
    with pytest.raises(InputError, match="which is too often for a mistake"):
        passerby.calibrate_observations(lenses, keypoints=joints | {"C1": alike}, fps=5.0, association={"mode": "given"})


LEFT = [[0.0, 0.0], [500.0, 0.0], [500.0, 719.0], [0.0, 719.0]]


def scene_of_two(folder: Path, **keys: object) -> Path:
    """Two cameras that see two people for ten frames: one at the left, whose feet are at (250, 400), one at (900, 400)."""
    frames = np.repeat(np.arange(1, 11), 2)
    identity = np.tile([1, 2], 10)
    ltwh = np.tile([[200.0, 200.0, 100.0, 200.0], [850.0, 200.0, 100.0, 200.0]], (10, 1))
    lens = Lens((1280, 720), np.array([[900.0, 0.0, 639.5], [0.0, 900.0, 359.5], [0.0, 0.0, 1.0]]), np.zeros(0))
    write_rig(folder / "lenses.toml", Rig((Camera("A", lens), Camera("B", lens))))
    for name, score in (("A", 1.0), ("B", 0.9)):
        write_boxes(folder / f"{name}.txt", Boxes(frames, identity, ltwh, np.full(20, score)))
    cameras = {name: {"intrinsics": "lenses.toml", "tracks": f"{name}.txt"} for name in ("A", "B")}
    content = {"scene": {"fps": 10.0}, "cameras": {"A": cameras["A"] | keys, "B": cameras["B"]}}
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps(content))
    return path


def read(path: Path) -> SceneInputs:
    return read_inputs(Scene.load(path))


def test_people_with_their_feet_in_a_region_are_left_out_and_counted(tmp_path):
    """Somebody in front of an excluded screen stays."""
    inputs = read(scene_of_two(tmp_path, exclude=[LEFT]))
    assert (set(inputs.observations["A"].boxes.identity), set(inputs.observations["B"].boxes.identity)) == ({2}, {1, 2})
    counted = [finding.values for finding in inputs.findings if finding.code == "people_excluded"]
    assert [(one["left_out"], one["rows"]) for one in counted] == [(10, 20)]
    screen = [[180.0, 150.0], [320.0, 150.0], [320.0, 390.0], [180.0, 390.0]]
    assert set(read(scene_of_two(tmp_path, exclude=[screen])).observations["A"].boxes.identity) == {1, 2}


def test_spans_of_time_are_left_out(tmp_path):
    frames = read(scene_of_two(tmp_path, exclude_s=[[0.0, 0.15], [0.5, 0.7]])).observations["A"].boxes.frame
    assert sorted(set(frames)) == [3, 4, 5, 9, 10]


def test_a_polygon_that_crosses_itself_has_holes_and_no_point_is_in_it_twice():
    points = np.array([[1.0, 1.0], [3.0, 3.0], [5.0, 1.0], [np.nan, 1.0]])
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    assert find_inside_any(points, [square, square + 0.5]).tolist() == [True, True, False, False]
    assert find_inside_any(np.array([[0.5, 2.0], [2.0, 0.5]]), [square[[0, 2, 1, 3]]]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("keys", "reported"),
    [
        ({"exclude": [LEFT, [[600.0, 0.0], [1279.0, 0.0], [1279.0, 719.0], [600.0, 719.0]]]}, "nothing is left"),
        ({"exclude": [[[2000.0, 0.0], [2100.0, 0.0], [2100.0, 50.0]]]}, "polygon 1 is outside the image of 1280 x 720"),
        ({"exclude": [[[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]]]}, "has 2 different corners"),
        ({"exclude": [[[0.0, 0.0], [10.0, float("nan")], [0.0, 5.0]]]}, "finite number"),
        ({"exclude_s": [[3.0, 2.0]]}, "ends before it begins"),
        ({"exclude_s": [[0.0, 60.0]]}, "exclude_s = [[0.0, 60.0]]: it saw people only from 0.0 to 0.9 s"),
    ],
)
def test_what_leaves_nothing_or_says_nothing_is_an_error_that_names_the_camera(tmp_path, keys, reported):
    with pytest.raises(InputError) as error:
        read(scene_of_two(tmp_path, **keys))
    assert reported in str(error.value)
    assert "cameras.A" in str(error.value)


def test_keypoints_alone_stand_on_their_lowest_detected_one(tmp_path):
    xy = np.zeros((2, 17, 2))
    xy[:, :3] = [[240.0, 210.0], [260.0, 300.0], [250.0, 395.0]]
    xy[1, :, 0] += 650.0
    score = np.zeros((2, 17))
    score[:, :3] = 1.0
    joints = Keypoints(np.array([1, 1]), np.array([1, 2]), xy, score)
    assert feet_of_keypoints(joints).tolist() == [[250.0, 395.0], [900.0, 395.0]]
    path = scene_of_two(tmp_path, exclude=[LEFT], keypoints="A.json")
    write_keypoints(tmp_path / "A.json", joints)
    assert read(path).observations["A"].keypoints.xy[:, 0].tolist() == [[890.0, 210.0]]


MOVE = Move("C2", 11.0, turn_deg=(0.0, 8.0, 0.0))


@cache
def simulated() -> SimulatedScene:
    options = SimulationOptions(seconds=22.0, people=6, box_noise=0.02, seed=5)
    return simulate(options, film_disturbed(options, [MOVE]))


def written(folder: Path, *, fps: bool = True, keypoints: bool = False, **keys: float) -> Path:
    path = write_simulated(simulated(), folder / "scene", keypoints=keypoints)
    content = tomllib.loads(path.read_text())
    content["cameras"]["C2"] |= keys
    if not fps:
        del content["scene"]["fps"]
    path.write_text(tomli_w.dumps(content))
    return path


@pytest.mark.system
def test_either_pose_of_a_camera_that_was_moved_can_be_had(tmp_path):
    before, after = simulated().rig, rig_after(simulated().rig, [MOVE])
    for name, keys, true in (("before", {"until_s": 10.8}, before), ("after", {"from_s": 11.2}, after)):
        calibration = passerby.calibrate(written(tmp_path / name, **keys))
        assert calibration.verdict == "accepted", calibration.reasons
        found = compare(calibration.rig, true)
        assert found.similarity.mean_position_mm < 60
        assert found.similarity.mean_orientation_deg < 0.4


@pytest.mark.slow
def test_frames_are_counted_from_the_recording_s_own_beginning(tmp_path):
    seen = read_inputs(Scene.load(written(tmp_path, keypoints=True, from_s=2.0, until_s=4.0))).observations
    for part in (seen["C2"].boxes, seen["C2"].keypoints):
        assert (part.frame.min(), part.frame.max()) == (11, 21)
    assert seen["C1"].boxes.frame.max() == 110


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"from_s": 4.0, "until_s": 4.0}, "from_s = 4 is not before until_s = 4: nothing would be left"),
        ({"from_s": 100.0}, "[cameras.C2] from_s = 100: it saw people only from 0.0 to 21.8 s, so nothing is left"),
        ({"from_s": 4.0}, "[cameras.C2] from_s: its frame rate is not known: set fps there, or under [scene] set fps to it"),
        ({"from_s": -1.0}, "[cameras.C2] from_s is -1.0"),
        ({"until_s": float("nan")}, "[cameras.C2] until_s"),
    ],
)
def test_seconds_that_leave_nothing_or_lack_a_frame_rate_are_an_error(tmp_path, keys, told):
    path = written(tmp_path, fps="frame rate" not in told, **keys)
    with pytest.raises(InputError) as error:
        read_inputs(Scene.load(path))
    assert told in str(error.value)
