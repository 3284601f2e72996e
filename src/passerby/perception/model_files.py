"""Places of the networks: the user's own file, a folder of models, or the cache to which they are fetched on first use."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile, ZipFile

import platformdirs

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.interchange.storage.atomic import write_bytes
from passerby.perception.fetching import UnreachableError, fetch, sha256_of
from passerby.perception.networks import ArchiveTable, InputConvention, ModelEntry, Network, Role, catalogue, default_of

AUTO = "auto"
MODELS = "PASSERBY_MODELS"
"""Environment variable: folders that contain models, separated as in PATH."""


class Found(NamedTuple):
    """Result of a search for a network."""

    network: Network | None
    reason: str = ""
    """One line with the reason why there is none; empty where there is one."""


@dataclass(frozen=True)
class Copy:
    """A file on this computer with the name of a model in the manifest."""

    entry: ModelEntry
    path: Path
    sha256: str
    """Checksum of the file as found, in hex."""

    @property
    def right(self) -> bool:
        """Whether it is the file that the manifest specifies."""
        return self.sha256 == self.entry.sha256

    def check(self) -> None:
        """Raise `InputError` where it is another file."""
        if not self.right:
            raise InputError(
                f"{self.path}: is not {self.entry.name}: SHA-256 {self.sha256} instead of {self.entry.sha256}: delete it and "
                f"run `passerby models fetch {self.entry.name}`, or name it by path if it is a network of your own"
            )


def cache_folder() -> Path:
    """Return the folder of fetched models; it need not exist."""
    return platformdirs.user_cache_path("passerby") / "models"


def model_folders(folder: Path | None = None) -> tuple[Path, ...]:
    """Return the folders that are searched for models, in this order: `folder`, those of `PASSERBY_MODELS`, the cache.

    Raises `InputError` where a path that a user named is not a folder.
    """
    named = [(str(folder), folder)] if folder is not None else []
    named += [(f"{MODELS}: {text}", Path(text).expanduser()) for text in os.environ.get(MODELS, "").split(os.pathsep) if text]
    for told, path in named:
        if not path.is_dir():
            raise InputError(f"{told}: is not a folder: models are searched there; correct it or leave it out")
    return (*(path for _, path in named), cache_folder())


def find_model(
    name_or_path: str | Path,
    role: Role,
    folder: Path | None = None,
    *,
    base: Path | None = None,
    download: bool = True,
    tell: Progress = silent,
) -> Found:
    """Find the network that a user names; fetch it where it is not on this computer and its publisher can be reached.

    Args:
        name_or_path: "auto" for the role's default, a name of the manifest, or the path of an ONNX file.
        role: its use.
        folder: a folder of models to look in first.
        base: the folder that a relative path starts from; the current one.
        download: False to search only.
        tell: called with the progress of a download.

    Returns:
        The network, with its checksum and convention; or None and the reason, where it is not here and cannot be fetched now.

    Raises `InputError` for a file that is missing, is no network or one of another role, an unknown name, a file of a known
    name with a wrong checksum, and a model that is not on this computer and has no download address.
    """
    text = str(name_or_path)
    if _is_path(name_or_path):
        return Found(_open_by_path((base or Path()) / Path(text).expanduser(), role))
    entry = default_of(role) if text == AUTO else entry_of(text, role)
    if entry is None:
        return Found(None, f"there is no default network for {role}: name one by path")
    for copy in copies_of(entry, folder):
        copy.check()
        return Found(_network(entry, copy.path))
    if entry.url is None:
        raise InputError(
            f"{entry.name}: is not on this computer and has no download address: put {entry.file} into a folder that {MODELS} "
            "names, or name another network by path"
        )
    if not download:
        return Found(None, f"{entry.name} is not on this computer: `passerby models fetch` downloads it")
    try:
        return Found(_network(entry, fetch_model(entry, tell)))
    except UnreachableError as error:
        return Found(None, f"{entry.name} is not on this computer and cannot be fetched: {error}; see `passerby models`")


def fetch_model(entry: ModelEntry, tell: Progress = silent) -> Path:
    """Fetch a model into the cache, unless it is there, and return its path.

    Raises `UnreachableError` where it is unavailable now, `InputError` where it has no download address or the file is wrong.
    """
    if entry.url is None:
        raise InputError(f"{entry.name}: has no download address: put {entry.file} into a folder that {MODELS} names")
    path = cache_folder() / entry.file
    if entry.archive is None:
        fetch(entry.url, path, entry.sha256, entry.bytes, tell)
    elif not path.is_file():
        _fetch_unpacked(entry, entry.url, entry.archive, path, tell)
    Copy(entry, path, sha256_of(path)).check()
    return path


def _fetch_unpacked(entry: ModelEntry, url: str, archive: ArchiveTable, path: Path, tell: Progress) -> None:
    """Fetch a zip archive and keep only the network's file, if its checksum is correct."""
    packed = path.with_suffix(".zip")
    fetch(url, packed, archive.sha256, archive.bytes, tell)
    try:
        with ZipFile(packed) as opened:
            member = next(name for name in opened.namelist() if name.endswith(archive.member))
            content = opened.read(member)
    except (StopIteration, BadZipFile, OSError):
        raise InputError(f"{url}: holds no readable {archive.member}: get {entry.file} elsewhere") from None
    finally:
        packed.unlink(missing_ok=True)
    found = hashlib.sha256(content).hexdigest()
    if found != entry.sha256:
        raise InputError(f"{url}: holds another {archive.member}: SHA-256 {found} instead of {entry.sha256}")
    write_bytes(path, content)


