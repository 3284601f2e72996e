"""What is wrong with a file, all of it, and reading text with errors a person can act on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError, cut
from passerby.interchange.storage.safe_parsing import NotParsed, file_bytes, parse_toml

LISTED_FAULTS = 20
"""So many faults of one file are reported one by one; a broken exporter breaks every row alike."""


class FileFaults(InputError):
    """A file, or a scene, that cannot be used. The message tells the first fault, `faults` all (up to `LISTED_FAULTS`)."""

    def __init__(self, faults: Sequence[str]) -> None:
        more = len(faults) - 1
        super().__init__(faults[0] + (f" (and {more} more fault{'s' if more > 1 else ''})" if more else ""))
        listed = tuple(map(cut, faults[:LISTED_FAULTS]))
        if len(faults) > LISTED_FAULTS:
            listed += (f"... and {len(faults) - LISTED_FAULTS} more faults",)
        self.faults = listed
        self._all = tuple(faults)

    def __reduce__(self) -> tuple[type[FileFaults], tuple[tuple[str, ...]]]:
        """Made again from its faults: an exception is otherwise made from its message, on its way from another process."""
        return type(self), (self._all,)


def faults_of(error: InputError) -> tuple[str, ...]:
    """All faults that an error tells of, one line each."""
    return error.faults if isinstance(error, FileFaults) else (str(error),)


def read_text(path: str | Path, kind: str) -> str:
    """The text of a file. `kind` names in a message what was expected ("the scene file").

    Raises `InputError` when the file is missing, a folder, a pipe or a device, unreadable or not UTF-8 text. All ends of
    lines become line feeds.
    """
    path = Path(path)
    content = file_bytes(path, kind)
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8 text, but {kind} is needed: is it another kind of file?"
        ) from None


def read_toml(path: str | Path, kind: str = "a configuration (TOML)") -> dict[str, Any]:
    """The tables of a TOML file. Raises `InputError` as `read_text` does, and for text that is not TOML."""
    try:
        return parse_toml(read_text(path, kind))
    except NotParsed as error:
        raise InputError(f"{path}: is not TOML: {error}") from None
