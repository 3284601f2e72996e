"""The package as it was at an earlier commit, to be measured beside this one."""

from __future__ import annotations

import io
import subprocess
import tarfile
from pathlib import Path

from datasets import ROOT


def commit_named(name: str) -> str:
    """The full name of a commit of this repository. Raises `subprocess.CalledProcessError` for a name that is none."""
    told = ["git", "rev-parse", "--verify", f"{name}^{{commit}}"]
    return subprocess.run(told, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def unpack(commit: str, folder: Path) -> Path:
    """Write the package's sources as they were into a folder. Returns the folder for Python's path."""
    packed = subprocess.run(["git", "archive", "--format=tar", commit, "src"], cwd=ROOT, capture_output=True, check=True)
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(folder, filter="data")
    return folder / "src"