def copies_of(entry: ModelEntry, folder: Path | None = None) -> Iterator[Copy]:
    """Return all files with a model's name, the one to use first, each with its checksum; one may be a wrong file."""
    for place in model_folders(folder):
        path = place / entry.file
        if path.is_file():
            yield Copy(entry, path, sha256_of(path))


def entry_of(name: str, role: Role | None = None) -> ModelEntry:
    """Return the manifest's entry of a name. Raises `InputError` where there is none, or it is for another role."""
    entry = next((entry for entry in catalogue() if entry.name == name), None)
    if entry is not None and role in (None, entry.role):
        return entry
    known = ", ".join(entry.name for entry in catalogue() if role in (None, entry.role))
    wrong = f"{name}: is not a model that Passerby knows" if entry is None else f"{name}: is for {entry.role}, not for {role}"
    raise InputError(f"{wrong}: there are {known}" + (f", {AUTO}, or the path of an .onnx file" if role else ""))


def _is_path(name_or_path: str | Path) -> bool:
    """Check whether it is a path: it ends in .onnx, contains a folder, or is a `Path`."""
    text = str(name_or_path)
    return isinstance(name_or_path, Path) or text.lower().endswith(".onnx") or "/" in text or os.sep in text


def _open_by_path(path: Path, role: Role) -> Network:
    """Open a user's file: by its checksum a network of the manifest, under any name, or else their own."""
    from passerby.perception.networks import read_own_network

    if not path.is_file():
        raise InputError(f"{path}: no such file: the path of an .onnx file is needed for the {role}; check its spelling")
    sha256 = sha256_of(path)
    entry = next((entry for entry in catalogue() if entry.sha256 == sha256), None)
    if entry is None:
        return read_own_network(path, role, sha256)
    if entry.role != role:
        raise InputError(f"{path}: is {entry.name}, a network for {entry.role}, not for {role}: name one of that role")
    return _network(entry, path)


def _network(entry: ModelEntry, path: Path) -> Network:
    """Return the network of an entry in a file with the entry's checksum."""
    convention = entry.input.over(InputConvention())
    return Network(entry.name, entry.role, path, entry.sha256, entry.output, convention, entry.licence)
