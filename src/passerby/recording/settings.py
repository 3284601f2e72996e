"""Settings of a recording: the file of cameras, and the source of user names and passwords.

An address is kept apart from everything that is shown: `Stream.shown` contains no user name, password or parameter.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from passerby.common.errors import InputError
from passerby.common.text import ADDRESS, remove_credentials, shortened, suggest_name
from passerby.interchange.storage.safe_parsing import read_text, read_toml
from passerby.scene.scene import CAMERA_NAME

Transport = Literal["tcp", "udp"]

SCHEMES = ("rtsp", "rtsps", "http", "https")
DEVICE = re.compile(r"/dev/video\d+")
VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)\}")
KEYS = ("stream", "transport")
"""Keys of a camera that the recording uses; all others belong to the scene."""


@dataclass(frozen=True, repr=False)
class Stream:
    """The source of a camera's pictures."""

    camera: str
    address: str
    """Address with user name and password: only for the connection, never to be shown."""
    transport: Transport = "tcp"

    @property
    def shown(self) -> str:
        """Scheme, host and port of the address, or the path of a device; without user name and password."""
        if DEVICE.fullmatch(self.address):
            return self.address
        scheme, _, rest = self.address.partition("://")
        return f"{scheme}://{rest.rpartition('@')[2].split('/')[0].split('?')[0]}"

    def __repr__(self) -> str:
        return f"<stream of {self.camera}, {self.shown}>"

    def hidden(self, text: str) -> str:
        """Remove this stream's address, user name and password from a text of another library."""
        secret = self.address.partition("://")[2].rpartition("@")[0]
        for part in sorted({self.address, secret, *secret.split(":", 1)} - {""}, key=len, reverse=True):
            text = text.replace(part, "...") if len(part) > 2 or part == secret else text
        return remove_credentials(text)


@dataclass(frozen=True)
class RecordingPlan:
    """The streams to record, and the other keys and tables of the file, for the scene file."""

    place: Path
    streams: tuple[Stream, ...]
    cameras: Mapping[str, Mapping[str, Any]]
    """Other keys of each camera's table, for the scene file."""
    tables: Mapping[str, Any]
    """Other tables, for the scene file."""


def read_plan(path: Path, environment: Mapping[str, str] | None = None) -> RecordingPlan:
    """Read a file of cameras.

    `${NAME}` in an address stands for a variable of the environment, or of the file of `NAME=VALUE` lines that `[recording]
    secrets` names.

    Raises `InputError` if the file does not exist or is not TOML, `[recording]` has an unknown key, a camera has no stream, an
    address is invalid, a variable is not set, or two cameras have the same stream.
    """
    content = read_toml(path, "a file of cameras to record (TOML)")
    own = content.pop("recording", {})
    if not isinstance(own, dict) or set(own) - {"secrets"}:
        unknown = ", ".join(sorted(set(own) - {"secrets"})) if isinstance(own, dict) else shortened(own)
        raise InputError(f"{path}: [recording] {unknown}: unknown; the only key is secrets")
    known = dict(os.environ if environment is None else environment)
    if "secrets" in own:
        known |= read_secrets(path.parent / str(own["secrets"]))
    cameras = content.pop("cameras", {})
    if not isinstance(cameras, dict) or not cameras:
        raise InputError(f'{path}: names no cameras: add a table [cameras.NAME] with stream = "rtsp://..." for each')
    streams = tuple(stream_of(path, name, table, known) for name, table in cameras.items())
    check_streams_differ(path, streams)
    others = {name: {key: value for key, value in table.items() if key not in KEYS} for name, table in cameras.items()}
    return RecordingPlan(path, streams, others, content)


def stream_of(path: Path, name: str, table: Any, known: Mapping[str, str], key: str = "stream") -> Stream:
    """Return the stream that a key of one camera's table names. Raises `InputError`; no message repeats an address."""
    place = f"{path}: [cameras.{shortened(name)}]"
    if not CAMERA_NAME.fullmatch(name):
        raise InputError(f"{place}: this name cannot be that of a folder: use letters, digits and . _ + @ -")
    if not isinstance(table, dict) or key not in table:
        near = f" ({suggest_name(key, list(table))})" if isinstance(table, dict) and table else ""
        raise InputError(f'{place} has no {key}{near}: add {key} = "rtsp://HOST/PATH", or "/dev/video0"')
    address, transport = table[key], table.get("transport", "tcp")
    if transport not in ("tcp", "udp"):
        raise InputError(f'{place} transport is {shortened(transport)}: write "tcp" or "udp"')
    if not isinstance(address, str):
        raise InputError(f"{place} {key} is not a text: write an address in quotes")
    for variable in VARIABLE.findall(address):
        if variable not in known:
            where = "in the environment, or in the file that [recording] secrets names"
            raise InputError(f"{place} {key}: ${{{variable}}} is not set: set it {where}")
    address = VARIABLE.sub(lambda found: known[found[1]], address)
    found = ADDRESS.match(address)
    scheme = found[1].split(":")[0].lower() if found else None
    if DEVICE.fullmatch(address) is None and (scheme not in SCHEMES or "://" not in address):
        kind = f"{scheme}://..." if scheme else "this text"
        raise InputError(
            f"{place} {key}: {kind} is no address that can be recorded: use rtsp, rtsps, http or https, or /dev/video0"
        )
    if scheme is not None and not address.partition("://")[2].rpartition("@")[2].split("/")[0]:
        raise InputError(f"{place} {key}: the address names no host")
    return Stream(name, address, transport)


def check_streams_differ(path: Path, streams: Sequence[Stream], key: str = "stream") -> None:
    """Raise `InputError` if two cameras name the same stream: probably a copying mistake, which would use one camera twice."""
    first: dict[str, str] = {}
    for stream in streams:
        other = first.setdefault(stream.address, stream.camera)
        if other != stream.camera:
            raise InputError(
                f"{path}: [cameras.{stream.camera}] {key}: its address is that of camera {other}: give each camera its own"
            )


def read_secrets(path: Path) -> dict[str, str]:
    """Read the variables of a file of `NAME=VALUE` lines; messages never show the values."""
    found = {}
    for number, line in enumerate(read_text(path, "a file of secrets").splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        name, equals, value = line.partition("=")
        if not equals or not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name.strip()):
            raise InputError(f"{path}: line {number} is not NAME=VALUE")
        found[name.strip()] = value.strip().strip("'\"")
    return found
