"""Every sentence that a calibration tells its user has an entry on the page of troubleshooting.

The sentences are collected from the code: all strings of four words or more in the modules that make reasons, findings and
errors for want of evidence. What stands between two values is looked for on the page.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from support.documentation import DOCS, ROOT

SOURCE = ROOT / "src" / "passerby"
MODULES = (
    "verdict",
    "unseen_people",
    "walking_pace",
    "sharing",
    "given_clocks",
    "clock_rates",
    "moved_cameras",
    "uneven_ground",
    "inputs",
    "reading",
    "picture_checks",
    "doubled_rows",
    "same_content",
    "smaller_pictures",
    "upside_down",
    "output_folder",
    "videos",
    "check",
    "association/drift",
    "association/starting",
    "association/unregistered",
    "association/joint_graph",
    "association/joint_pairs",
    "solver/body_extent",
    "solver/evidence",
    "solver/findings",
    "solver/geopose",
    "solver/geopose_pairs",
    "solver/geopose_points",
    "solver/geopose_star",
    "solver/people",
    "solver/stages",
    "geometry/two_view",
    "perception/background",
    "perception/plan",
    "perception/watching",
    "tracks3d/trajectories",
)
WORDS = 4
OTHERWISE = (
    "is out of range",
    "must be 1 or more",
    "must lie between 0 and 1",
    "does not exist: choose one of",
    "needs `[",
    "cannot be learnt from",
    "its background ",
    " pixels, the first ",
    "cannot be read again: choose another folder",
    "refined without a frame rate",
    "what a calibration tells",
    "is not JSON",
    "calibrate again",
    "no such file",
    "has no fps, though",
    "it has no camera",
    "has fps ",
    "is not a list of tables",
    "it is no table",
    "is not in the rig: choose one of",
    "embeddings for ",
    "is of frame ",
    "it tells no reason",
    "(the lens is in ",
    "(the video of camera",
    "farther than can be told",
    "its frame rate is not known",
    "nothing is left",
)
"""Faults of a file or of an option that say all there is to say."""


def sentences(path: Path) -> list[tuple[int, str]]:
    """(line, text) of the strings of a module that are sentences, `{}` in place of values; no docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            skipped.add(node.value)
        if isinstance(node, ast.JoinedStr):
            skipped.update(node.values)
    found = []
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        elif isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        else:
            continue
        if " " in text.strip() and len(re.findall(r"[A-Za-z]{2,}", text)) >= WORDS and "s? |" not in text and "s?|" not in text:
            found.append((node.lineno, text))
    return found


def key_of(text: str) -> str:
    """The longest part of a sentence that no value stands in."""
    return evened(max(text.split("{}"), key=len)).strip(" :;,.()[]'\"")


def evened(text: str) -> str:
    """Text without the marks that a page adds: quotes of several lines, code, italics."""
    return " ".join(re.sub(r"^> ?", "", text, flags=re.MULTILINE).replace("`", "").replace("*", "").split())


@pytest.mark.parametrize("module", MODULES)
def test_every_reason_has_an_entry(module: str) -> None:
    page = evened((DOCS / "troubleshooting.md").read_text(encoding="utf-8"))
    told = [(line, text) for line, text in sentences(SOURCE / f"{module}.py") if not any(word in text for word in OTHERWISE)]
    missing = [f"{module}.py:{line}: {key_of(text)}" for line, text in told if key_of(text) not in page]
    assert not missing, "say on docs/troubleshooting.md what these mean and what to do:\n" + "\n".join(missing)


def test_a_sentence_without_an_entry_is_found(tmp_path: Path) -> None:
    module = tmp_path / "new.py"
    module.write_text(
        '"""What a docstring says is nothing to the user."""\n\nWHY = f"camera {1} was eaten by a big dog: feed it"\n'
    )
    assert [key_of(text) for _, text in sentences(module)] == ["was eaten by a big dog: feed it"]
