"""CONTRIBUTING.md, the README and the pages of results: what they name exists, and tables are those of the records."""

from __future__ import annotations

import ast
import importlib.util
import itertools
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from support.paths import DOCS, ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text()


def loaded(path: Path) -> ModuleType:
    """A script that is no module of a package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


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


def test_a_change_belongs_where_the_table_says():
    inside = [(path, name) for path, name in CHANGES if path.startswith("src/")]
    assert inside
    for path, name in inside:
        assert (ROOT / path).is_file()
        assert not name or name in names_in(ROOT / path)


def test_every_file_that_is_named_exists():
    named = set(re.findall(r"`((?:src|tests|docs|benchmarks)/[\w./]+)`", TEXT))
    assert len(named) > 10
    assert [path for path in sorted(named) if not (ROOT / path).exists()] == []
    package = ROOT / "src" / "passerby"
    for path in re.findall(r"`((?:\w+/)+\w+\.(?:py|toml))`", TEXT):
        assert (ROOT / path).exists() or (package / path).exists() or any(package.rglob(path)), path


def test_every_room_has_a_line():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rooms = {room.strip() for one in contracts if one["type"] == "layers" for row in one["layers"] for room in row.split("|")}
    table = TEXT.split("| room | what lives there |")[1].split("\n\n")[0]
    told = set(re.findall(r"`(\w+)(?:\.py)?`", table))
    assert {room for room in rooms if not room.startswith("_")} <= told


@pytest.mark.slow
def test_the_picture_shows_the_rooms_that_there_are():
    rooms = loaded(DOCS / "make_rooms.py")
    shown = re.findall(r'font-size="15"[^>]*>(\w+)<', rooms.PICTURE.read_text())
    assert shown == [room for row in rooms.layers() for room in row]
    arrows = set(re.findall(r"<title>(\w+) imports (\w+) ", rooms.PICTURE.read_text()))
    assert arrows == set(rooms.imports())


@pytest.fixture(scope="module")
def headline() -> ModuleType:
    return loaded(ROOT / "benchmarks" / "headline.py")


def test_headline_tables_are_those_of_the_records(headline: ModuleType, tmp_path: Path) -> None:
    for file in (headline.README, headline.FILMING):
        for name in headline.SHOWN[file]:
            shown = file.read_text().split(headline.begin(name))[1].split(headline.END)[0].strip()
            assert shown == headline.headlines(file, name).strip(), name
    with pytest.raises(ValueError, match="no table 'Against the paper' in the records of paper"):
        headline.headlines(headline.README, "headline", tmp_path)


def test_every_page_of_results_names_its_command() -> None:
    commands = r"(make reliability|python benchmarks/(run_paper|run|reliability/limits|mutation|versions)\.py)"
    for page in (DOCS / "results").glob("*.md"):
        last = page.read_text().strip().splitlines()[-1]
        assert re.match(rf"Written by `{commands}[ `]", last), (page.name, last)


MODULE = '''"""Whoever reads this

stumbles beyond
doubt."""


def hardly(x: float) -> str:
    # Nobody calls it.
    told = f"{x} rests on `nobody` and {x}"
    return told
'''


@pytest.fixture(scope="module")
def words() -> ModuleType:
    return loaded(DOCS / "check_words.py")


def test_turns_of_a_module_are_found_at_their_lines(words: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(MODULE)
    found = sorted((line, turn.lower()) for line, turn, _ in words.check_module(path))
    assert found == [(1, "whoever"), (3, "beyond doubt"), (7, "hardly"), (8, "nobody"), (9, "rests on")]


def test_code_and_written_tables_of_a_page_are_not_checked(words: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    table = "<!-- scale: written by benchmarks/headline.py -->\n| nobody |\n<!-- end of the headline -->\n"
    path.write_text(f"`nobody`\n\n```sh\nnobody\n```\n\n{table}\nIt was told.\n")
    assert [(line, turn) for line, turn, _ in words.check_page(path)] == [(11, "told")]
