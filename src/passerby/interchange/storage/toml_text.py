"""TOML as text, for files that people read and edit."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

SIGNIFICANT_DIGITS = 12
"""Of a number in such a file: a product as 0.0125 * 1.72 ends in 0.021500000000000002 for the binary digits of its factors."""


def to_toml(content: Mapping[str, Any]) -> str:
    """A whole file of tables. Numbers get 12 significant digits; a rig, of which every bit counts, has a writer of its own."""
    return tomli_w.dumps({name: _rounded(one) for name, one in content.items()})


def _rounded(content: Any) -> Any:
    if isinstance(content, float):
        return float(f"{content:.{SIGNIFICANT_DIGITS}g}")
    if isinstance(content, Mapping):
        return {name: _rounded(one) for name, one in content.items()}
    return [_rounded(one) for one in content] if isinstance(content, list | tuple) else content


def key(name: str) -> str:
    """A name as a key, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else value(name)


def value(content: Any) -> str:
    """A value on one line."""
    if isinstance(content, (list, tuple)):
        return f"[{', '.join(map(value, content))}]"
    return tomli_w.dumps({"x": content}).removeprefix("x = ").rstrip("\n")


def comment(text: str, indent: str = "") -> str:
    """Prose as comment lines, on each line of the text `# ` before it; characters that TOML forbids are left out."""
    lines = ("".join(letter for letter in line if letter.isprintable()) for line in text.splitlines())
    return "".join(f"{indent}# {line}".rstrip() + "\n" for line in lines)


def relative(path: Path, scene: Path) -> str:
    """A file's path as the scene file names it: relative to it where that is possible, with forward slashes."""
    absolute = path.parent.resolve() / path.name
    try:
        return Path(os.path.relpath(absolute, scene.parent.resolve())).as_posix()
    except ValueError:  # another drive
        return absolute.as_posix()
