"""Passerby: computes the poses of a camera network from the people who walk through its view.

    import passerby
    calibration = passerby.calibrate("scene.toml")
    calibration.rig["C1"].centre

`docs/api.md` lists the other functions. Names are imported when they are first used, so that `import passerby` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from passerby._version import __version__ as __version__
from passerby.common.text import set_drawing

if TYPE_CHECKING:
    from passerby.api import align, compare_rigs, evaluate, export_rig, import_rig, monitor, read_calibration, trajectories
    from passerby.calibration.alignment.world import Aligned
    from passerby.calibration.calibrate import calibrate
    from passerby.calibration.calibration import Calibration
    from passerby.calibration.effort import Effort
    from passerby.calibration.in_memory import calibrate_observations
    from passerby.common.errors import EvidenceError, InputError, PasserbyError
    from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
    from passerby.core.ground_points import GroundPoints
    from passerby.core.observations import Boxes, Keypoints, Observations
    from passerby.core.scale_cues import KnownPoint, KnownPosition
    from passerby.core.solution import Verdict
    from passerby.core.trajectories import Trajectories
    from passerby.evaluation.metrics import Comparison
    from passerby.evaluation.on_people import PeopleComparison
    from passerby.findings.finding import Finding
    from passerby.interchange.output_folder import OutputFolder
    from passerby.interchange.rig_toml import read_rig, write_rig
    from passerby.monitoring.result import Monitored, MonitoringResult
    from passerby.scene.scene import Scene

__all__ = [
    "Aligned",
    "Boxes",
    "Calibration",
    "Camera",
    "Comparison",
    "Effort",
    "EvidenceError",
    "Finding",
    "GroundPoints",
    "InputError",
    "Keypoints",
    "KnownPoint",
    "KnownPosition",
    "Lens",
    "Monitored",
    "MonitoringResult",
    "Observations",
    "OutputFolder",
    "PasserbyError",
    "PeopleComparison",
    "Pose",
    "PoseSigma",
    "Rig",
    "Scene",
    "Trajectories",
    "Verdict",
    "align",
    "calibrate",
    "calibrate_observations",
    "compare_rigs",
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
    "Aligned": "calibration.alignment.world",
    "Boxes": "core.observations",
    "Calibration": "calibration.calibrate",
    "Camera": "core.cameras",
    "Comparison": "evaluation.metrics",
    "Effort": "calibration.effort",
    "EvidenceError": "common.errors",
    "Finding": "findings.finding",
    "GroundPoints": "core.ground_points",
    "InputError": "common.errors",
    "Keypoints": "core.observations",
    "KnownPoint": "core.scale_cues",
    "KnownPosition": "core.scale_cues",
    "Lens": "core.cameras",
    "Monitored": "monitoring.result",
    "MonitoringResult": "monitoring.result",
    "Observations": "core.observations",
    "OutputFolder": "interchange.output_folder",
    "PasserbyError": "common.errors",
    "PeopleComparison": "evaluation.on_people",
    "Pose": "core.cameras",
    "PoseSigma": "core.cameras",
    "Rig": "core.cameras",
    "Scene": "scene.scene",
    "Trajectories": "core.trajectories",
    "Verdict": "core.solution",
    "align": "api",
    "calibrate": "calibration.calibrate",
    "calibrate_observations": "calibration.in_memory",
    "compare_rigs": "api",
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


def _draw(value: object) -> str:
    """Return the HTML that a notebook shows for a rig or an output folder."""
    drawings = import_module("passerby.report.notebook")
    draw = drawings.rig_html if type(value).__name__ == "Rig" else drawings.output_folder_html
    return str(draw(value))


set_drawing(_draw)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
