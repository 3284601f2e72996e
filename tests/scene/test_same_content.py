"""One camera under two names and files that change places are found, whatever was changed; others are left alone."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
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
from passerby.scene.camera_input import CameraInput
from passerby.scene.check import check_scene
from passerby.scene.exchanged_streams import ExchangedStreams, find_exchanged_streams
from passerby.scene.same_content import SameContent, doubts_of_same_place, find_same_contents
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Move, film_disturbed
from support.scenes.handmade_files import write_scene
from support.tiers import thinned

Change = Callable[[Boxes], Boxes]


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


def contents(change: Change, lens: Callable[[Lens], Lens] = lambda lens: lens, fps: float = 5.0) -> list[SameContent]:
    """What a camera and a changed copy of it have in common."""
    made = scene()
    own, boxes = made.rig["C1"].lens, made.observations["C1"].boxes
    rig = Rig((Camera("A", own), Camera("B", lens(own))))
    seen = {"A": CameraObservations(boxes), "B": CameraObservations(change(boxes))}
    clocks = {"A": Clock(5.0), "B": Clock(fps)}
    return find_same_contents(rig, Observations(seen, 5.0, clocks))


def smaller(boxes: Boxes) -> Boxes:
    return replace(boxes, ltwh=0.5 * boxes.ltwh)


def later(boxes: Boxes, frames: int) -> Boxes:
    return replace(boxes, frame=boxes.frame + frames)


@pytest.mark.parametrize(
    ("change", "lens", "told"),
    [
        # A copy may begin later than clocks are searched.
        (lambda b: later(b, 60), None, "12.0 s later: give"),
        *(pytest.param(*row, marks=pytest.mark.slow) for row in (
            (lambda b: b, None, "other: give"),
            (lambda b: replace(b, ltwh=np.round(b.ltwh)), None, "other: give"),
            (lambda b: replace(b, identity=b.identity + 100), None, "other: give"),
            (found_twice, None, "other: give"),
            (lambda b: found_twice(b, 0.04), None, "other: give"),
            (smaller, half, "0.50 times as large: give"),
            (lambda b: found_twice(smaller(b)), half, "0.50 times as large: give"),
            (lambda b: found_twice(smaller(b)), None, "0.50 times as large: give"),
            (lambda b: later(b, 17), None, "3.4 s later: give"),
            (lambda b: found_twice(later(b, 17)), None, "3.4 s later: give"),
            (lambda b: later(b.take(b.frame > 30), -30), None, "6.0 s earlier: give"),
            (lambda b: replace(b, ltwh=b.ltwh * 1.3 - [100, 50, 0, 0]), None, "1.30 times as large: give"),
        )),
    ],
)  # fmt: skip
def test_a_copy_is_found_whatever_was_changed(change: Change, lens: Callable[[Lens], Lens] | None, told: str) -> None:
    (found,) = contents(change, lens or (lambda own: own))
    sentence = text_of(found.finding)
    assert "cameras A and B show the same" in sentence
    assert told in sentence
    assert "delete [cameras.B]" in sentence


def test_a_copy_at_another_frame_rate_is_found_and_size_and_time_of_a_copy_are_exact() -> None:
    (found,) = contents(lambda b: replace(b, frame=5 * (b.frame - 1) + 1), fps=25.0)
    end = "in the images of the other: give each camera a recording of its own, or delete [cameras.B]"
    assert text_of(found.finding).endswith(end)
    (found,) = contents(lambda b: later(replace(b, ltwh=b.ltwh * 1.3 - [100, 50, 0, 0]), 60))
    assert (found.share, found.scale, found.later) == (1.0, pytest.approx(1.3, rel=1e-9), 12.0)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["terrace", "basketball", "construction"])
@pytest.mark.parametrize("seed", [1, 2])
def test_cameras_of_a_scene_are_no_copies(preset: str, seed: int) -> None:
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
def test_a_pair_side_by_side_is_no_copy(shift: tuple[float, float, float], noise: float) -> None:
    made = scene()
    rig = beside(made.rig, shift)
    assert find_same_contents(rig, seen_by(rig, made, noise)) == []


@pytest.mark.slow
def test_a_pair_that_nothing_tells_apart_is_doubted_by_its_place() -> None:
    made = scene()
    rig = Rig((*beside(made.rig, (0.02, 0.0, 0.0)), made.rig["C3"]))
    few = seen_by(rig, made, 0.06)
    (found,) = doubts_of_same_place(rig, few)
    assert (found.code, found.cameras) == ("same_place", ("C1", "C2"))
    assert found.values["distance_m"] == pytest.approx(0.02, abs=0.005)
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


def test_check_reports_a_copy_and_ends_as_for_want_of_evidence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cameras without people have equal files, which are no copies."""
    first, second = (scene().observations[name].boxes for name in ("C1", "C2"))
    renumbered, nobody = replace(first, score=0.5 * first.score), first.take(np.arange(0))
    path = written_scene(tmp_path, {"C1": first, "C2": second, "C3": renumbered, "C4": nobody, "C5": nobody})
    assert run(["check", str(path), "--json"]) == 3
    report = json.loads(capsys.readouterr().out)
    assert report["faults"] == []
    assert report["lacks"][0].startswith("cameras C1 and C3 show the same")
    assert [one["cameras"] for one in report["diagnostics"] if one["code"] == "file_empty"] == [["C4"], ["C5"]]


