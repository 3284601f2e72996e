"""Boxes in other formats than the stated one, beyond the image for good reasons, and on a coarse grid."""

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import passerby
from passerby.cli.main import run
from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, CueFigures
from passerby.core.observations import FORMATS, LTWH, Boxes, BoxFormat, Keypoints
from passerby.findings.finding import Finding, notice
from passerby.scene.box_interpretations import (
    BoxesAsStated,
    adjust_for_coarse_boxes,
    find_other_formats,
    notice_of_coarse_boxes,
)
from passerby.scene.camera_input import CameraInput
from passerby.scene.inputs import read_inputs
from passerby.scene.people_in_images import doubts_of_people, faults_of_people, findings_of_people
from passerby.scene.reading import input_from_memory
from passerby.scene.scene import Scene
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.write import write_scene as write_simulated
from support.tiers import thinned


@pytest.fixture(scope="module")
def scene() -> SimulatedScene:
    return simulate(SimulationOptions(preset="terrace", seed=3, cameras=4, people=6, seconds=30.0, box_noise=0.02))


def inputs(rig: Rig, boxes: list[Boxes], stated: str = "ltwh") -> tuple[Scene, list[CameraInput]]:
    """A scene in memory with these boxes, and a camera that saw no person where there is one only."""
    names = [*rig.names, *(["empty"] if len(rig) == 1 else [])]
    cameras = {name: {"intrinsics": Path("rig.toml"), "tracks": Path("boxes.txt")} for name in names}
    declared = Scene.model_validate({"scene": {"boxes": stated}, "cameras": cameras, "association": {"mode": "given"}})
    seen = [(camera.name, camera.lens, rows) for camera, rows in zip(rig, boxes, strict=True)]
    return declared, [input_from_memory(declared, name, lens, rows, Keypoints.empty()) for name, lens, rows in seen]


def doubt_of_centres(rig: Rig, boxes: list[Boxes], stated: str = "ltwh") -> Finding | None:
    found = [one for one in doubts_of_people(*inputs(rig, boxes, stated)) if one.code == "boxes_by_centres"]
    assert len(found) <= 1
    return found[0] if found else None


def misread(boxes: Boxes, true: BoxFormat, stated: BoxFormat, size: tuple[int, int]) -> Boxes:
    """The boxes of a file in a format, read in another one; only rows that are boxes in it."""
    ltwh = stated.to_ltwh(true.of_ltwh(boxes.ltwh, size), size)
    kept = (ltwh[:, 2:] > 0).all(axis=1)
    return replace(boxes.take(kept), ltwh=ltwh[kept])


def boxes_of(scene: SimulatedScene, *, by_centres: Collection[str] = ()) -> list[Boxes]:
    out = []
    for name in scene.rig.names:
        boxes = scene.observations[name].boxes
        corner, extent = boxes.ltwh[:, :2], boxes.ltwh[:, 2:]
        ltwh = np.concatenate([corner + extent / 2, extent], axis=1) if name in by_centres else boxes.ltwh
        out.append(replace(boxes, ltwh=ltwh))
    return out


def test_boxes_by_their_centres_are_a_doubt_about_cameras_with_people_at_the_borders(
    scene: SimulatedScene,
) -> None:
    """No person leaves the second and the fourth camera's image at the right."""
    found = doubt_of_centres(scene.rig, boxes_of(scene, by_centres=scene.rig.names))
    assert (found.code, found.severity) == ("boxes_by_centres", "doubt")
    assert set(found.cameras) <= set(scene.rig.names)
    assert found.values["beyond"] >= 20
    for name, told in (("C1", True), ("C2", False), ("C3", True), ("C4", False)):
        found = doubt_of_centres(scene.rig, boxes_of(scene, by_centres=(name,)))
        assert (None if found is None else found.cameras) == ((name,) if told else None)
    for sound in (boxes_of(scene), [Boxes.empty() for _ in scene.rig]):
        assert doubt_of_centres(scene.rig, sound) is None


SIZE = np.array([60.0, 150.0])


def crowd(corner: np.ndarray) -> Boxes:
    """2000 people of one size."""
    return Boxes(
        np.arange(2000), np.ones(2000, dtype=np.int64), np.column_stack([corner, np.tile(SIZE, (2000, 1))]), np.ones(2000)
    )


def test_bodies_that_the_border_cuts_off_are_no_boxes_by_centres(scene: SimulatedScene) -> None:
    """Boxes of whole bodies, half of them outside, at all borders alike."""
    rig = Rig(scene.rig.cameras[:1])
    picture = rig.cameras[0].lens.size
    whole = crowd(np.random.default_rng(0).uniform((0, 0), picture, (2000, 2)) - SIZE / 2)
    assert doubt_of_centres(rig, [whole]) is None
    right = whole.take((whole.ltwh[:, :2] > 0).all(axis=1))
    assert doubt_of_centres(rig, [right]) is None  # some of those at the right and below go beyond by more than half
    moved = right.take((right.ltwh[:, :2] + SIZE < picture).all(axis=1))
    moved = replace(moved, ltwh=moved.ltwh + np.array([30.0, 75.0, 0.0, 0.0]))
    assert doubt_of_centres(rig, [moved]) is not None
    # Read as centres, boxes of left, top, width, height move left and up by half of their size.
    true = crowd(np.random.default_rng(0).uniform((0, 0), picture - SIZE, (2000, 2)))
    found = doubt_of_centres(rig, [misread(true, LTWH, BoxFormat("centres"), picture)], "centres")
    assert (found.values["box_format"], found.values["stated"]) == ("ltwh", "centres")
    assert doubt_of_centres(rig, [true], "centres") is None


