"""One camera's video, watched: what is kept is not made again, and what is made does not depend on how it was come by."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.core.observations import UNKNOWN, Boxes
from passerby.findings.texts import text_of
from passerby.perception import plan as joint_budget
from passerby.perception import watching
from passerby.perception.networks import Network
from passerby.perception.pictures import Detections
from passerby.perception.plan import Plan
from passerby.perception.video import probe
from passerby.perception.watching import CameraJob
from support.scenes.puppet_videos import wall, write_video

SIZE, FPS, COUNT = (160, 120), 10.0, 50
SEGMENT = 8
LEVELS = np.arange(COUNT) * 5


class Calls:
    """How often each stage was asked."""

    def __init__(self):
        self.pictures, self.appearance, self.joints = [], 0, 0


class Finds:
    """As many people as the number of the picture says, modulo 3; where they are depends on the picture's own brightness."""

    def __init__(self, calls, score):
        self.calls, self.identity = calls, {"finds": score}

    def __call__(self, frame):
        self.calls.pictures.append(frame.number)
        count, level = frame.number % 3, float(frame.picture[:40].mean())
        ltwh = np.array([[10.0 + 30 * k, 20 + level / 10, 20, 50] for k in range(count)]).reshape(-1, 4)
        return Detections(ltwh, np.full(count, self.identity["finds"]))


class Describes:
    """Unit vectors that tell the picture's brightness and where the box is: see `told`."""

    dimensions = 3

    def __init__(self, calls, name):
        self.calls, self.identity = calls, {"describes": name}

    def __call__(self, picture, ltwh):
        self.calls.appearance += 1
        told = np.column_stack([np.full(len(ltwh), picture[:40].mean()), ltwh[:, 0]]) / 500
        return np.column_stack([told, np.sqrt(1 - (told**2).sum(axis=1))]).astype(np.float32)


def told(vectors):
    """(N,) brightness and (N,) left edge."""
    return (500 * vectors[:, :2]).T


class Points:
    joints = ("nose", "left_ankle")
    identity = {"points": 1}  # noqa: RUF012

    def __init__(self, calls):
        self.calls = calls

    def __call__(self, picture, ltwh):
        self.calls.joints += 1
        xy = np.repeat(ltwh[:, None, :2], 2, axis=1)
        # The second person of a picture has no joint that was found.
        return xy, np.repeat((np.arange(len(ltwh)) == 0)[:, None] * 0.9, 2, axis=1)


@pytest.fixture
def calls(monkeypatch):
    counted = Calls()
    monkeypatch.setattr(watching, "SEGMENT", SEGMENT)
    monkeypatch.setattr(watching, "open_detector", lambda network, plan: Finds(counted, plan.min_score))
    monkeypatch.setattr(watching, "open_embedder", lambda network: Describes(counted, network.name))
    monkeypatch.setattr(watching, "open_estimator", lambda network: Points(counted))
    return counted


def pictures():
    behind = wall(SIZE, 3)
    for level in LEVELS:
        picture = behind.copy()
        picture[:40] = level
        yield picture


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return write_video(tmp_path_factory.mktemp("watching") / "a.mp4", pictures(), FPS)


def network(name):
    return Network(name, "embedder", Path("x.onnx"), "0" * 64, "embedding")


@pytest.fixture
def job(video, tmp_path):
    return CameraJob("A", probe(video), FPS, Plan(network("d"), network("e"), network("k")), tmp_path / "shelf")


def watch_camera(job, tell=lambda done, total: None):
    return watching.watch_camera(job, tell)


def find_kept_results(job):
    return watching.find_kept_results(job, lambda done, total: None)


def facts(watched):
    """All that decides what follows."""
    boxes, joints = watched.boxes, watched.keypoints
    arrays = (boxes.frame, boxes.identity, boxes.ltwh, boxes.score, boxes.embedding, joints.frame, joints.xy, joints.score)
    return [None if array is None else (array.dtype, array.shape, array.tobytes()) for array in arrays], watched.summary


