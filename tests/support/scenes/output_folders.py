"""Output folders of calibrations that no solver has made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from passerby.calibration.calibration import Calibration
from passerby.calibration.writing import write_calibration
from passerby.core.cameras import Rig
from passerby.core.figures import SolverFigures
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene
from support.scenes.handmade_files import write_scene
from support.scenes.people_and_rigs import ring


def written_output(folder: Path, boxes: Boxes | None = None, *, report: bool = False) -> Path:
    """An output folder of two cameras A and B, which saw the same boxes; nobody has told a frame rate."""
    folder.mkdir(exist_ok=True)
    scene = Scene.load(write_scene(folder))
    poses = [camera.pose for camera in ring(2)]
    posed = tuple(replace(camera, pose=pose) for camera, pose in zip(read_rig(folder / "rig.toml"), poses, strict=True))
    seen = Observations({camera.name: CameraObservations(boxes or Boxes.empty()) for camera in posed})
    calibrated = Calibration(scene, Rig(posed, verdict="accepted"), "accepted", (), seen, 0, {}, SolverFigures())
    write_calibration(calibrated, folder / "out", report=report)
    return folder / "out"
