"""Addresses of streams, where the name of a file is needed, and texts without the user names and passwords in them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_KNOWN = "rtsps?|rtspu|rtmps?|rtmpe|rtmpt|https?|ftps?|sftp|udp|tcp|rtp|srtp?|mms[ht]?|wss?|smb|file"
"""Schemes that are known with one slash too: `pathlib` makes one of two."""
_BEGIN = rf"(?:(?:{_KNOWN}):/+|[a-z][a-z0-9+.-]+://)"
ADDRESS = re.compile(rf"(?<![a-z0-9])({_BEGIN})", re.IGNORECASE)
DEVICE = re.compile(r"/dev/\S")

_USER = re.compile(rf"({_BEGIN})[^\n@]*@(?:[^\s'\"]*@)?", re.IGNORECASE)
"""Up to the first @, or to the last one of the same word: a password may hold spaces, or an @."""
_NAMED = re.compile(
    r"((?:^|[?&;/_])(?:user(?:name)?|usr|login|pass(?:word|wd)?|pwd|psw|auth|token|key)=)[^&;\s'\"]*", re.IGNORECASE
)
"""Many cameras take them as parameters."""
HIDDEN = "..."


def without_credentials(text: str) -> str:
    """The text with the user name and the password of each address in it replaced by dots."""
    if ADDRESS.search(text) is None:
        return text
    return _NAMED.sub(rf"\g<1>{HIDDEN}", _USER.sub(rf"\g<1>{HIDDEN}@", text))


def plain_without_credentials(value: Any) -> Any:
    """Tables, lists and texts, keys too, as `without_credentials`; of the address of a video only its scheme is kept."""
    if isinstance(value, Mapping):
        return {
            plain_without_credentials(key): _scheme_only(part) if key == "video" else plain_without_credentials(part)
            for key, part in value.items()
        }
    if isinstance(value, list | tuple):
        return type(value)(map(plain_without_credentials, value)) if type(value) in (list, tuple) else value
    if isinstance(value, str):
        return without_credentials(value)
    if isinstance(value, Path):
        hidden = without_credentials(str(value))
        return value if hidden == str(value) else Path(hidden)
    return value


def _scheme_only(value: Any) -> Any:
    """An address without all that follows its scheme; anything else as `plain_without_credentials` has it."""
    found = ADDRESS.search(str(value)) if isinstance(value, str | Path) else None
    return plain_without_credentials(value) if found is None else f"{found[1].rstrip('/')}//{HIDDEN}"


def not_a_file(text: str) -> str | None:
    """What to do about a text that is the address of a stream, or a device, rather than the path of a video; None for a path.

    The text itself is not repeated, since it may hold a password.
    """
    found = ADDRESS.search(text)
    if found is not None:
        scheme = found[1].split(":")[0].lower()
        if scheme == "file":
            return "is an address (file://...): write the path of the file instead"
        return (
            f"is the address of a stream ({scheme}://...): write it as `stream` into a file of cameras, record all cameras "
            "with `passerby record`, and calibrate the scene that it writes"
        )
    if DEVICE.match(text):
        return (
            "is a device: write it as `stream` into a file of cameras, record all cameras with `passerby record`, and "
            "calibrate the scene that it writes"
        )
    return None
