"""Calibrations with a camera on its side: the key `rotate`, and results of the images as filmed."""

from dataclasses import replace

import numpy as np

import passerby
from passerby.core.cameras import Rig
from passerby.core.quarter_turns import turn_camera, turn_observations
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.rig_toml import read_rig, write_rig
from support.scenes.people_and_rigs import simulated

SIDE = {"C2": 270}


def on_its_side():
    """A terrace where the images of C2 are filmed turned clockwise by 270 degrees, so that 90 more stand them upright."""
    scene = simulated(seconds=20.0)
    rig = Rig(tuple(turn_camera(camera, SIDE.get(camera.name, 0)) for camera in scene.rig))
    rig = Rig(tuple(replace(one, lens=replace(one.lens, rotate=0)) for one in rig))
    seen = turn_observations(scene.observations, scene.rig, SIDE)
    return rig, {name: one.boxes for name, one in seen.cameras.items()}


def written(folder, rig, boxes, *, rotate=90):
    write_rig(folder / "intrinsics.toml", Rig(tuple(replace(camera, pose=None, sigma=None) for camera in rig)))
    write_rig(folder / "truth.toml", rig)
    text = "[scene]\nfps = 5\n"
    for name, own in boxes.items():
        write_boxes(folder / f"{name}.txt", own)
        text += f'[cameras.{name}]\nintrinsics = "intrinsics.toml"\ntracks = "{name}.txt"\n'
        text += f"rotate = {rotate}\n" if name in SIDE else ""
    scene = folder / "scene.toml"
    scene.write_text(text + '[association]\nmode = "given"\n')
    return scene


def test_the_rig_and_the_tracks_are_of_the_images_as_filmed(tmp_path):
    """A lens in memory states the turn as the scene file does."""
    rig, boxes = on_its_side()
    found = passerby.calibrate(written(tmp_path, rig, boxes))
    assert found.verdict == "accepted", found.reasons
    found.write(tmp_path / "out")
    stored = read_rig(tmp_path / "out" / "rig.toml")
    assert {camera.name: camera.lens.rotate for camera in stored} == {name: 90 * (name in SIDE) for name in rig.names}
    comparison = compare(stored, read_rig(tmp_path / "truth.toml"))
    assert max(comparison.similarity.orientation_deg.values()) < 0.3
    assert max(comparison.similarity.position_mm.values()) < 60
    assert stored["C2"].lens.size == rig["C2"].lens.size
    tracks = read_boxes(tmp_path / "out" / "tracks" / "C2.txt")
    assert len(tracks) > 100
    assert set(map(tuple, tracks.ltwh.round(1))) <= set(map(tuple, boxes["C2"].ltwh.round(1)))
    lenses = {one.name: replace(one.lens, rotate=90 * (one.name in SIDE)) for one in rig}
    in_memory = passerby.calibrate_observations(lenses, boxes, fps=5, association={"mode": "given"})
    for name in rig.names:
        assert np.allclose(in_memory.rig[name].pose.R_cw, found.rig[name].pose.R_cw, atol=1e-3)
