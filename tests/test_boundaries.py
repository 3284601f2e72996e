"""Data flows one way: the mathematics knows nothing of files, progress bars or command lines."""

import ast
from pathlib import Path

import pytest

import passerby

PACKAGE = Path(passerby.__file__).parent
MATHEMATICS = ("association", "geometry", "solver", "evaluation", "tracks3d")
OUTSIDE = {"typer", "rich", "pydantic", "json", "tomllib", "tomli_w", "pathlib", "io", "logging"}
UPSTAIRS = {
    "passerby.interchange",
    "passerby.scene.scene",
    "passerby.scene.tables",
    "passerby.scene.inputs",
    "passerby.calibration.pipeline",
    "passerby.cli.main",
    "passerby.simulation",
}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("room", MATHEMATICS)
def test_mathematics_reads_no_files(room):
    modules = sorted((PACKAGE / room).rglob("*.py"))
    assert modules
    for module in modules:
        for name in imports(module):
            top = ".".join(name.split(".")[:2])
            assert name.split(".")[0] not in OUTSIDE, f"{module.name} imports {name}"
            assert top not in UPSTAIRS, f"{module.name} imports {name}"


def test_nobody_imports_the_command_line():
    for module in PACKAGE.rglob("*.py"):
        if module.name not in ("__main__.py", "cli.py", "tables.py") and module.parent != PACKAGE / "commands":
            assert not {"passerby.cli.main", "passerby.cli.tables", "passerby.cli.terminal"} & set(imports(module)), module
