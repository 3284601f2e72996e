"""Every key of `calibration.json` is explained."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from support.documentation import DOCS

NAMES = ("C1", "C2", "C3")
ELSEWHERE = {"scene": "reference/scene-file.md", "options": "reference/scene-file.md", "association": "association.md"}
"""Which page tells of the keys below these."""


def keys(value: Any, page: str = "output.md") -> Iterator[tuple[str, str]]:
    """(page, key) of all tables below a value; names of cameras, libraries, files and people are no keys.

    The values of a diagnostic are its code's own.
    """
    if isinstance(value, list):
        for item in value:
            yield from keys(item, page)
    if isinstance(value, dict):
        for key, item in value.items():
            if key not in NAMES and not key.isdigit():
                yield page, key
            if key not in ("versions", "files", "values"):
                yield from keys(item, ELSEWHERE.get(key, page))


@pytest.mark.evidence
def test_every_key_is_explained(prepared: Callable[[str], Path]) -> None:
    told = json.loads((prepared("calibrated") / "out" / "calibration.json").read_text())
    explained = {
        page: set(re.findall(r"`\[?(\w+)\]?`", (DOCS / page).read_text())) for page in ("output.md", *ELSEWHERE.values())
    }
    explained["reference/scene-file.md"] |= {"scene", "cameras", "association", "solver", "scale", "perception", "world"}
    assert len(told) > 10
    assert [place for place in keys(told) if place[1] not in explained[place[0]]] == []