def as_stated(scene: SimulatedScene, boxes: list[Boxes], stated: BoxFormat) -> list[BoxesAsStated]:
    return [BoxesAsStated(camera.name, rows, camera.lens.size, stated) for camera, rows in zip(scene.rig, boxes, strict=True)]


@pytest.mark.parametrize("true", [one for one in FORMATS if one.normalised], ids=str)
@pytest.mark.parametrize("stated", [LTWH, BoxFormat("centres")], ids=str)
def test_normalised_boxes_are_certain(scene: SimulatedScene, true: BoxFormat, stated: BoxFormat) -> None:
    boxes = [misread(scene.observations[c.name].boxes, true, stated, c.lens.size) for c in scene.rig]
    (found,) = find_other_formats(as_stated(scene, boxes, stated))
    assert (found.box_format, found.certain, found.cameras) == (true, True, scene.rig.names)
    declared, readings = inputs(scene.rig, boxes, str(stated))
    (fault,) = faults_of_people(declared, readings)
    assert "in shares of the image (0 to 1), not in pixels" in fault
    assert f'"{true}"' in fault
    assert findings_of_people(declared, readings) == []


def test_corners_of_one_camera_name_it_and_rightly_stated_boxes_are_no_fault(scene: SimulatedScene) -> None:
    boxes = boxes_of(scene)
    assert [find_other_formats(as_stated(scene, boxes, one)) for one in FORMATS] == len(FORMATS) * [()]
    shares = BoxFormat("ltwh", True)
    pixels = [misread(own, LTWH, shares, camera.lens.size) for own, camera in zip(boxes, scene.rig, strict=True)]
    (found,) = find_other_formats(as_stated(scene, pixels, shares))
    assert (found.box_format, found.certain) == (LTWH, True)
    boxes[1] = misread(boxes[1], BoxFormat("corners"), LTWH, scene.rig["C2"].lens.size)
    (fault,) = faults_of_people(*inputs(scene.rig, boxes))
    assert fault.startswith("boxes: camera C2: the boxes are left, top, right, bottom")
    assert 'box_format = "corners"' in fault


@pytest.mark.parametrize("box_format", FORMATS, ids=str)
@given(numbers=st.lists(st.tuples(*[st.floats(-500, 3000)] * 2, *[st.floats(1, 900)] * 2), min_size=1, max_size=5))
def test_formats_round_trip(box_format: BoxFormat, numbers: list[tuple[float, ...]]) -> None:
    ltwh = np.array(numbers)
    np.testing.assert_allclose(box_format.to_ltwh(box_format.of_ltwh(ltwh, (640, 480)), (640, 480)), ltwh, atol=1e-9)
    assert BoxFormat.of_text(str(box_format)) == box_format


def test_usual_spellings_are_accepted_and_an_unknown_format_names_those_that_exist() -> None:
    texts = ("Centers", "centres_normalized", "normalized corners", "corners, normalised")
    assert [str(BoxFormat.of_text(text)) for text in texts] == ["centres", "normalised centres", *2 * ["normalised corners"]]
    with pytest.raises(ValueError, match="'xyz' is no box format: write one of ltwh, corners, centres, normalised ltwh"):
        BoxFormat.of_text("xyz")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, scene: SimulatedScene) -> Path:
    return write_simulated(scene, tmp_path_factory.mktemp("scene")).parent


def rewrite(folder: Path, into: Path, size: Callable[[str], tuple[int, int]], box_format: BoxFormat, key: str = "") -> Path:
    for path in folder.rglob("*"):
        if path.is_file() and path.suffix in (".toml", ".txt"):
            copy = into / path.relative_to(folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            text = path.read_text(encoding="utf-8")
            if path.parent.name == "tracks":
                table = np.loadtxt(path, delimiter=",")
                table[:, 2:6] = box_format.of_ltwh(table[:, 2:6], size(path.stem))
                text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in table) + "\n"
            elif path.name == "scene.toml" and key:
                text = text.replace("[scene]\n", f'[scene]\nboxes = "{key}"\n')
            copy.write_text(text, encoding="utf-8")
    return into / "scene.toml"


