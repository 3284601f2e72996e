"""Passerby: the poses of a camera network from the people who walk through its view.

    import passerby
    calibration = passerby.calibrate("scene.toml")
    calibration.write("out")

Names are imported when they are first used, so that `import passerby` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from passerby.cameras import Camera, Lens, Pose, Rig
    from passerby.errors import EvidenceError, InputError, PasserbyError
    from passerby.observations import Boxes, Keypoints, Observations
    from passerby.pipeline import Calibration, calibrate
    from passerby.scene import Scene

__version__ = "0.1.0"

__all__ = [
    "Boxes",
    "Calibration",
    "Camera",
    "EvidenceError",
    "InputError",
    "Keypoints",
    "Lens",
    "Observations",
    "PasserbyError",
    "Pose",
    "Rig",
    "Scene",
    "calibrate",
]

_HOMES = {
    "Boxes": "observations",
    "Calibration": "pipeline",
    "Camera": "cameras",
    "EvidenceError": "errors",
    "InputError": "errors",
    "Keypoints": "observations",
    "Lens": "cameras",
    "Observations": "observations",
    "PasserbyError": "errors",
    "Pose": "cameras",
    "Rig": "cameras",
    "Scene": "scene",
    "calibrate": "pipeline",
}


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'passerby' has no attribute '{name}'")
    return getattr(import_module(f"passerby.{home}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
