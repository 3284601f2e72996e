"""The monitor on real pedestrians: WILDTRACK's rig, one of whose cameras is turned, as far as its boxes tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.monitoring.monitor import watch_footage
from passerby.monitoring.watched import Watched, WatchOptions
from passerby.monitoring.watching import watch
from passerby.people.ground import fit_ground
from passerby.people.sightings import gather_sightings

pytestmark = pytest.mark.real
FPS, KNOCK_S = 2.0, 60.0


def turned(boxes: Boxes, camera: Camera, turn_deg: tuple[float, float, float]) -> Boxes:
    """The boxes as the camera would see them if it were turned from `KNOCK_S` on: a turn moves pixels, whatever is there."""
    x, y, w, h = boxes.ltwh.T
    ends = [np.column_stack([x + w / 2, edge]) for edge in (y, y + h)]
    R = exp_rotation(np.radians(turn_deg))
    top, bottom = (camera.lens.project_rays(camera.lens.bearings(end) @ R.T) for end in ends)
    tall = np.linalg.norm(bottom - top, axis=1)
    size = np.column_stack([w * tall / h, tall])
    moved = np.column_stack([(top + bottom - size) / 2, size])
    late = (boxes.frame > KNOCK_S * FPS) & np.isfinite(moved).all(axis=1)
    return replace(boxes, ltwh=np.where(late[:, None], moved, boxes.ltwh))


def watched(rig: Rig, boxes: dict[str, Boxes]) -> Watched:
    seen = gather_sightings(rig, Observations({name: CameraObservations(own) for name, own in boxes.items()}, FPS))
    return watch(rig, seen, ground=fit_ground(rig, seen, 0.0))


def test_wildtrack_quiet_and_knocked(data_root: Path) -> None:
    folder = data_root / "wildtrack"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    rig = read_rig(folder / "rig.toml")
    boxes = {name: read_boxes(folder / "identities" / f"{name}.txt") for name in rig.names}
    assert watched(rig, boxes).moves == ()
    (move,) = watched(rig, {**boxes, "C3": turned(boxes["C3"], rig["C3"], (0.0, 1.0, 0.0))}).moves
    assert (move.camera, move.others) == ("C3", ())
    assert move.moment is not None
    assert abs(move.moment.seconds - KNOCK_S) <= 5
    error = move.shift - np.array([0, 0, 0, 0, np.radians(1.0), 0])
    assert error @ np.linalg.solve(move.covariance, error) < 22.5


def test_shelf_with_joints_quiet_and_turned(data_root: Path) -> None:
    """Twelve seconds of four people in one room, five cameras; the rig states no sigmas."""
    folder = data_root / "shelf"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    rig = read_rig(folder / "rig.toml")
    joints = {name: read_keypoints(folder / "keypoints" / f"{name}.json") for name in rig.names}
    seen = Observations(
        {name: CameraObservations(Boxes.empty(), own) for name, own in joints.items()}, 25.0,
        dict.fromkeys(rig.names, Clock(25.0)),
    )  # fmt: skip
    quiet, _ = watch_footage(rig, seen, WatchOptions(), known=True)
    assert quiet.by_joints
    assert quiet.moves == ()
    turns = {"1": (0.0, 3.0, 0.0), "4": (2.0, 0.0, -2.2)}
    # A rig from which two cameras have since been turned.
    before = [
        replace(
            c, pose=Pose.from_centre(exp_rotation(-np.radians(turns.get(c.name, np.zeros(3)))) @ c.pose.R_cw, c.pose.centre)
        )
        for c in rig
        if c.pose is not None
    ]
    found, _ = watch_footage(replace(rig, cameras=tuple(before)), seen, WatchOptions(), known=True)
    assert [(move.camera, move.others, move.moment) for move in found.moves] == [("1", (), None), ("4", (), None)]
    for move in found.moves:
        error = move.shift[3:] - np.radians(turns[move.camera])
        assert np.degrees(np.linalg.norm(error)) < 1.5
        assert error @ np.linalg.solve(move.covariance[3:, 3:], error) < 16.3  # 99.9 % of a chi squared of three
