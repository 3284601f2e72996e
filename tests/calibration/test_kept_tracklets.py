"""Kept tracklets are those that would be found, or they are not used."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.association import camera_tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.calibration import kept_tracklets
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.simulation import SimulatedScene
from support.scenes.people_and_rigs import simulated

FPS = 5.0


@pytest.fixture(scope="module")
def scene() -> SimulatedScene:
    return simulated("terrace", 6.0, 5, people=4)


def nameless(found: CameraObservations, *, boxes: bool = True) -> CameraObservations:
    """Detections, or joints alone."""
    joints = replace(found.keypoints, identity=np.full(len(found.keypoints), UNKNOWN))
    kept = replace(found.boxes, identity=np.full(len(found.boxes), UNKNOWN)) if boxes else Boxes.empty()
    return CameraObservations(kept, joints)


def built(scene: SimulatedScene, keep: Path | None, *, boxes: bool = True, fps: float = FPS) -> list[CameraTracklets]:
    names = scene.rig.names
    seen = Observations({name: nameless(scene.observations[name], boxes=boxes) for name in names}, fps)
    clocks = {name: Clock(fps) for name in names}
    kept = None if keep is None else kept_tracklets.KeptTracklets(keep / kept_tracklets.FOLDER)
    return build_tracklets(scene.rig, seen, clocks, 1.72, np.random.default_rng(3), kept=kept)


def assert_same(found: CameraTracklets, other: CameraTracklets) -> None:
    for one, two in ((found.seen.boxes, other.seen.boxes), (found.seen.keypoints, other.seen.keypoints)):
        np.testing.assert_array_equal(one.identity, two.identity)
        np.testing.assert_array_equal(one.frame, two.frame)
    for part, its in zip(found.continued, other.continued, strict=True):
        np.testing.assert_array_equal(part, its)
    assert (found.level.up == other.level.up).all()
    assert found.n_tracklets == other.n_tracklets > 0


@pytest.mark.parametrize("boxes", [True, False])
def test_kept_tracklets_are_those_that_are_found(
    scene: SimulatedScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boxes: bool
) -> None:
    without = built(scene, None, boxes=boxes)
    first = built(scene, tmp_path, boxes=boxes)

    def fails(*_: object) -> None:
        raise AssertionError("sought anew")

    monkeypatch.setattr(camera_tracklets, "_tracked", fails)
    again = built(scene, tmp_path, boxes=boxes)
    for one, two, three in zip(without, first, again, strict=True):
        assert_same(one, two)
        assert_same(one, three)


def test_other_people_and_another_rate_are_sought_anew(scene: SimulatedScene, tmp_path: Path) -> None:
    files = []
    for fps, boxes in ((FPS, True), (2 * FPS, True), (FPS, False)):
        built(scene, tmp_path, fps=fps, boxes=boxes)
        files.append(len(list((tmp_path / kept_tracklets.FOLDER).iterdir())))
    cameras = len(scene.rig)
    assert files == [cameras, 2 * cameras, 3 * cameras]
    known = kept_tracklets.KeptTracklets(tmp_path / kept_tracklets.FOLDER)
    own = nameless(scene.observations[scene.rig.names[0]])
    assert known.has(own, FPS)
    moved = replace(own, boxes=replace(own.boxes, ltwh=own.boxes.ltwh + 0.25))
    assert not known.has(moved, FPS)
    assert not known.has(replace(own, keypoints=Keypoints.empty()), FPS)


@pytest.mark.parametrize("damage", ["empty", "nonsense", "cut", "float", "short", "negative", "pickled"])
def test_a_damaged_file_is_not_used(scene: SimulatedScene, tmp_path: Path, damage: str) -> None:
    own, none = nameless(scene.observations[scene.rig.names[0]]), np.zeros(0, np.int64)
    kept, each = kept_tracklets.KeptTracklets(tmp_path), np.arange(len(own.boxes))
    kept.save(own, FPS, (replace(own, boxes=replace(own.boxes, identity=each)), (none, none)))
    [path] = tmp_path.iterdir()
    assert kept.load(own, FPS) is not None
    written = {"empty": b"", "nonsense": b"PK nonsense", "cut": path.read_bytes()[:-20]}
    boxes = {"float": np.ones(len(each)), "short": np.arange(3), "negative": np.append(each[:-1], UNKNOWN - 1),
             "pickled": np.array([{}], dtype=object)}  # fmt: skip
    if damage in written:
        path.write_bytes(written[damage])
    else:
        np.savez(path, boxes=boxes[damage], joints=own.keypoints.identity, ends=none, begins=none)
    assert kept.load(own, FPS) is None


RATES = (1.0, 2.0, 3.0, 4.0, 5.0)


def saved(scene: SimulatedScene, folder: Path, cameras: int, used_again: float | None = None) -> list[float]:
    """Which of files saved one after the other are left; one of them is used before the last is saved."""
    own, none = nameless(scene.observations[scene.rig.names[0]]), np.zeros(0, np.int64)
    kept = kept_tracklets.KeptTracklets(folder, cameras)
    for fps in RATES:
        if fps == RATES[-1] and used_again is not None:
            assert kept.load(own, used_again) is not None
        kept.save(own, fps, (own, (none, none)))
    return [fps for fps in RATES if kept.has(own, fps)]


@pytest.mark.parametrize(
    ("cameras", "most", "of_camera", "used_again", "left"),
    [(1, 3, 2, None, RATES[-3:]), (2, 3, 2, None, RATES[-4:]), (3, 3, 2, None, RATES), (1, 4, 1, 1.0, (1.0, 3.0, 4.0, 5.0))],
)
def test_as_many_files_are_kept_as_the_cameras_need_and_those_that_were_used(
    scene, tmp_path, monkeypatch, cameras, most, of_camera, used_again, left
) -> None:
    monkeypatch.setattr(kept_tracklets, "KEPT", most)
    monkeypatch.setattr(kept_tracklets, "KEPT_OF_CAMERA", of_camera)
    assert saved(scene, tmp_path, cameras, used_again) == list(left)