def test_what_is_seen(job, calls):
    progress = []
    watched = watch_camera(job, lambda *counts: progress.append(counts))
    assert calls.pictures == list(range(1, COUNT + 1))
    numbers = np.arange(1, COUNT + 1)
    np.testing.assert_array_equal(watched.boxes.frame, np.repeat(numbers, numbers % 3))
    assert (watched.boxes.identity == UNKNOWN).all()
    # From the outer corner of the first pixel to its middle.
    level = LEVELS[watched.boxes.frame - 1]
    np.testing.assert_allclose(watched.boxes.ltwh[:, 1], 19.5 + level / 10, atol=0.3)
    np.testing.assert_allclose(watched.boxes.ltwh[:, 0] % 30, 9.5)
    # Looked at every 0.4 s, from the first picture on.
    looked = (watched.boxes.frame - 1) % 4 == 0
    assert (watched.boxes.embedding[~looked] == 0).all()
    bright, left = told(watched.boxes.embedding[looked])
    np.testing.assert_allclose(bright, level[looked], atol=3)
    np.testing.assert_allclose(left, watched.boxes.ltwh[looked, 0], rtol=1e-5)
    # Joints of those who have any.
    np.testing.assert_array_equal(watched.keypoints.frame, numbers[numbers % 3 > 0])
    assert (watched.keypoints.joints, watched.pictures, progress[-1]) == (Points.joints, COUNT, (COUNT, COUNT))
    assert [done for done, _ in progress] == sorted(done for done, _ in progress)


def test_a_rate_below_the_videos_and_the_threads_of_opencv_are_as_before(job, calls, tmp_path):
    info = probe(write_video(tmp_path / "fast.mp4", pictures(), 25.0))
    before = cv2.getNumThreads()
    cv2.setNumThreads(3)
    try:
        watch_camera(replace(job, info=info, rate=5.0))
        assert cv2.getNumThreads() == 3
    finally:
        cv2.setNumThreads(before)
    assert calls.pictures == list(range(1, COUNT + 1, 5))


def test_what_is_kept_is_read_without_anything_being_made(job, calls):
    assert find_kept_results(job) is None
    assert not calls.pictures
    first = watch_camera(job)
    before = len(calls.pictures), calls.appearance, calls.joints
    assert (facts(watch_camera(job)), facts(find_kept_results(job))) == (facts(first), facts(first))
    assert find_kept_results(replace(job, rate=job.rate / 2)) is None
    assert (len(calls.pictures), calls.appearance, calls.joints) == before


def test_the_same_video_is_known_wherever_it_lies_and_another_of_the_same_name_is_not(job, calls, tmp_path):
    first = watch_camera(job)
    copy = tmp_path / "elsewhere" / "b.mp4"
    copy.parent.mkdir()
    shutil.copyfile(job.info.path, copy)
    os.utime(copy, (1, 1))
    assert facts(watch_camera(replace(job, info=probe(copy)))) == facts(first)
    assert len(calls.pictures) == COUNT
    write_video(copy, (255 - picture for picture in pictures()), FPS)
    watched = watch_camera(replace(job, info=probe(copy)))
    assert len(calls.pictures) == 2 * COUNT
    np.testing.assert_allclose(watched.boxes.ltwh[0, 1], 19.5 + 25.5, atol=0.3)


def stages(job):
    return {folder.name.split("-")[0]: folder for folder in job.shelf.iterdir() if folder.is_dir()}


def test_another_embedder_or_none_keeps_people(job, calls):
    full = watch_camera(job)
    kept, appearance, joints = stages(job), calls.appearance, calls.joints
    parts = {path: path.stat().st_mtime_ns for path in kept["people"].glob("*.npz")}
    watch_camera(replace(job, plan=replace(job.plan, embedder=network("other"))))
    after = stages(job)
    assert (len(calls.pictures), calls.appearance, calls.joints) == (COUNT, 2 * appearance, joints)
    assert {name for name in after if after[name] != kept[name]} == {"looks"}
    # A stage that is used again gets its summary again, but none of its parts.
    assert {path: path.stat().st_mtime_ns for path in after["people"].glob("*.npz")} == parts
    assert not kept["looks"].exists(), "the other embedder's results are forgotten"
    less = watch_camera(replace(job, plan=replace(job.plan, embedder=None, keypoints=None)))
    assert (len(calls.pictures), less.boxes.embedding, len(less.keypoints), set(stages(job))) == (COUNT, None, 0, {"people"})
    np.testing.assert_array_equal(less.boxes.ltwh, full.boxes.ltwh)


