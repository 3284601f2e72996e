"""What a stopped benchmark has worked out already: one small file an outcome, for the same code and the same libraries only."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import passerby
from pages.tables import PACKAGES
from passerby.interchange.storage.atomic import write_text

BENCHMARKS = Path(__file__).resolve().parents[1]
WRITERS = "pages"
"""The folder of what writes pages."""
PAPER = ("paper", "baselines", "metrics")
"""Folders of the benchmarks that an outcome of the paper's evaluation depends on, beside the package."""


class Kept:
    """Outcomes by what they are the outcomes of. Processes may share a folder: each file is written whole or not at all."""

    def __init__(self, folder: Path | None, code: Sequence[str] = PAPER) -> None:
        """Keep outcomes in `folder`, or nowhere; `code` names the folders and files of the benchmarks that make them."""
        self._folder = folder
        self._code = tuple(code)

    def get(self, what: str) -> dict[str, Any] | None:
        """The outcome of `what` as it was put; None where it was not, by other code, or where it is damaged."""
        if self._folder is None:
            return None
        try:
            text, digest = self._path(self._folder, what).read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            return None
        if _digest(text) != digest:
            return None
        known: dict[str, Any] = json.loads(text)
        return known

    def put(self, what: str, outcome: dict[str, Any]) -> None:
        """Keep an outcome of plain values. Raises `InputError` where the folder is not writable."""
        if self._folder is not None:
            text = json.dumps(outcome)
            write_text(self._path(self._folder, what), f"{text}\n{_digest(text)}\n")

    def _path(self, folder: Path, what: str) -> Path:
        return folder / f"{hashlib.sha256(f'{code_digest(*self._code)} {what}'.encode()).hexdigest()[:32]}.json"


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


@cache
def code_digest(*parts: str) -> str:
    """What the code does that figures rest on, as it was when this process first asked: 64 hexadecimal digits.

    One hash over the package, some folders and files of the benchmarks, and the versions of the libraries; comments and
    documentation strings are left out.
    """
    digest = hashlib.sha256(" ".join(f"{name} {metadata.version(name)}" for name in PACKAGES).encode())
    for root in (Path(passerby.__file__).parent, *(BENCHMARKS / part for part in parts)):
        for path in [root] if root.is_file() else sorted(root.rglob("*.py")):
            tree = ast.parse(path.read_bytes())
            for node in ast.walk(tree):
                if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                    node.value.value = None  # docstrings, and those of constants
            digest.update(path.relative_to(root.parent).as_posix().encode() + b"\0" + ast.dump(tree).encode())
    return digest.hexdigest()


@cache
def code_behind(module: str) -> tuple[str, ...]:
    """The files of the benchmarks that a module of theirs is made of, as `code_digest` takes them.

    Its own, and of all that it imports there, however far away; those that only write pages are left out.
    """
    found: dict[str, Path] = {}
    todo = [module]
    while todo:
        name = todo.pop()
        path = _source(name)
        if path is None or name in found or name.partition(".")[0] == WRITERS:
            continue
        found[name] = path
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                todo += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                todo += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(sorted({path.relative_to(BENCHMARKS).as_posix() for path in found.values()}))


def _source(module: str) -> Path | None:
    """The file of a module of the benchmarks; None for modules of others."""
    path = BENCHMARKS.joinpath(*module.split("."))
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((candidate for candidate in candidates if candidate.is_file()), None)
