"""Text of messages: words and names, stream addresses without passwords, and how notebooks show values."""

from __future__ import annotations

import difflib
import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

LISTED = 50
"""So many names are listed in a message: a site has hundreds of cameras."""
FEWEST_MERGED = 4
Drawing = Callable[[object], str]
_drawing: list[Drawing] = []
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


def suggest_name(key: str, known: list[str]) -> str:
    """The remedy for a misspelt name."""
    same = [name for name in known if name.casefold() == key.casefold()]
    close = same or difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else f"there are {list_names(known)}"


def list_names(names: Sequence[str]) -> str:
    """Names in a message, those numbered in sequence as `C1 to C9`; the first of very many."""
    runs = _numbered_runs(names)
    more = sum(len(run) for run in runs[LISTED:])
    return ", ".join(map(_run_in_words, runs[:LISTED])) + (f" and {more} more" if more else "")


def merge_numbered(names: Sequence[str]) -> list[str]:
    """The names, but `C1 to C9` in place of `FEWEST_MERGED` or more that follow each other and differ by 1 in their number."""
    return [_run_in_words(run) for run in _numbered_runs(names)]


def _run_in_words(run: Sequence[str]) -> str:
    return run[0] if len(run) == 1 else f"{run[0]} to {run[-1]}"


def _numbered_runs(names: Sequence[str]) -> list[list[str]]:
    """The names in order: long runs together, each other name by itself."""
    runs: list[list[str]] = []
    for name in names:
        if runs and _next_name(runs[-1][-1]) == name:
            runs[-1].append(name)
        else:
            runs.append([name])
    parts = ([run] if len(run) >= FEWEST_MERGED else [[name] for name in run] for run in runs)
    return [part for each in parts for part in each]


def _next_name(name: str) -> str | None:
    """The name with the next number at its end, as `C10` after `C9` and `cam02` after `cam01`; None without a number."""
    digits = re.search(r"[0-9]+$", name)
    return None if digits is None else f"{name[: digits.start()]}{int(digits[0]) + 1:0{len(digits[0])}d}"


def shortened(value: Any) -> str:
    """A value as a message shows it; quick even where a few bytes of YAML stand for endless lists."""
    short = reprlib.Repr()
    short.maxlevel, short.maxlist, short.maxdict, short.maxstring, short.maxlong = 3, 16, 8, 90, 40
    short.maxother = 90
    text = short.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def shortened_text(text: str, most: int = 100) -> str:
    """Text out of a file as a message shows it, without quotes."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


_NUMBER = re.compile(r"[0-9]+")


def natural_key(text: str) -> tuple[str | int, ...]:
    """A key that sorts cam2 before cam10, and capitals with small letters."""
    parts = re.split(r"([0-9]+)", text.casefold())
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts))


def set_drawing(drawing: Drawing) -> None:
    """Say what draws values as HTML."""
    _drawing[:] = [drawing]


def html_of(value: object) -> str | None:
    """A value as HTML; None, at which a notebook prints its text, where nothing draws."""
    return _drawing[0](value) if _drawing else None


def remove_credentials(text: str) -> str:
    """The text with the user name and the password of each address in it replaced by dots."""
    if ADDRESS.search(text) is None:
        return text
    return _NAMED.sub(rf"\g<1>{HIDDEN}", _USER.sub(rf"\g<1>{HIDDEN}@", text))


def remove_all_credentials(value: Any) -> Any:
    """Tables, lists and texts, keys too, as `remove_credentials`; of the address of a video only its scheme is kept."""
    if isinstance(value, Mapping):
        return {
            remove_all_credentials(key): _scheme_only(part) if key == "video" else remove_all_credentials(part)
            for key, part in value.items()
        }
    if isinstance(value, list | tuple):
        return type(value)(map(remove_all_credentials, value)) if type(value) in (list, tuple) else value
    if isinstance(value, str):
        return remove_credentials(value)
    if isinstance(value, Path):
        hidden = remove_credentials(str(value))
        return value if hidden == str(value) else Path(hidden)
    return value


def _scheme_only(value: Any) -> Any:
    """An address without all that follows its scheme; anything else as `remove_all_credentials` has it."""
    found = ADDRESS.search(str(value)) if isinstance(value, str | Path) else None
    return remove_all_credentials(value) if found is None else f"{found[1].rstrip('/')}//{HIDDEN}"


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
