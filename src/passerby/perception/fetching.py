"""Download of a file of known size and SHA-256: resumed after a break, checked, and visible only when it is complete."""

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
"""Environment variable that forbids all downloads if it is set to a value other than 0."""

ANSWER_S = 6.0
"""Largest time for name resolution, connection and header together: users who are offline behind a firewall that drops packets
see the error after this time, independent of the number of the server's addresses."""

STALL_S = 20.0
"""A transfer in which no data arrive for this time is broken."""

IDLE_TRIES = 3
"""A broken transfer is resumed until this number of attempts in a row brought no data."""

CHUNK = 1 << 16
KILOBYTE = 1000
_REMEDY = "try `passerby models fetch` later, or get the file elsewhere and set PASSERBY_MODELS to its folder"
LOCAL = {"localhost", "127.0.0.1", "::1"}


class UnreachableError(Exception):
    """A file that is not available now: no network, no such page, no space in the cache. The message is one line."""


class _BrokenError(Exception):
    """A transfer that began and did not finish."""


def offline() -> bool:
    """Check whether the user has forbidden downloads."""
    return os.environ.get(OFFLINE, "") not in ("", "0")


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hex, about 1 ms per megabyte. Raises `InputError` when it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): check the file and its permissions") from None


def fetch(url: str, target: Path, sha256: str, size: int, tell: Progress = silent) -> None:
    """Fetch `url` to `target`, unless it is there when it is this process's turn.

    Received data are kept in a file `.NAME.HASH.part` beside it and continued after a break, by this call or a later one (HTTP
    Range; a server without it sends the whole file again). Processes that need the same file take turns. `target` appears by
    renaming, after its checksum was found correct. Proxies are taken from `http_proxy`, `https_proxy` and `no_proxy`.

    Args:
        url: https, or http on this computer.
        target: path of the file; missing folders are made.
        sha256: of the whole file, in hex.
        size: of the whole file, in bytes.
        tell: called with the number of kilobytes that have arrived.

    Raises `UnreachableError` where the file is not available (received data are kept), `InputError` where the server sends
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
                # After a crash the file may contain blocks that were never written: begin again, once.
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
    """Rename the complete file to its name, or delete it if it is not the right one."""
    found, length = sha256_of(part), part.stat().st_size
    if found != sha256:
        part.unlink()
        raise InputError(
            f"{url}: sends another file: SHA-256 {found} ({length} bytes) instead of {sha256} ({size} bytes); "
            f"it was deleted: {_REMEDY}"
        )
    os.replace(part, target)


def _complete_download(url: str, part: Path, size: int, stage: str, tell: Progress) -> None:
    """Download `part` up to `size` bytes (or more, if the server sends more); continue while attempts bring data."""
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
    """Append the data of one request, from byte `start` on; if the server sends the whole file again, overwrite `part`."""
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
    """Yield the content of a response as it arrives; `_BrokenError` where the network fails (not the disk written to)."""
    try:
        while block := response.read1(CHUNK):
            yield block
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenError(str(error) or type(error).__name__) from error


def _answer(url: str, start: int, size: int) -> tuple[Any, int]:
    """Request the file from a byte on; return the response and its first byte: `start`, or 0 from servers without parts."""
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
    """Return the response to a request for the bytes from `start` on; raises `UnreachableError` without one.

    The request runs in a thread of its own, because name resolution has no time limit, and the connection is tried with each of
    a server's addresses for the whole time limit.
    """
    headers = {"User-Agent": f"passerby/{__version__}", "Accept-Encoding": "identity"}
    request = urllib.request.Request(url, headers=headers | ({"Range": f"bytes={start}-"} if start else {}))
    answers: list[Any] = []

    def ask() -> None:
        try:
            answers.append(urllib.request.build_opener(_SafeRedirects).open(request, timeout=STALL_S))
        except Exception as error:  # Any error is raised below, in the thread that waits.
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
    """Follows a redirection only to addresses where a download may begin."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        """Return the next request. Raises `InputError` for an address that is not trusted."""
        _check_scheme(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _check_scheme(url: str) -> None:
    """Raise `InputError` for an address whose content others could change on the way."""
    parts = urllib.parse.urlsplit(url)
    if parts.scheme != "https" and not (parts.scheme == "http" and parts.hostname in LOCAL):
        raise InputError(f"{url}: is not an https address: models are fetched from https addresses only")


def _host(url: str) -> str:
    """Return name (and port) of the server."""
    return urllib.parse.urlsplit(url).netloc


def _explain_error(reason: object) -> str:
    """Return the message of the operating system, without its number."""
    return str(getattr(reason, "strerror", None) or reason)


def _length(part: Path) -> int:
    """Return the number of bytes that have arrived."""
    return part.stat().st_size if part.exists() else 0


@contextmanager
def _turn(lock: Path, name: str, tell: Progress) -> Iterator[None]:
    """Hold the file `lock` for this process alone; a process that ends releases it.

    The empty file is not deleted, because that would be a race.
    """
    with lock.open("ab") as file:
        while not try_lock(file):
            tell(f"waiting for another process that is fetching {name}")
            time.sleep(0.1)
        yield
