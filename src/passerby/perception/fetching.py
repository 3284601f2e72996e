"""Fetching a file of known size and SHA-256: resumed where it broke off, checked, and never seen before it is whole."""

from __future__ import annotations

import hashlib
import http.client
import os
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from passerby._version import __version__
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent, tell_failure
from passerby.interchange.storage.transaction import try_lock

OFFLINE = "PASSERBY_OFFLINE"
"""Environment variable that forbids all downloads where it is set to anything but 0."""

ANSWER_S = 6.0
"""So long a server may take for names, connection and header together: who is offline behind a firewall that drops packets
learns it after this time, whatever the number of the server's addresses."""

STALL_S = 20.0
"""A transfer in which nothing arrives for so long is broken."""

IDLE_TRIES = 3
"""A transfer that breaks is taken up again until so many tries in a row brought nothing."""

CHUNK = 1 << 16
KILOBYTE = 1000
_REMEDY = "try `passerby models fetch` later, or get the file elsewhere and set PASSERBY_MODELS to its folder"
LOCAL = {"localhost", "127.0.0.1", "::1"}


class UnreachableError(Exception):
    """A file that cannot be had just now: no network, no such page, no room in the cache. The message is one line."""


class _BrokenError(Exception):
    """A transfer that began and did not come to its end."""


def offline() -> bool:
    """Whether the user has forbidden downloads."""
    return os.environ.get(OFFLINE, "") not in ("", "0")


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file in hex, about 1 ms a megabyte. Raises `InputError` when it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): check the file and its permissions") from None


def fetch(url: str, target: Path, sha256: str, size: int, tell: Progress = silent) -> None:
    """Fetch `url` to `target`, unless it is there by the time that this process has its turn.

    What has arrived is kept in a file `.NAME.HASH.part` beside it and gone on with after a break, by this call or a later one
    (HTTP Range; a server that does not know it sends the whole again). Processes that want the same file take turns. `target`
    appears by renaming, once its checksum is right. Proxies are taken from `http_proxy`, `https_proxy` and `no_proxy`.

    Args:
        url: https, or http on this computer.
        target: where the file shall lie; missing folders are made.
        sha256: of the whole file, in hex.
        size: of the whole file, in bytes.
        tell: called with the number of kilobytes that have arrived.

    Raises `UnreachableError` where the file cannot be had (what has arrived is kept), `InputError` where the server sends
    another file (which is not kept).
    """
    if offline():
        raise UnreachableError(f"{OFFLINE} is set: {target.name} is not fetched")
    _check_scheme(url)
    stage = f"fetching {target.name} (kB)"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with _turn(target.with_name(f".{target.name}.lock"), target.name, tell):
            if target.exists():
                return
            part = target.with_name(f".{target.name}.{sha256[:12]}.part")
            resumed = part.exists()
            _complete_download(url, part, size, stage, tell)
            if resumed and sha256_of(part) != sha256:
                # What a crash left may hold blocks that were never written: begin anew, once.
                part.unlink()
                _complete_download(url, part, size, stage, tell)
            _accept(url, part, target, sha256, size)
    except (UnreachableError, InputError):
        tell_failure(tell, stage)
        raise
    except OSError as error:
        tell_failure(tell, stage)
        where = error.filename or target.parent
        raise UnreachableError(
            f"{where}: cannot be written ({error.strerror or error}): {target.name} is not stored"
        ) from error


def _accept(url: str, part: Path, target: Path, sha256: str, size: int) -> None:
    """Give the whole file its name, or delete it where it is not the right one."""
    found, length = sha256_of(part), part.stat().st_size
    if found != sha256:
        part.unlink()
        raise InputError(
            f"{url}: sends another file: SHA-256 {found} ({length} bytes) instead of {sha256} ({size} bytes); "
            f"it was deleted: {_REMEDY}"
        )
    os.replace(part, target)


