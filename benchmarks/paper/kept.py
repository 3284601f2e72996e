"""What a stopped benchmark has worked out already: one small file an outcome, for the same code and the same libraries only."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import passerby
from paper.page import PACKAGES
from passerby.interchange.storage.atomic import write_text


class Kept:
    """Outcomes by what they are the outcomes of. Processes may share a folder: each file is written whole or not at all."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

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
        return folder / f"{hashlib.sha256(f'{code_digest()} {what}'.encode()).hexdigest()[:32]}.json"


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


@cache
def code_digest() -> str:
    """Stands for all code that an outcome depends on, as it was when this process first asked: with any other code, and with
    other versions of the libraries, every outcome is unknown.
    """
    versions = " ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    digest = hashlib.sha256(versions.encode())
    for root in (Path(passerby.__file__).parent, Path(__file__).parent):
        for path in sorted(root.rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