@thinned("key", ["corners", "normalized centres", "centers", "normalised corners"], quick=2)
def test_a_scene_file_states_the_format(folder: Path, tmp_path: Path, scene: SimulatedScene, key: str) -> None:
    path = rewrite(folder, tmp_path, lambda name: scene.rig[name].lens.size, BoxFormat.of_text(key), key)
    assert run(["check", str(path)]) == 0
    read, true = read_inputs(Scene.load(path)).observations, read_inputs(Scene.load(folder / "scene.toml")).observations
    for name in scene.rig.names:
        np.testing.assert_allclose(read[name].boxes.ltwh, true[name].boxes.ltwh, atol=1e-4)


@pytest.mark.parametrize(("command", "true"), [("check", "corners"), ("calibrate", "normalised centres")])
def test_the_option_is_named_where_it_is_missing(folder, tmp_path, scene, capsys, true, command):
    path = rewrite(folder, tmp_path / "in", lambda name: scene.rig[name].lens.size, BoxFormat.of_text(true))
    out = ["-o", str(tmp_path / "out")] if command == "calibrate" else []
    assert run([command, str(path), *out]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert f'under [scene] set boxes = "{true}"' in error
    assert not (tmp_path / "out").exists()
    if command == "check":
        path = rewrite(folder, tmp_path / "none", lambda name: (1, 1), LTWH, "corners")
        assert run([command, str(path)]) == 2
        assert "(columns 3 to 6 are left, top, right, bottom)" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["wrong", pytest.param("stated", marks=pytest.mark.system)])
def test_arrays_in_memory_are_read_with_their_format_and_give_the_same_rig(scene: SimulatedScene, form: str) -> None:
    lenses = {camera.name: camera.lens for camera in scene.rig}

    def arrays(name: str) -> dict[str, np.ndarray]:
        boxes = {camera: scene.observations[camera].boxes for camera in lenses}
        of_ltwh = BoxFormat.of_text(name).of_ltwh
        return {
            camera: np.column_stack([one.frame, one.identity, of_ltwh(one.ltwh, lenses[camera].size), one.score])
            for camera, one in boxes.items()
        }

    if form == "wrong":
        with pytest.raises(passerby.InputError, match='box_format = "corners"'):
            passerby.calibrate_observations(lenses, arrays("corners"), fps=5.0)
        with pytest.raises(passerby.InputError, match="box_format: 'xy' is no box format"):
            passerby.calibrate_observations(lenses, arrays("ltwh"), fps=5.0, box_format="xy")
        return
    first, second = (
        passerby.calibrate_observations(lenses, arrays(name), fps=5.0, box_format=name, association={"mode": "given"})
        for name in ("ltwh", "normalised corners")
    )
    for name in scene.rig.names:
        np.testing.assert_allclose(second.rig[name].centre, first.rig[name].centre, atol=1e-3)


def grid_of(step, count=300):
    rng = np.random.default_rng(0)
    height = rng.uniform(90, 200, count)
    near = np.column_stack([rng.uniform(0, 1200, count), rng.uniform(0, 500, count)])
    far = near + np.column_stack([0.4 * height, height])
    near, far = step * np.floor(near / step), step * np.ceil(far / step)
    return Boxes(np.arange(count), np.ones(count, dtype=np.int64), np.concatenate([near, far - near], axis=1), np.ones(count))


@pytest.mark.parametrize(("step", "coarse"), [(20, True), (32, True), (64, True), (1, False), (8, False)])
def test_boxes_of_blocks_are_coarse_and_a_fine_grid_is_not(step, coarse):
    """A few boxes that the border clips do not hide the blocks, and few boxes have no grid."""
    found = notice_of_coarse_boxes("gate", boxes := grid_of(step))
    assert (found is not None) is coarse
    assert notice_of_coarse_boxes("gate", grid_of(step, 3)) is None
    if coarse:
        assert (found.code, found.severity, found.cameras) == ("boxes_coarse", "notice", ("gate",))
        assert found.values["step_px"] == step
        ltwh = boxes.ltwh.copy()
        ltwh[:5, 3] = 719.0 - ltwh[:5, 1]
        assert notice_of_coarse_boxes("gate", replace(boxes, ltwh=ltwh)) is not None


@pytest.mark.parametrize(("share", "sigma"), [(1.0, 0.25), (0.5, 0.18), (0.0, 0.15)])
def test_blocks_make_a_scale_uncertain_that_rests_on_how_tall_people_are(share, sigma):
    """Blocks of a fifth of a person: the scale by people is as uncertain; a measured length is not."""

    def cue(kind, share):
        return CueFigures(cue=kind, kind=kind, stated_m=1.7, measured_m=1.7, sd_m=0.05, residual_sigmas=0.0, share=share)

    cues = (cue("population", share), cue("length", 1 - share))
    figures = AdjustedFigures(scale=replace(AdjustedFigures().scale, relative_sigma=0.15, cues=cues))
    found = [notice("boxes_coarse", "gate", step_px=20, height_px=100.0)]
    assert adjust_for_coarse_boxes(figures, found).scale.relative_sigma == pytest.approx(sigma, abs=0.01)
    assert adjust_for_coarse_boxes(figures, []) == figures
