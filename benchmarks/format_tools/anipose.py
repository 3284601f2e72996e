"""Anipose's calibration.toml, by aniposelib."""

from __future__ import annotations

from pathlib import Path

from format_tools.case import Case

TOOL = "aniposelib"
ENVIRONMENT = "anipose"
PACKAGES = ("aniposelib==0.8.0",)
NEEDS = ()


def check(folder: Path) -> float:
    """The largest difference in pixels."""
    from aniposelib.cameras import CameraGroup

    case = Case.read(folder)
    group = CameraGroup.load(str(case.target))
    assert [camera.get_name() for camera in group.cameras] == list(case.names)
    case.back.parent.mkdir(exist_ok=True)
    group.dump(str(case.back))
    return case.largest([camera.project(case.seen(index)) for index, camera in enumerate(group.cameras)])
