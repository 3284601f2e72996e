"""Which format a calibration file has, by its name and content."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.interchange.opencv_lens import LARGEST_BYTES
from passerby.interchange.storage.safe_parsing import (
    NotParsed,
    file_bytes,
    parse_json,
    parse_safe_yaml,
    parse_toml,
    parse_xml,
)

PARSERS: Mapping[str, Callable[[str], Any]] = {
    ".json": parse_json, ".toml": parse_toml, ".yml": parse_safe_yaml, ".yaml": parse_safe_yaml, ".xml": parse_xml,
    ".xcp": parse_xml, ".txt": parse_xml,
}  # fmt: skip
"""By the ending of a file's name; a .txt is Qualisys' XML or nothing that needs parsing."""


@dataclass(frozen=True, eq=False)
class FileSample:
    """A file as formats look at it to recognise it."""

    path: Path
    data: bytes

    @property
    def name(self) -> str:
        """The file's name in small letters."""
        return self.path.name.lower()

    @property
    def suffix(self) -> str:
        """The ending of the name in small letters, with the dot."""
        return self.path.suffix.lower()

    @cached_property
    def content(self) -> Any:
        """What the file holds: the value of JSON, TOML or YAML, or the root of XML; None where it is none of them."""
        if self.suffix not in PARSERS:
            return None
        try:
            return PARSERS[self.suffix](self.data.decode("utf-8-sig").replace("\r\n", "\n"))
        except (NotParsed, UnicodeDecodeError, RecursionError):
            return None

    @property
    def table(self) -> dict[Any, Any]:
        """The content where it is a table; else an empty one."""
        return self.content if isinstance(self.content, dict) else {}

    @property
    def tag(self) -> str:
        """The name of the root element where the content is XML; else empty."""
        return getattr(self.content, "tag", "")

    def has_elements(self, place: str) -> bool:
        """Whether there is an element at that place below the root of XML."""
        return bool(self.tag) and self.content.find(place) is not None


def sample_file(path: Path) -> FileSample | None:
    """A file to look at; None for what is no file, cannot be read, or is larger than calibrations are."""
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_BYTES:
            return None
        return FileSample(path, file_bytes(path, "a calibration"))
    except (OSError, ValueError, InputError):
        return None