@pytest.mark.parametrize("change", ["detector", "rate", "revision"])
def test_what_decides_the_people_makes_all_anew(job, calls, monkeypatch, change):
    watch_camera(job)
    before, kept = calls.appearance, stages(job)
    if change == "revision":
        monkeypatch.setattr(watching, "REVISION", watching.REVISION + 1)
    job = {"detector": replace(job, plan=replace(job.plan, min_score=0.5)), "rate": replace(job, rate=5.0)}.get(change, job)
    watch_camera(job)
    assert len(calls.pictures) == COUNT + (25 if change == "rate" else COUNT)
    assert calls.appearance > before
    assert set(stages(job).values()).isdisjoint(kept.values())


@pytest.mark.slow
@pytest.mark.parametrize("segment", [1, 7, 50, 64])
def test_segments_decide_nothing(job, calls, monkeypatch, tmp_path, segment):
    eights = facts(watch_camera(job))
    monkeypatch.setattr(watching, "SEGMENT", segment)
    assert facts(watch_camera(replace(job, shelf=tmp_path / "other"))) == eights
    # On the same shelf as well: parts of another length are not taken for these.
    assert facts(watch_camera(job)) == eights


def test_a_budget_of_joints_that_what_is_kept_does_not_change(job, calls, monkeypatch):
    """A budget that does not last for all people of the video."""
    for name, value in (("CROPS_AT_LEAST", 2.0), ("MIN_HEIGHT_PX", 20.0), ("SLOT_S", 0.2)):
        monkeypatch.setattr(joint_budget, name, value)
    thrifty = replace(job, plan=replace(job.plan, keypoints_per_s=2.0, min_score=0.5))
    everybody, some = watch_camera(job), watch_camera(thrifty)
    np.testing.assert_array_equal(some.boxes.ltwh, everybody.boxes.ltwh)
    assert 0 < len(some.keypoints) < 0.7 * len(everybody.keypoints)
    same = np.isin(everybody.keypoints.frame, some.keypoints.frame)
    np.testing.assert_array_equal(everybody.keypoints.xy[same], some.keypoints.xy)
    for stage, names in (("joints", ["000002.npz"]), ("people", ["000001.npz"]), ("joints", ["000003.npz", "000005.npz"])):
        for name in names:
            (stages(thrifty)[stage] / name).unlink()
        assert facts(watch_camera(thrifty)) == facts(some)
    other = replace(thrifty, plan=replace(thrifty.plan, keypoints_per_s=4.0))
    assert len(watch_camera(other).keypoints) > len(some.keypoints)


@pytest.mark.slow
def test_what_is_damaged_or_lost_is_made_again_and_no_more(job, calls):
    whole = facts(watch_camera(job))
    for stage, name, pictures_again in (
        ("people", "000003.npz", SEGMENT),
        ("people", "000006.npz", COUNT % SEGMENT),
        ("people", "summary.txt", 0),
        ("looks", "000000.npz", 0),
        ("joints", "summary.txt", 0),
    ):
        for damage in ("cut", "changed", "gone"):
            path, done = stages(job)[stage] / name, len(calls.pictures)
            content = path.read_bytes()
            middle = len(content) // 2
            changed = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
            path.unlink()
            if damage != "gone":
                path.write_bytes(content[:middle] if damage == "cut" else changed)
            assert facts(watch_camera(job)) == whole
            assert len(calls.pictures) - done == pictures_again
            assert path.read_bytes() == content


@pytest.mark.parametrize("calls_until", range(1, COUNT, 7))
def test_a_stop_in_any_segment(job, calls, monkeypatch, tmp_path, calls_until):
    whole = facts(watch_camera(replace(job, shelf=tmp_path / "whole")))
    calls.pictures.clear()

    class StopError(BaseException):
        pass

    def stop(done, total):
        if done == calls_until:
            raise StopError

    with pytest.raises(StopError):
        watch_camera(job, stop)
    assert facts(watch_camera(job)) == whole
    # What was done of the segment at work was lost.
    assert len(calls.pictures) == COUNT + (calls_until - 1) % SEGMENT + 1


