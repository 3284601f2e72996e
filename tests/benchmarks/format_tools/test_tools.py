"""Files read by the libraries of the tools that they are for, where these are installed; `benchmarks/run.py` runs all."""

import importlib
import re
import sys

import pytest

from support.paths import BENCHMARKS

CHECKS = sorted(
    path.stem
    for path in (BENCHMARKS / "format_tools").glob("*.py")
    if re.search(r"^def check\(", path.read_text(), re.MULTILINE)
)
IMPORTED = {"opencv-python-headless": "cv2", "pose2sim": "Pose2Sim"}
"""Distributions that are imported by another name."""
WITHIN_PX = 1e-6


@pytest.fixture
def tools():
    """Imports a module of `format_tools`, whose name is none for anybody else."""
    sys.path.insert(0, str(BENCHMARKS))
    yield lambda name: importlib.import_module(f"format_tools.{name}")
    sys.path.remove(str(BENCHMARKS))
    for name in [name for name in sys.modules if name.split(".")[0] == "format_tools"]:
        del sys.modules[name]


@pytest.mark.parametrize("name", CHECKS)
def test_the_tool_has_points_at_the_same_pixels(name, tools, tmp_path):
    module = tools(name)
    pytest.importorskip(IMPORTED.get(module.TOOL, module.TOOL), reason=f"{module.TOOL} is not installed", exc_type=ImportError)
    rigs = tools("rigs")
    cases = list(rigs.cases_of(name.replace("_", "-"), tmp_path))
    assert cases
    for _kind, _, folder in cases:
        assert module.check(folder) < WITHIN_PX
        back = rigs.read_back(name.replace("_", "-"), folder)
        assert back is None or back < WITHIN_PX
