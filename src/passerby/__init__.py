"""Passerby: the poses of a camera network from the people who walk through its view.

    import passerby
    calibration = passerby.calibrate("scene.toml")
    calibration.rig["C1"].centre

`docs/api.md` tells what else there is. Names are imported when they are first used, so that `import passerby` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from passerby.api import align, evaluate, export_rig, import_rig, monitor, read_calibration, trajectories
    from passerby.cameras import Camera, Lens, Pose, PoseSigma, Rig
    from passerby.core.known_places import KnownPoint, KnownPosition
    from passerby.core.trajectories import Trajectories
    from passerby.errors import EvidenceError, InputError, PasserbyError
    from passerby.evaluation.metrics import Comparison
    from passerby.in_memory import calibrate_observations
    from passerby.interchange.rig_toml import read_rig, write_rig
    from passerby.monitoring.result import Monitored
    from passerby.observations import Boxes, Keypoints, Observations
    from passerby.output_folder import OutputFolder
    from passerby.pipeline import Calibration, calibrate
    from passerby.scene import Scene
    from passerby.solver.solution import Verdict
    from passerby.world import Aligned

__version__ = "0.1.0"

__all__ = [
    "Aligned",
    "Boxes",
    "Calibration",
    "Camera",
    "Comparison",
    "EvidenceError",
    "InputError",
    "Keypoints",
    "KnownPoint",
    "KnownPosition",
    "Lens",
    "Monitored",
    "Observations",
    "OutputFolder",
    "PasserbyError",
    "Pose",
    "PoseSigma",
    "Rig",
    "Scene",
    "Trajectories",
    "Verdict",
    "align",
    "calibrate",
    "calibrate_observations",
    "evaluate",
    "export_rig",
    "import_rig",
    "monitor",
    "read_calibration",
    "read_rig",
    "trajectories",
    "write_rig",
]

_HOMES = {
    "Aligned": "world",
    "Boxes": "observations",
    "Calibration": "pipeline",
    "Camera": "cameras",
    "Comparison": "evaluation.metrics",
    "EvidenceError": "errors",
    "InputError": "errors",
    "Keypoints": "observations",
    "KnownPoint": "world_places",
    "KnownPosition": "world_places",
    "Lens": "cameras",
    "Monitored": "monitoring.result",
    "Observations": "observations",
    "OutputFolder": "output_folder",
    "PasserbyError": "errors",
    "Pose": "cameras",
    "PoseSigma": "cameras",
    "Rig": "cameras",
    "Scene": "scene",
    "Trajectories": "tracks3d.trajectories",
    "Verdict": "solver.solution",
    "align": "api",
    "calibrate": "pipeline",
    "calibrate_observations": "in_memory",
    "evaluate": "api",
    "export_rig": "api",
    "import_rig": "api",
    "monitor": "api",
    "read_calibration": "api",
    "read_rig": "interchange.rig_toml",
    "trajectories": "api",
    "write_rig": "interchange.rig_toml",
}


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'passerby' has no attribute '{name}'")
    return getattr(import_module(f"passerby.{home}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
