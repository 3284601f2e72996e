"""CONTRIBUTING.md: what it names is there, and its picture is that of the source."""

import ast
import importlib.util
import itertools
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
CHANGES = re.findall(r"^\| [^|]+ \| `([^`]+)`(?:: `(\w+)`)? \|$", TEXT, re.MULTILINE)


def names_in(path: Path) -> set[str]:
    """What a module defines."""
    names: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
    return names


STEPS = re.findall(r"^\| \d\. .* \| `(\w+)` \| `([^`]+)` \|$", TEXT, re.MULTILINE)


def calls_of(name: str, path: str) -> set[str]:
    """Names that a function of a module calls, as they are where they are defined."""
    tree = ast.parse((ROOT / path).read_text())
    called_as = {
        one.asname: one.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for one in node.names if one.asname
    }
    (function,) = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name)
    calls = {one.func.id for one in ast.walk(function) if isinstance(one, ast.Call) and isinstance(one.func, ast.Name)}
    return {called_as.get(one, one) for one in calls}


def test_each_step_of_a_box_calls_the_next_one():
    """Eight functions after the command, in six files with it."""
    assert len(STEPS) == 9
    assert len({path for _, path in STEPS}) == 6
    for (name, path), (following, _) in itertools.pairwise(STEPS):
        assert following in calls_of(name, path), name
    assert "NormalEquations" in calls_of(*STEPS[-1])


def test_there_are_ten_changes():
    assert len([path for path, _ in CHANGES if path.startswith("src/")]) == 10


@pytest.mark.parametrize(("path", "name"), [change for change in CHANGES if change[0].startswith("src/")])
def test_a_change_belongs_where_the_table_says(path: str, name: str):
    assert (ROOT / path).is_file()
    assert not name or name in names_in(ROOT / path)


def test_what_is_named_is_there():
    named = set(re.findall(r"`((?:src|tests|docs|benchmarks)/[\w./]+)`", TEXT))
    assert len(named) > 10
    assert [path for path in sorted(named) if not (ROOT / path).exists()] == []
    for path in re.findall(r"`((?:\w+/)+\w+\.(?:py|toml))`", TEXT):
        assert (
            (ROOT / path).exists()
            or (ROOT / "src" / "passerby" / path).exists()
            or any((ROOT / "src" / "passerby").rglob(path))
        ), path


def test_every_room_has_a_line():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rooms = {room.strip() for one in contracts if one["type"] == "layers" for row in one["layers"] for room in row.split("|")}
    table = TEXT.split("| room | what lives there |")[1].split("\n\n")[0]
    told = set(re.findall(r"`(\w+)(?:\.py)?`", table))
    assert {room for room in rooms if not room.startswith("_")} <= told


@pytest.mark.slow
def test_the_picture_shows_the_rooms_that_there_are():
    spec = importlib.util.spec_from_file_location("make_rooms", ROOT / "docs" / "make_rooms.py")
    assert spec is not None
    assert spec.loader is not None
    rooms = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(rooms)
    shown = re.findall(r'font-size="15"[^>]*>(\w+)<', rooms.PICTURE.read_text())
    assert shown == [room for row in rooms.layers() for room in row]
    arrows = set(re.findall(r"<title>(\w+) imports (\w+) ", rooms.PICTURE.read_text()))
    assert arrows == set(rooms.imports())
