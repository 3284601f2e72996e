"""Messages for a browser: without the folders of this machine."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


def without_folders(text: str, folders: Iterable[Path]) -> str:
    """A message in which paths begin below these folders."""
    for folder in folders:
        for form in (str(folder.absolute()), str(folder)):
            if form not in ("", ".", "/"):
                text = text.replace(form.rstrip("/") + "/", "")
    return text
