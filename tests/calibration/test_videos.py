"""From videos to a rig: mixed sources, rates, clocks, networks, and what is told meanwhile."""

import hashlib
import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.calibration.calibrate import calibrate
from passerby.cli.main import run
from passerby.cli.terminal import stages
from passerby.common import parallel
from passerby.common.progress import Forward, silent
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.text_formats import to_json
from passerby.perception.video import probe
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_inputs
from passerby.scene.reading import read_camera
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor, picture_rate, plan_of
from support.networks import crop_networks as crop_models
from support.networks import yolox as yolox_files
from support.networks.model_server import entry, keep_to, know_only
from support.scenes.puppet_videos import film, in_order, pictures, puppets, scene_file, wall, write_video

SECONDS, FPS = 30.0, 3.0


SECONDS, FPS = 30.0, 3.0


@pytest.fixture(scope="module")
def dense():
    """Twice as many pictures as are mostly filmed."""
    return puppets(SECONDS, 2 * FPS, 2, 4)


@pytest.fixture(scope="module")
def folder(dense, tmp_path_factory):
    """`C1.mp4` and `C2.mp4` show every second picture; `C1.txt` and `C2.txt` are the true boxes in them."""
    path = tmp_path_factory.mktemp("videos")
    sparse = {name: boxes.take(boxes.frame % 2 == 1) for name, boxes in dense.boxes.items()}
    sparse = {name: replace(boxes, frame=(boxes.frame + 1) // 2) for name, boxes in sparse.items()}
    film(replace(dense, boxes=sparse, fps=FPS, count=dense.count // 2), path)
    return path


@pytest.fixture
def place(folder, tmp_path):
    """The same files in a folder of its own."""
    for path in folder.iterdir():
        (tmp_path / path.name).symlink_to(path)
    return tmp_path


BOTH = {"C1": "C1.mp4", "C2": "C2.mp4"}


@pytest.fixture(scope="module")
def calibrated(folder):
    return calibrate(scene_file(folder, BOTH))


def assert_near_truth(calibration, folder):
    """After the best similarity; two cameras have one distance, which is the scale; returned."""
    found = compare(calibration.rig, read_rig(folder / "truth.toml"))
    assert calibration.accepted, calibration.reasons
    assert len(found.names) == 2
    assert found.similarity.mean_position_mm < 100
    assert found.similarity.mean_orientation_deg < 1.0
    return found.scale_ratio


def inputs(scene):
    """What a scene's files and videos hold, and what was told."""
    videos = SceneVideoProcessor(None, None, silent)
    return read_inputs(Scene.load(scene), videos), videos


@pytest.mark.smoke
def test_two_videos_become_a_rig(calibrated, folder):
    assert 0.8 < assert_near_truth(calibrated, folder) < 1.2
    told = calibrated.perception
    assert (told["detector"], told["embedder"]) == ("background", "stripes")
    assert told["cameras"]["C1"]["pictures"] == SECONDS * FPS
    assert told["cameras"]["C1"]["boxes"] > 100
    assert set(calibrated.seconds) >= {"reading", "background", "detection", "embedding", "solving"}


def test_processes_and_a_folder_to_keep_decide_nothing(calibrated, folder, tmp_path):
    context = multiprocessing.get_context("spawn")
    told = []

    def tell(stage, done=0, total=0, *, part=""):
        told.append((stage, part, done, total))

    with ProcessPoolExecutor(2, context) as executor:
        apart = calibrate(folder / "scene.toml", executor=executor, keep=tmp_path, progress=tell)
    assert to_json(apart.to_dict()) == to_json(calibrated.to_dict())
    assert sorted(path.name for path in (tmp_path / "perception").iterdir()) == ["C1", "C2"]
    assert not list(tmp_path.rglob("progress"))
    watching = [(part, done, total) for stage, part, done, total in told if stage == "processing videos"]
    # 90 pictures are looked at; the empty scene is learnt from 60, each as long as three.
    assert watching[:2] == [("C1", 0, 270), ("C2", 0, 270)]
    assert {total for _, _, total in watching} == {270}
    assert_forward(watching)


def assert_forward(told):
    """Counts of parts (part, done, total), and their sums, never run backwards, and in the end all is done."""
    known = {}
    for part, done, total in told:
        before = known.get(part, (0, 0))
        assert done >= before[0], (part, before, done, total)
        assert total >= before[1], (part, before, done, total)
        assert not total or done <= total
        known[part] = done, total
    assert all(done == total > 0 for done, total in known.values()), known


@given(
    st.lists(
        st.tuples(st.sampled_from("abc"), st.integers(0, 50), st.sampled_from([0, 20, 30, 40])) | st.sampled_from("abc"),
        max_size=40,
    )
)
def test_counts_in_any_order_never_run_backwards(events):
    """Late, twice, out of order, of unknown total, or after the end: what is told only grows."""
    told = []
    forward = Forward(lambda stage, done=0, total=0, *, part="": told.append((part, done, total)), "watching")
    for part in "abc":
        forward(part, 0, 30)
    for event in events:
        if isinstance(event, str):
            forward.finish(event)
        else:
            forward(*event)
    sums, known = [], {}
    for part, done, total in told:
        known[part] = done, total
        sums.append((sum(d for d, _ in known.values()), len(known)))
    assert sums == sorted(sums)
    for part in "abc":
        forward.finish(part)
    assert_forward(told)


def test_times_of_a_variable_rate_are_honoured(dense, calibrated, folder, place):
    """Half of the pictures of camera C1 are left out, here and there: by their count, people would jump and stand."""
    chosen = [0, *np.sort(np.random.default_rng(0).choice(np.arange(1, dense.count), 89, replace=False)).tolist()]
    shown = (picture for k, picture in enumerate(pictures(dense, "C1")) if k in set(chosen))
    write_video(place / "variable.mp4", shown, FPS, iter([k / dense.fps + 1e-3 * (k % 7) for k in chosen]))
    assert probe(place / "variable.mp4").variable
    scale = assert_near_truth(calibrate(scene_file(place, {**BOTH, "C1": "variable.mp4"})), folder)
    assert scale == pytest.approx(assert_near_truth(calibrated, folder), abs=0.08)


@pytest.mark.parametrize(("fps", "count"), [("0.5", 15), ("1", 30), ("3", 90), ("30", 90), ("1.4", 45)])
def test_pictures_to_look_at_in_a_second(place, fps, count):
    scene = Scene.load(scene_file(place, BOTH, perception=f'detector = "background"\nfps = {fps}'))
    reading = read_camera(scene, "C1")
    rate = picture_rate(scene, reading, reading.video)
    assert rate * SECONDS == pytest.approx(count)


@pytest.mark.parametrize(
    ("seconds", "clock_fps", "believed", "rate"),
    [
        (3600.0, 30.0, None, 5.0),  # five a second
        (3600.0, 24.0, None, 4.8),  # a whole fraction of the video's own
        (20.0, 30.0, None, 15.0),  # three hundred in all
        (2.0, 30.0, None, 30.0),  # all there are
        (None, 30.0, None, 5.0),
        (3600.0, 12.5, None, 6.25),
        (3600.0, 12.5 * (1 + 1e-12), None, 6.25),  # of images, one over their step
        # The scene file says that the video runs at half its speed: 10 of its seconds are 20.
        (3600.0, 30.0, 15.0, 10.0),
    ],
)
def test_pictures_to_look_at_unless_somebody_says(place, seconds, clock_fps, believed, rate):
    scene = Scene.load(scene_file(place, BOTH))
    reading = read_camera(scene, "C1")
    reading.fps = believed or clock_fps
    info = replace(reading.video, seconds=seconds, clock_fps=clock_fps, average_fps=clock_fps)
    assert picture_rate(scene, reading, info) == pytest.approx(rate)
    if seconds == 20.0:  # a network takes longer: half as many
        assert picture_rate(scene, reading, info, by_network=True) == pytest.approx(rate / 2)


@pytest.mark.slow
def test_a_rate_asked_for_is_what_is_watched(place):
    scene = scene_file(place, {**BOTH, "C2": 'detections = "C2.txt"\nfps = 3'}, perception='detector = "background"\nfps = 1')
    seen, videos = inputs(scene)
    assert videos.figures["cameras"]["C1"]["pictures"] == SECONDS
    assert (np.unique(seen.observations["C1"].boxes.frame) % 3 == 1).all()


@pytest.mark.slow
def test_a_video_beside_boxes_of_another_camera(place, folder):
    cameras = {"C1": "C1.mp4", "C2": 'detections = "C2.txt"'}
    found = calibrate(scene_file(place, cameras, extra="[scene]\nfps = 3\n[association]\nmax_offset_s = 0"))
    assert_near_truth(found, folder)
    assert set(found.perception["cameras"]) == {"C1"}
    assert any("camera C2 has no embeddings" in note for note in found.findings)


@pytest.mark.slow
def test_boxes_get_looks_from_their_video_in_the_order_of_the_file(place, dense):
    cameras = {name: f'tracks = "{name}.txt"\nvideo = "{name}.mp4"' for name in BOTH}
    seen, videos = inputs(scene_file(place, cameras))
    boxes = seen.observations["C1"].boxes
    written = in_order(dense.boxes["C1"].take(dense.boxes["C1"].frame % 2 == 1))
    np.testing.assert_array_equal(boxes.frame, (written.frame + 1) // 2)
    np.testing.assert_array_equal(boxes.identity, written.identity)
    # Puppets of different colours are farther from each other than from themselves. Nothing is told of the very small.
    told = np.linalg.norm(boxes.embedding, axis=1) > 0
    assert told.mean() > 0.8
    first, second = (boxes.embedding[told & (boxes.identity == who)] for who in np.unique(boxes.identity)[:2])
    assert (first @ first.T).mean() > (first @ second.T).mean() + 0.1
    assert set(videos.figures["cameras"]) == set(BOTH)


@pytest.mark.slow
def test_no_video_is_watched_where_nothing_is_wanted_of_it(place):
    cameras = {name: f'tracks = "{name}.txt"\nvideo = "{name}.mp4"' for name in BOTH}
    for perception, mode in (("embedder = 'none'", "combined"), ("", "trajectory"), ("", "given")):
        told = f'[association]\nmode = "{mode}"'
        perception = 'detector = "background"\n' + (perception or 'embedder = "stripes"')
        _, videos = inputs(scene_file(place, cameras, perception=perception, extra=told))
        assert videos.figures == {}


@pytest.mark.slow
def test_the_boxes_of_a_file_are_not_moved(place):
    """Boxes that a detector found are told from the pixel's corner, those of a file from its middle."""
    one = puppets(4.0, 3.0, 2, 2)
    for score, name in enumerate(BOTH, start=1):
        write_boxes(
            place / f"few-{name}.txt", in_order(replace(one.boxes["C1"], score=score / len(BOTH) * one.boxes["C1"].score))
        )
    cameras = {name: f'detections = "few-{name}.txt"\nvideo = "{name}.mp4"' for name in BOTH}
    seen, _ = inputs(scene_file(place, cameras, extra=""))
    plain, _ = inputs(scene_file(place, {name: f'detections = "few-{name}.txt"' for name in BOTH}, extra=""))
    np.testing.assert_array_equal(seen.observations["C1"].boxes.ltwh, plain.observations["C1"].boxes.ltwh)
    assert seen.observations["C1"].boxes.embedding is not None


def blue_scene(place):
    """Two videos of somebody blue, a detector that finds what is bright blue, and a network whose joints stand over each other
    in the middle of its crop. Returns the cameras.
    """
    yolox_files.bright_file(place / "people.onnx", 8.0, 16.0)
    heights = np.linspace(0.25, 0.75, 17)
    answer = np.column_stack([heights, np.full(17, 0.5), np.full(17, 0.9)])
    crop_models.fixed(place / "joints.onnx", {"joints": answer[None, None]}, [1, 32, 32, 3])
    behind = wall((360, 288), 4) // 4

    def pictures_of(step):
        for k in range(12):
            picture = behind.copy()
            picture[90:180, 45 + step * k : 90 + step * k] = (255, 0, 0)
            yield picture

    for name, step in (("blue1", 4), ("blue2", 6)):
        write_video(place / f"{name}.mp4", pictures_of(step), FPS)
    return {"C1": "blue1.mp4", "C2": "blue2.mp4"}


@pytest.mark.slow
def test_joints_by_default(place, tmp_path, monkeypatch):
    """Where a network for joints is at hand it is used, on a budget; `check` says so."""
    cameras = blue_scene(place)
    perception = 'detector = "people.onnx"\nembedder = "none"\nmin_score = 0.6\n'
    path = scene_file(place, cameras, perception=perception)
    keep_to(tmp_path, monkeypatch)
    know_only([], monkeypatch)
    monkeypatch.setattr("passerby.perception.plan.catalogue", lambda: known)
    known = ()
    monkeypatch.setattr("passerby.perception.plan.default_of", lambda role: None)
    without, videos = inputs(path)
    assert videos.figures["keypoints"] == "none"
    assert videos.notes == []
    assert check_scene(path).perception["keypoints"] == "none"

    content = (place / "joints.onnx").read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    known = (entry("points", "keypoints", sha256=sha256, bytes=len(content), input={"padding": 0}),)
    know_only(known, monkeypatch)
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "points.onnx").write_bytes(content)
    monkeypatch.setenv("PASSERBY_MODELS", str(tmp_path / "models"))
    assert check_scene(path).perception["keypoints"]["network"] == "points"
    seen, videos = inputs(path)
    assert videos.figures["keypoints"]["network"] == "points"
    for name in cameras:
        # A short recording: there is enough for nearly all times, and of boxes that lie over each other the nearest.
        assert len(without.observations[name].boxes) > 100
        assert 10 <= len(seen.observations[name].keypoints) <= 12

    monkeypatch.setattr("passerby.perception.plan.CROPS_AT_LEAST", 0.5)
    thrifty = scene_file(place, cameras, perception=f"{perception}keypoints_per_s = 1")
    times = [inputs(thrifty)[0].observations[name].keypoints.frame.tolist() for name in cameras]
    assert 0 < len(times[0]) < 10
    assert times[0] == times[1], "both cameras at the same times"
    everybody = scene_file(place, cameras, perception=f"{perception}keypoints = 'points'")
    assert len(inputs(everybody)[0].observations["C1"].keypoints) == len(without.observations["C1"].boxes)
    few = scene_file(place, cameras, perception=f"{perception}keypoints = 'points'\nkeypoints_per_s = 1")
    assert inputs(few)[0].observations["C1"].keypoints.frame.tolist() == times[0]

    # One camera's joints are no points in space.
    alone = scene_file(place, {"C1": cameras["C1"], "C2": 'tracks = "C2.txt"\nfps = 5'}, perception=perception)
    assert inputs(alone)[1].figures["keypoints"] == "none"
    assert check_scene(alone).perception["keypoints"] == "none"


def test_networks_by_path_and_joints(place):
    perception = 'detector = "people.onnx"\nembedder = "none"\nkeypoints = "joints.onnx"\nmin_score = 0.6'
    seen, videos = inputs(scene_file(place, blue_scene(place), perception=perception))
    assert videos.figures["detector"]["network"] == "people.onnx"
    assert videos.figures["keypoints"]["network"] == "joints.onnx"
    for name, step in (("C1", 4), ("C2", 6)):
        boxes, joints = seen.observations[name].boxes, seen.observations[name].keypoints
        assert set(boxes.frame) == set(range(1, 13))
        np.testing.assert_array_equal(joints.frame, boxes.frame)
        left, top, width, height = boxes.ltwh.T
        middle = np.column_stack([left + width / 2, top + height / 2])
        blue = np.column_stack([67.0 + step * (boxes.frame - 1), np.full(len(boxes), 134.5)])
        assert (np.abs(middle - blue) < (45, 60)).all()
        assert joints.xy.shape[1:] == (17, 2)
        np.testing.assert_allclose(joints.xy[:, 8], middle, atol=1.0)
        np.testing.assert_allclose(joints.score, 0.9, atol=1e-6)


def nothing_to_be_had(tmp_path, monkeypatch):
    """Models are known, but their server does not answer."""
    keep_to(tmp_path / "cache", monkeypatch)
    url = "http://127.0.0.1:9/models/tiny.onnx"
    know_only([entry("tiny", url=url), entry("looks", "embedder", url=url)], monkeypatch)


@pytest.mark.slow
def test_without_any_network_there_are_notes(place, tmp_path, monkeypatch, capsys):
    nothing_to_be_had(tmp_path, monkeypatch)
    monkeypatch.setattr(parallel, "pays", lambda *measures: False)
    scene = scene_file(place, BOTH, perception='detector = "auto"\nembedder = "auto"\nfps = 1')
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "out")]) in (0, 3)
    out, errors = capsys.readouterr()
    assert "error" not in errors
    assert [line for line in errors.splitlines() if line.startswith("note: tiny is not on this computer")]
    notes = [line for line in out.splitlines() if line.startswith("note: ")]
    assert len(notes) == 2
    assert notes[0].startswith("note: tiny is not on this computer and cannot be fetched: ")
    assert notes[0].endswith("people are detected by background subtraction, without a neural network")
    assert notes[1].endswith("appearance is described by colour histograms of horizontal stripes, without a neural network")


@pytest.mark.parametrize("verbose", [False, True])
def test_a_log_tells_at_once_what_cannot_be_had(place, tmp_path, monkeypatch, capsys, verbose):
    nothing_to_be_had(tmp_path, monkeypatch)
    scene = Scene.load(scene_file(place, BOTH, perception='detector = "auto"\nembedder = "none"\nfps = 1'))
    with stages(verbose) as tell:
        plan_of(scene, (), tell)
    lines = capsys.readouterr().err.splitlines()
    assert "people are detected by background subtraction, without a neural network" in lines[-1]
    assert lines[:-1] == (["fetching tiny.onnx (kB): 300", "fetching tiny.onnx (kB): failed"] if verbose else [])


def test_a_bar_shows_a_download_that_failed_as_failed_and_each_camera_by_its_name(monkeypatch, capsys, place, tmp_path):
    """On standard error alone; names are no markup."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    nothing_to_be_had(tmp_path, monkeypatch)
    scene = Scene.load(scene_file(place, BOTH, perception='detector = "auto"\nembedder = "none"\nfps = 1'))
    with stages() as tell:
        tell("reading")
        plan_of(scene, (), tell)
        tell("watching", 3, 10, part="C1")
        tell("watching", 4, 20, part="[C2]")
    out, errors = capsys.readouterr()
    assert not out
    assert "watching C1" in errors
    assert "watching [C2]" in errors
    lines = [line for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", errors).splitlines() if "fetching" in line]
    assert [line for line in lines if "✗ fetching tiny.onnx (kB): failed" in line]
    assert not [line for line in lines if "•" in line]


def test_a_network_that_was_named_is_not_left_out(place, tmp_path, monkeypatch, capsys):
    nothing_to_be_had(tmp_path, monkeypatch)
    scene = scene_file(place, BOTH, perception='detector = "tiny"')
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        f"error: {scene}: [perception] detector = 'tiny': tiny is not on this computer and cannot be fetched"
    )
    assert not (tmp_path / "out").exists()