def _complete_download(url: str, part: Path, size: int, stage: str, tell: Progress) -> None:
    """Bring `part` to `size` bytes (or beyond, where the server sends more), in as many tries as bring anything."""
    tell(stage, 0, -(-size // KILOBYTE))
    idle = 0
    while (before := _length(part)) < size:
        try:
            _receive(url, part, before, size, stage, tell)
            reason = "the connection broke off"
        except _BrokenError as error:
            reason = str(error)
        after = _length(part)
        idle = 0 if after > before else idle + 1
        if after < size and idle >= IDLE_TRIES:
            raise UnreachableError(f"{_host(url)}: {reason} after {after} of {size} bytes of {part.name[1:].split('.part')[0]}")


def _receive(url: str, part: Path, start: int, size: int, stage: str, tell: Progress) -> None:
    """Append what one request brings, from byte `start` on; a server that sends the whole again overwrites `part`."""
    response, start = _answer(url, start, size)
    with response, part.open("ab" if start else "wb") as file:
        for block in _blocks(response):
            file.write(block)
            start += len(block)
            tell(stage, min(start, size) // KILOBYTE, -(-size // KILOBYTE))
            if start > size:
                break
        file.flush()
        os.fsync(file.fileno())


def _blocks(response: Any) -> Iterator[bytes]:
    """What an answer holds, as it arrives; `_BrokenError` where the network fails (and not the disk that it is written to)."""
    try:
        while block := response.read1(CHUNK):
            yield block
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenError(str(error) or type(error).__name__) from error


def _answer(url: str, start: int, size: int) -> tuple[Any, int]:
    """An answer that holds the file from some byte on, and that byte: `start`, or 0 where the server does not do parts."""
    response = _open(url, start)
    if response.status == http.client.PARTIAL_CONTENT:
        if response.headers.get("Content-Range") == f"bytes {start}-{size - 1}/{size}":
            return response, start
        response.close()
        response = _open(url, 0)
    announced = response.headers.get("Content-Length", str(size))
    if announced != str(size):
        response.close()
        raise InputError(f"{url}: sends another file ({announced} bytes instead of {size}): {_REMEDY}")
    return response, 0


def _open(url: str, start: int) -> Any:
    """The answer to a request for the bytes from `start` on, or `UnreachableError`.

    Asked for in a thread of its own, for a name that cannot be resolved is waited for without a limit, and a connection is
    tried with each of a server's addresses for the whole of the limit.
    """
    headers = {"User-Agent": f"passerby/{__version__}", "Accept-Encoding": "identity"}
    request = urllib.request.Request(url, headers=headers | ({"Range": f"bytes={start}-"} if start else {}))
    answers: list[Any] = []

    def ask() -> None:
        try:
            answers.append(urllib.request.build_opener(_SafeRedirects).open(request, timeout=STALL_S))
        except Exception as error:  # Whatever it is, it is raised below, in the thread that waits.
            answers.append(error)

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(ANSWER_S)
    if not answers:
        raise UnreachableError(f"{_host(url)}: no answer within {ANSWER_S:g} s")
    answer = answers[0]
    if not isinstance(answer, Exception):
        return answer
    if isinstance(answer, urllib.error.HTTPError):
        answer.close()
        if start and answer.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
            return _open(url, 0)
        raise UnreachableError(f"{url}: the server says {answer.code} {answer.reason}") from answer
    if isinstance(answer, urllib.error.URLError):
        raise UnreachableError(f"{_host(url)}: no connection ({_explain_error(answer.reason)})") from answer
    if isinstance(answer, (OSError, http.client.HTTPException)):
        raise _BrokenError(str(answer) or type(answer).__name__) from answer
    raise answer


class _SafeRedirects(urllib.request.HTTPRedirectHandler):
    """Follows a redirection only to where a download may begin, too."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        """The request that follows. Raises `InputError` for an address that is not to be trusted."""
        _check_scheme(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _check_scheme(url: str) -> None:
    """Raises `InputError` for an address that others on the way could change."""
    parts = urllib.parse.urlsplit(url)
    if parts.scheme != "https" and not (parts.scheme == "http" and parts.hostname in LOCAL):
        raise InputError(f"{url}: is not an https address: models are fetched from https addresses only")


def _host(url: str) -> str:
    """Name (and port) of the server."""
    return urllib.parse.urlsplit(url).netloc


def _explain_error(reason: object) -> str:
    """What the operating system says, without its number."""
    return str(getattr(reason, "strerror", None) or reason)


def _length(part: Path) -> int:
    """So many bytes have arrived."""
    return part.stat().st_size if part.exists() else 0


@contextmanager
def _turn(lock: Path, name: str, tell: Progress) -> Iterator[None]:
    """Hold the file `lock` for this process alone; a process that dies releases it. The empty file stays: to delete it
    is a race.
    """
    with lock.open("ab") as file:
        while not try_lock(file):
            tell(f"waiting for another process that is fetching {name}")
            time.sleep(0.1)
        yield