def test_given_boxes_get_embeddings_in_the_order_of_their_file(job, calls):
    rng = np.random.default_rng(2)
    frame = rng.permutation(np.repeat(np.arange(1, 2 * COUNT, 2), 2))
    left = rng.uniform(0, 100, len(frame))
    ltwh = np.column_stack([left, np.full((len(frame), 1), 10.0), np.full((len(frame), 2), 30.0)])
    boxes = Boxes(frame, np.arange(len(frame)), ltwh, np.ones(len(frame)))
    watched = watch_camera(replace(job, boxes=boxes))
    assert not calls.pictures
    for name in ("frame", "identity", "ltwh", "score"):
        np.testing.assert_array_equal(getattr(watched.boxes, name), getattr(boxes, name))
    looked = (frame <= COUNT) & ((frame - 1) % 4 == 0)
    assert 10 < looked.sum() < len(frame)
    assert (watched.boxes.embedding[~looked] == 0).all()
    bright, seen_left = told(watched.boxes.embedding[looked])
    np.testing.assert_allclose(seen_left, left[looked], rtol=1e-4)
    np.testing.assert_allclose(bright, LEVELS[frame[looked] - 1], atol=3)
    # Joints carry the ids of their boxes, of which the first of each picture has any.
    assert len(watched.keypoints) == COUNT // 2
    for number, who, xy in zip(watched.keypoints.frame, watched.keypoints.identity, watched.keypoints.xy, strict=True):
        assert frame[who] == number
        np.testing.assert_allclose(xy[0], [left[who], 10.0])


def test_other_given_boxes_are_looked_at_anew(job, calls):
    boxes = Boxes(np.arange(1, 11), np.zeros(10, int), np.tile([5.0, 5, 20, 40], (10, 1)), np.ones(10))
    # Ids and scores decide nothing of how people look.
    other = replace(boxes, score=np.full(10, 0.5), identity=np.arange(10)), replace(boxes, ltwh=boxes.ltwh + 1)
    asked = []
    for given in (boxes, *other):
        watch_camera(replace(job, boxes=given))
        asked.append(calls.appearance)
    assert asked == [asked[0], asked[0], 2 * asked[0]]
    assert asked[0]


def test_a_video_without_people(job, calls, monkeypatch):
    monkeypatch.setattr(Finds, "__call__", lambda self, frame: Detections.none())
    for _ in range(2):
        watched = watch_camera(job)
        assert len(watched.boxes) == len(watched.keypoints) == 0
        assert watched.boxes.embedding.shape == (0, 3)
    assert calls.appearance == 0


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "zoom", "until"), [(30, 1.0, 999), (30, 1.0, 130), (0, 1.2, 999), (0, 0.85, 999)])
def test_a_camera_that_is_moved_or_zooms_is_reported_with_the_time(job, calls, tmp_path, shift, zoom, until):
    fine = np.random.default_rng(5).normal(128, 60, (90, 120, 3)).clip(0, 255).astype(np.uint8)
    wide = cv2.resize(fine, (600, 450), interpolation=cv2.INTER_LINEAR)

    def shown():
        for number in range(200):
            motion = cv2.getRotationMatrix2D((300.0, 225.0), 0.0, zoom if 90 <= number < until else 1.0)
            motion[:, 2] -= (140.0 + (shift if 90 <= number < until else 0), 105.0)
            yield cv2.warpAffine(wide, motion, (320, 240))

    info = probe(write_video(tmp_path / "moved.mp4", shown(), FPS))
    watched = watch_camera(replace(job, info=info))
    faults, findings = watched.faults("A", info), watched.findings("A", info)
    (said,) = faults if until == 999 else [text_of(findings[0])]
    assert not (findings if until == 999 else faults)
    what = "is " if until == 130 else "moves " if shift else f"zooms {'in' if zoom > 1 else 'out'} "
    assert said.startswith(f"{info.path}: camera A: the camera {what}")
    assert 9.0 <= float(said.split(" s after the start")[0].split()[-1]) <= 10.6
    if zoom != 1.0:
        by = f"{max(zoom, 1 / zoom):.2f}"
        assert f" s after the start, by a factor of {by}, and stays so: a fixed focal length is needed: under " in said
    # It is reported from what is kept as well.
    again = watch_camera(replace(job, info=info))
    assert (again.faults("A", info), again.findings("A", info)) == (faults, findings)
