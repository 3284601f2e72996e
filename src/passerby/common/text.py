"""Text of messages: words and names, stream addresses without passwords, and the representation of values in notebooks."""

from __future__ import annotations

import difflib
import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

LISTED = 50
"""Maximum number of names that a message lists: a site has hundreds of cameras."""
FEWEST_MERGED = 4
Drawing = Callable[[object], str]
_drawing: list[Drawing] = []
_KNOWN = "rtsps?|rtspu|rtmps?|rtmpe|rtmpt|https?|ftps?|sftp|udp|tcp|rtp|srtp?|mms[ht]?|wss?|smb|file"
"""Schemes that are also recognised with one slash: `pathlib` merges the two slashes."""
_BEGIN = rf"(?:(?:{_KNOWN}):/+|[a-z][a-z0-9+.-]+://)"
ADDRESS = re.compile(rf"(?<![a-z0-9])({_BEGIN})", re.IGNORECASE)
DEVICE = re.compile(r"/dev/\S")
_USER = re.compile(rf"({_BEGIN})[^\n@]*@(?:[^\s'\"]*@)?", re.IGNORECASE)
"""An address up to the first @, or up to the last @ of the same word: a password may contain spaces, or an @."""
_NAMED = re.compile(
    r"((?:^|[?&;/_])(?:user(?:name)?|usr|login|pass(?:word|wd)?|pwd|psw|auth|token|key)=)[^&;\s'\"]*", re.IGNORECASE
)
"""User names and passwords as parameters of an address, which many cameras accept."""
HIDDEN = "..."


def suggest_name(key: str, known: list[str]) -> str:
    """Suggest the known name that is closest to a misspelt one, or list the known names."""
    same = [name for name in known if name.casefold() == key.casefold()]
    close = same or difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else f"there are {list_names(known)}"


def list_names(names: Sequence[str]) -> str:
    """Format names for a message: names numbered in sequence as `C1 to C9`, and at most `LISTED` of them."""
    runs = _numbered_runs(names)
    more = sum(len(run) for run in runs[LISTED:])
    return ", ".join(map(_run_in_words, runs[:LISTED])) + (f" and {more} more" if more else "")


def merge_numbered(names: Sequence[str]) -> list[str]:
    """Replace each run of `FEWEST_MERGED` or more consecutive names whose numbers increase by 1 with a text as `C1 to C9`."""
    return [_run_in_words(run) for run in _numbered_runs(names)]


def _run_in_words(run: Sequence[str]) -> str:
    return run[0] if len(run) == 1 else f"{run[0]} to {run[-1]}"


def _numbered_runs(names: Sequence[str]) -> list[list[str]]:
    """Group the names in their order: a run of `FEWEST_MERGED` or more is one group, each other name is a group by itself."""
    runs: list[list[str]] = []
    for name in names:
        if runs and _next_name(runs[-1][-1]) == name:
            runs[-1].append(name)
        else:
            runs.append([name])
    parts = ([run] if len(run) >= FEWEST_MERGED else [[name] for name in run] for run in runs)
    return [part for each in parts for part in each]


def _next_name(name: str) -> str | None:
    """Return the name with the next number at its end, as `C10` after `C9` and `cam02` after `cam01`; None without a number."""
    digits = re.search(r"[0-9]+$", name)
    return None if digits is None else f"{name[: digits.start()]}{int(digits[0]) + 1:0{len(digits[0])}d}"


def shortened(value: Any) -> str:
    """Return a short representation of a value for a message. It is fast even if a few bytes of YAML expand to huge lists."""
    short = reprlib.Repr()
    short.maxlevel, short.maxlist, short.maxdict, short.maxstring, short.maxlong = 3, 16, 8, 90, 40
    short.maxother = 90
    text = short.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def shortened_text(text: str, most: int = 100) -> str:
    """Shorten a text from a file to `most` characters for a message, without quotes."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


_NUMBER = re.compile(r"[0-9]+")


def natural_key(text: str) -> tuple[str | int, ...]:
    """Return a sort key that places cam2 before cam10 and ignores the case of letters."""
    parts = re.split(r"([0-9]+)", text.casefold())
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts))


def set_drawing(drawing: Drawing) -> None:
    """Set the function that draws values as HTML."""
    _drawing[:] = [drawing]


def html_of(value: object) -> str | None:
    """Return a value as HTML; None if no drawing function is set, and a notebook then prints the value's text."""
    return _drawing[0](value) if _drawing else None


def remove_credentials(text: str) -> str:
    """Replace the user name and the password of each address in a text by dots."""
    if ADDRESS.search(text) is None:
        return text
    return _NAMED.sub(rf"\g<1>{HIDDEN}", _USER.sub(rf"\g<1>{HIDDEN}@", text))


def remove_all_credentials(value: Any) -> Any:
    """Apply `remove_credentials` to tables (also to their keys), lists and texts; keep only the scheme of a video's address."""
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
    """Return only the scheme of an address; any other value as `remove_all_credentials` returns it."""
    found = ADDRESS.search(str(value)) if isinstance(value, str | Path) else None
    return remove_all_credentials(value) if found is None else f"{found[1].rstrip('/')}//{HIDDEN}"


def not_a_file(text: str) -> str | None:
    """Return the remedy for a text that is the address of a stream or a device instead of a video's path; None for a path.

    The remedy does not repeat the text, because it may contain a password.
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
