"""FreeMoCap's camera calibration, by the reader of freemocap itself."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from unittest.mock import MagicMock

from format_tools.case import Case

TOOL = "freemocap"
ENVIRONMENT = "freemocap"
PACKAGES = ("freemocap==1.8.2",)
NEEDS = ("aniposelib==0.8.0", "pydantic", "rich")
# Of what it depends on only what its reader imports: the rest is a window, cameras and trackers.
WITHOUT = True
UNUSED = (
    "skellytracker", "skellytracker.process_folder_of_videos", "skellytracker.trackers",
    "skellytracker.trackers.charuco_tracker", "skellytracker.trackers.charuco_tracker.charuco_model_info",
)  # fmt: skip
"""What the reader's module imports for finding boards, which is not installed."""
MM = 1000.0


def check(folder: Path) -> float:
    """The largest difference in pixels; FreeMoCap's lengths are millimetres."""
    case = Case.read(folder)
    os.environ["HOME"] = str(folder)  # its import makes a folder there
    for name in UNUSED:
        sys.modules.setdefault(name, MagicMock())
    from freemocap.core_processes.capture_volume_calibration.anipose_camera_calibration.freemocap_anipose import CameraGroup

    group = CameraGroup.load(str(case.target))
    cameras = {camera.get_name(): camera for camera in group.cameras}
    case.back.parent.mkdir(exist_ok=True)
    group.dump(str(case.back))
    return case.largest([cameras[name].project(MM * case.seen(index)) for index, name in enumerate(case.names)])
