"""One camera under two names is told, whatever became of the copy; two cameras that are two are not accused."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.findings.texts import text_of
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.scene.check import check_scene
from passerby.scene.same_content import doubts_of_same_place, find_same_contents
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.options import MAX_CLOCK_OFFSET_S
from support.scenes.handmade_files import rows, write_scene


@cache
def scene(preset: str = "terrace", seed: int = 1) -> SimulatedScene:
    return simulate(SimulationOptions(preset=preset, seconds=30.0, people=6, box_noise=0.02, missing=0.05, seed=seed))


def found_twice(boxes: Boxes, noise: float = 0.02, missing: float = 0.1) -> Boxes:
    """The same people by another run of a detector."""
    rng = np.random.default_rng(7)
    boxes = boxes.take(np.flatnonzero(rng.random(len(boxes)) > missing))
    edges = np.column_stack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])
    edges += rng.normal(0, noise, edges.shape) * boxes.ltwh[:, 3:]
    return replace(boxes, ltwh=np.column_stack([edges[:, :2], np.maximum(edges[:, 2:] - edges[:, :2], 1.0)]))


def half(lens: Lens) -> Lens:
    return replace(lens, size=(lens.size[0] // 2, lens.size[1] // 2), matrix=lens.matrix * [[0.5], [0.5], [1.0]])


def pair(change: Callable[[Boxes], Boxes], lens: Callable[[Lens], Lens] = lambda lens: lens, fps: float = 5.0) -> list[str]:
    """The doubts about a camera and a changed copy of it."""
    made = scene()
    own, boxes = made.rig["C1"].lens, made.observations["C1"].boxes
    rig = Rig((Camera("A", own), Camera("B", lens(own))))
    seen = {"A": CameraObservations(boxes), "B": CameraObservations(change(boxes))}
    clocks = {"A": Clock(5.0), "B": Clock(fps)}
    return [text_of(one.finding) for one in find_same_contents(rig, Observations(seen, 5.0, clocks))]


def at(boxes: Boxes, factor: float, noise: bool = False) -> Boxes:
    moved = replace(boxes, ltwh=boxes.ltwh * factor)
    return found_twice(moved) if noise else moved


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "lens", "told"),
    [
        (lambda b: b, None, "other: give"),
        (lambda b: replace(b, ltwh=np.round(b.ltwh)), None, "other: give"),
        (lambda b: replace(b, identity=b.identity + 100), None, "other: give"),
        (found_twice, None, "other: give"),
        (lambda b: found_twice(b, 0.04), None, "other: give"),
        (lambda b: at(b, 0.5), half, "0.50 times as large: give"),
        (lambda b: at(b, 0.5, noise=True), half, "0.50 times as large: give"),
        (lambda b: at(b, 0.5, noise=True), None, "0.50 times as large: give"),
        (lambda b: replace(b, frame=b.frame + 17), None, "3.4 s later: give"),
        (lambda b: found_twice(replace(b, frame=b.frame + 17)), None, "3.4 s later: give"),
        (lambda b: replace(b.take(b.frame > 30), frame=b.frame[b.frame > 30] - 30), None, "6.0 s earlier: give"),
        (lambda b: replace(b, ltwh=b.ltwh * 1.3 - [100, 50, 0, 0]), None, "1.30 times as large: give"),
    ],
)
def test_a_copy_is_told(change: Callable[[Boxes], Boxes], lens: Callable[[Lens], Lens] | None, told: str) -> None:
    (sentence,) = pair(change, lens or (lambda own: own))
    assert "cameras A and B show the same" in sentence
    assert told in sentence
    assert "delete [cameras.B]" in sentence


def test_a_copy_at_another_frame_rate_is_told() -> None:
    (sentence,) = pair(lambda b: replace(b, frame=5 * (b.frame - 1) + 1), fps=25.0)
    assert sentence.endswith("in the images of the other: give each camera a recording of its own, or delete [cameras.B]")


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["terrace", "basketball", "construction"])
@pytest.mark.parametrize("seed", [1, 2])
def test_cameras_of_a_scene_are_not_accused(preset: str, seed: int) -> None:
    made = scene(preset, seed)
    assert find_same_contents(made.rig, made.observations) == []


def beside(rig: Rig, shift: tuple[float, float, float]) -> Rig:
    """The first camera and one of its kind beside it, metres in its own frame."""
    own = rig["C1"]
    other = Pose.from_centre(own.pose.R_cw, own.pose.centre + own.pose.R_cw.T @ np.array(shift))
    return Rig((own, Camera("C2", own.lens, other)))


def seen_by(rig: Rig, made: SimulatedScene, noise: float) -> Observations:
    """Whole people of a scene as boxes of two cameras that stand elsewhere."""
    rng = np.random.default_rng(3)
    cameras = {}
    for camera in rig:
        found = []
        for t, frame in enumerate(made.frames):
            for p, identity in enumerate(made.identities):
                pixels = camera.project(made.joints3d[t, p])
                if not np.isfinite(pixels).all() or (pixels < 0).any() or (pixels > camera.lens.size).any():
                    continue
                low, high = pixels.min(axis=0), pixels.max(axis=0)
                edges = np.r_[low, high] + rng.normal(0, noise, 4) * (high - low)[1]
                found.append([frame, identity, *edges[:2], *np.maximum(edges[2:] - edges[:2], 1)])
        table = np.array(found)
        cameras[camera.name] = CameraObservations(Boxes(table[:, 0], table[:, 1], table[:, 2:], np.ones(len(table))))
    return Observations(cameras, 5.0)


@pytest.mark.parametrize("shift", [(0.07, 0, 0), (0.12, 0, 0), (0.5, 0, 0), (2.0, 0, 0), (0, 0.1, 0), (0, 0.5, 0)])
@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_a_pair_side_by_side_is_not_accused(shift: tuple[float, float, float], noise: float) -> None:
    made = scene()
    rig = beside(made.rig, shift)
    assert find_same_contents(rig, seen_by(rig, made, noise)) == []


@pytest.mark.slow
def test_a_pair_that_nothing_tells_apart_is_doubted_by_its_place() -> None:
    made = scene()
    rig = Rig((*beside(made.rig, (0.02, 0.0, 0.0)), made.rig["C3"]))
    few = seen_by(rig, made, 0.06)
    (told,) = doubts_of_same_place(rig, few)
    assert (told.code, told.cameras) == ("same_place", ("C1", "C2"))
    assert told.values["distance_m"] == pytest.approx(0.02, abs=0.005)
    stereo = Rig((*beside(made.rig, (0.12, 0.0, 0.0)), made.rig["C3"]))
    assert doubts_of_same_place(stereo, seen_by(stereo, made, 0.02)) == []


@pytest.mark.system
@pytest.mark.parametrize("given", [True, False])
def test_no_rig_with_one_camera_twice_is_accepted(given: bool) -> None:
    made = scene()
    lenses = {camera.name: camera.lens for camera in made.rig}
    boxes = {name: made.observations[name].boxes for name in made.rig.names}
    found = passerby.calibrate_observations(
        lenses, boxes | {"C4": boxes["C1"]}, fps=5.0, association={"mode": "given" if given else "combined"}
    )
    assert found.verdict != "accepted"
    (same,) = [doubt for doubt in found.doubts if doubt.code == "same_recording"]
    assert same.cameras == ("C1", "C4")
    assert same.values["share"] > 0.995


def written_scene(folder: Path, boxes: dict[str, Boxes]) -> Path:
    """The files of a scene with given identities, all cameras with the lens of the first."""
    lens = scene().rig["C1"].lens
    write_rig(folder / "rig.toml", Rig(tuple(Camera(name, lens) for name in boxes)))
    text = '[scene]\nfps = 5\n[association]\nmode = "given"\n'
    for name, seen in boxes.items():
        write_boxes(folder / f"{name}.txt", seen)
        text += f'[cameras.{name}]\nintrinsics = "rig.toml"\ntracks = "{name}.txt"\n'
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def test_check_tells_of_a_copy_and_exits_as_for_want_of_evidence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = (scene().observations[name].boxes for name in ("C1", "C2"))
    renumbered = replace(first, score=0.5 * first.score)
    assert run(["check", str(written_scene(tmp_path, {"C1": first, "C2": second, "C3": renumbered})), "--json"]) == 3
    (lack,) = json.loads(capsys.readouterr().out)["lacks"]
    assert lack.startswith("cameras C1 and C3 show the same")


@pytest.mark.parametrize("command", ["check", "calibrate"])
def test_a_copied_file_is_an_error_that_names_both_cameras(tmp_path, command, capsys):
    first, second = (scene().observations[name].boxes for name in ("C1", "C2"))
    path = written_scene(tmp_path, {"C1": first, "C2": second, "C3": first})
    assert run([command, str(path), *(["-o", str(tmp_path / "out")] if command == "calibrate" else [])]) == 2
    told = "[cameras.C3] tracks C3.txt has the same content as C1.txt of camera C1: give each camera its own"
    assert capsys.readouterr().err.splitlines() == [f"error: {path}: {told}"]
    assert not (tmp_path / "out").exists()


def test_a_copy_is_an_error_under_another_key_too(tmp_path: Path) -> None:
    copies = {"A.txt": rows(), "B.txt": rows(left=90)}
    path = write_scene(tmp_path, files=copies, association='mode = "combined"')
    (tmp_path / "A.txt").write_text(copies["B.txt"])
    path.write_text(path.read_text().replace('tracks = "B.txt"', 'detections = "B.txt"'))
    (fault,) = check_scene(path).faults
    assert fault.endswith("[cameras.B] detections B.txt has the same content as A.txt of camera A: give each camera its own")


def test_cameras_that_saw_nobody_have_equal_files(tmp_path: Path) -> None:
    first, second = (scene().observations[name].boxes for name in ("C1", "C2"))
    nobody = first.take(np.arange(0))
    path = written_scene(tmp_path, {"C1": first, "C2": second, "C3": nobody, "C4": nobody})
    found = check_scene(path)
    assert not found.faults
    assert [one.cameras for one in found.diagnostics if one.code == "file_empty"] == [("C3",), ("C4",)]


def test_one_file_of_two_cameras_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_scene(tmp_path, files={"A.txt": rows()})
    path.write_text(path.read_text().replace('"B.txt"', '"A.txt"'))
    assert run(["check", str(path)]) == 2
    assert "[cameras.B] tracks A.txt is camera A's too: give each camera its own" in capsys.readouterr().err


def test_copies_may_begin_later_than_clocks_are_searched() -> None:
    assert MAX_CLOCK_OFFSET_S < 12
    (sentence,) = pair(lambda b: replace(b, frame=b.frame + 60))
    assert "12.0 s later" in sentence
