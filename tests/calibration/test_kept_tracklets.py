"""Kept tracklets are those that would be found, or they are not used; a run with them writes what one without them writes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.association import camera_tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.calibration import kept_tracklets
from passerby.cli.main import run
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.interchange.rig_toml import read_rig
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


@pytest.mark.parametrize(("cameras", "saved", "all_left"), [(1, 20, True), (1, 150, False), (40, 150, True)])
def test_as_many_files_are_kept_as_the_cameras_need_and_those_that_were_used(
    scene: SimulatedScene, tmp_path: Path, cameras: int, saved: int, all_left: bool
) -> None:
    """Else those that were used longest ago go: of these rates, the second is used before every further one."""
    own, none = nameless(scene.observations[scene.rig.names[0]]), np.zeros(0, np.int64)
    own = replace(own, boxes=own.boxes.take(slice(5)), keypoints=Keypoints.empty())
    kept = kept_tracklets.KeptTracklets(tmp_path, cameras)
    rates = [float(rate) for rate in range(1, saved + 1)]
    for rate in rates:
        assert rate <= 2.0 or kept.load(own, 2.0) is not None
        kept.save(own, rate, (own, (none, none)))
    left = [rate for rate in rates if kept.has(own, rate)]
    if all_left:
        assert left == rates
    else:
        assert 10 < len(left) < saved
        assert left == [2.0, *rates[-len(left) + 1 :]]


@pytest.mark.slow
def test_a_new_length_gives_the_files_of_a_run_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ["--people", "4", "--seconds", "10", "--box-noise", "0.02", "--seed", "713", "--unrelated-ids"]
    assert run(["simulate", "-o", str(tmp_path / "scene"), *options]) == 0
    scene = tmp_path / "scene" / "scene.toml"
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "again")]) in (0, 3)
    truth = read_rig(tmp_path / "scene" / "truth.toml")
    ends = np.mean([camera.centre for camera in truth], axis=0) * [1, 1, 0] + [[-2.0, -2.5, 0.0], [2.0, 2.5, 0.0]]
    marks = ", ".join(f"{name} = {truth[name].project(ends).round(2).tolist()}" for name in truth.names[:2])
    with scene.open("a") as file:
        file.write(f"\n[[scale.lengths]]\nmetres = 6.0\nsd_m = 0.02\npoints = {{ {marks} }}\n")
    used: list[bool] = []
    load = kept_tracklets.KeptTracklets.load

    def counted(self, seen, fps):
        found = load(self, seen, fps)
        used.append(found is not None)
        return found

    monkeypatch.setattr(kept_tracklets.KeptTracklets, "load", counted)
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "again")]) in (0, 3)
    assert used
    assert all(used)
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "new")]) in (0, 3)
    files = [path.relative_to(tmp_path / "new") for path in (tmp_path / "new").rglob("*") if path.is_file()]
    assert Path("rig.toml") in files
    for path in files:
        assert (tmp_path / "again" / path).read_bytes() == (tmp_path / "new" / path).read_bytes(), path
