"""Pieces of TOML for files that are written with comments."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import tomli_w


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