@pytest.mark.parametrize("command", ["check", "calibrate"])
def test_a_copied_file_is_an_error_that_names_both_cameras(tmp_path, command, capsys):
    first, second = (scene().observations[name].boxes for name in ("C1", "C2"))
    path = written_scene(tmp_path, {"C1": first, "C2": second, "C3": first})
    assert run([command, str(path), *(["-o", str(tmp_path / "out")] if command == "calibrate" else [])]) == 2
    told = "[cameras.C3] tracks C3.txt has the same content as C1.txt of camera C1: give each camera its own"
    assert capsys.readouterr().err.splitlines() == [f"error: {path}: {told}"]
    assert not (tmp_path / "out").exists()


def test_a_copied_file_is_an_error_under_another_key_too_and_so_is_one_file_of_two_cameras(tmp_path: Path) -> None:
    path = write_scene(tmp_path, association='mode = "combined"')
    (tmp_path / "A.txt").write_text((tmp_path / "B.txt").read_text())
    text = path.read_text()
    path.write_text(text.replace('tracks = "B.txt"', 'detections = "B.txt"'))
    (fault,) = check_scene(path).faults
    assert fault.endswith("[cameras.B] detections B.txt has the same content as A.txt of camera A: give each camera its own")
    path.write_text(text.replace('"B.txt"', '"A.txt"'))
    with pytest.raises(passerby.InputError, match=r"\[cameras.B\] tracks A.txt is camera A's too: give each camera its own"):
        passerby.calibrate(path)


OPTIONS = SimulationOptions(seconds=16.0, people=7, box_noise=0.02, missing=0.05, false_boxes=0.03, seed=5)
SINCE = 41
TURNS = (Move("C1", 8.0, turn_deg=(0.0, 6.0, 0.0)), Move("C3", 8.0, turn_deg=(0.0, -6.0, 0.0)))


@cache
def filmed(moves: tuple[Move, ...] = ()) -> SimulatedScene:
    return simulate(OPTIONS, film_disturbed(OPTIONS, moves))


def joined(before: Boxes, after: Boxes) -> Boxes:
    """The boxes of one recording before the exchange and of another one from then on."""
    parts = before.take(before.frame < SINCE), after.take(after.frame >= SINCE)
    columns = {one.name for one in fields(Boxes)} - {"embedding"}
    return Boxes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns})


def exchanged(first: str, second: str) -> dict[str, Boxes]:
    boxes = {name: filmed().observations[name].boxes for name in filmed().rig.names}
    own = boxes[first], boxes[second]
    return {**boxes, first: joined(*own), second: joined(*own[::-1])}


def sought(boxes: dict[str, Boxes], fps: float = OPTIONS.fps, given: bool = True) -> list[ExchangedStreams]:
    return find_exchanged_streams([CameraInput(name, boxes=one, fps=fps, given=given) for name, one in boxes.items()])


def test_an_exchange_is_found_with_both_cameras_and_its_time() -> None:
    boxes = exchanged("C1", "C3")
    unknown = {name: replace(one, identity=np.full(len(one), -1)) for name, one in boxes.items()}
    for seen, known in ((boxes, True), (unknown, False)):
        (one,) = sought(seen, given=known)
        assert (set(one.cameras), one.frames) == ({"C1", "C3"}, (SINCE, SINCE))


@pytest.mark.slow
def test_an_exchange_is_a_doubt_about_the_rig() -> None:
    found = passerby.calibrate_observations(filmed().rig, exchanged("C1", "C3"), fps=OPTIONS.fps)
    (one,) = (one for one in found.diagnostics if one.code == "streams_seem_exchanged")
    assert found.verdict != "accepted"
    assert (set(one.cameras), one.values["frames"]) == ({"C1", "C3"}, [SINCE, SINCE])


@thinned("seed", range(3))
def test_wrong_identities_and_noisy_boxes_are_no_exchange(seed: int) -> None:
    """Many boxes then have another identity in the next frame, and places in a crowd are alike by chance."""
    options = SimulationOptions(seconds=40.0, people=12, cameras=6, box_noise=0.06, identity_swaps=0.2, seed=seed)
    made = simulate(options)
    assert not sought({name: camera.boxes for name, camera in made.observations.cameras.items()}, options.fps)


def test_no_exchange_is_found_where_there_is_none() -> None:
    """Nor where two cameras turned at one time, or a recording has a jump, as of a file from which a part was cut out."""
    still, turned = (
        {name: filmed(moves).observations[name].boxes for name in filmed(moves).rig.names} for moves in ((), TURNS)
    )
    own = still["C2"]
    after = own.take(own.frame > SINCE + 20)
    cut = {**still, "C2": joined(own, replace(after, frame=after.frame - 20))}
    assert [sought(boxes) for boxes in (still, turned, cut)] == [[], [], []]
