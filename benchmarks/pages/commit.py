"""The commit that a benchmark is run on."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def commit() -> str:
    """The commit of the code, and whether something in it was changed since; records that a run writes are no code."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    try:
        name = f"`{git('rev-parse', '--short=10', 'HEAD')}`"
        changed = git("status", "--porcelain", "src", "benchmarks", ":!benchmarks/records")
        return f"{name}, with changes that are not committed" if changed else name
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
