"""The files beside a report of many cameras. Each holds the data of one camera or plot, and the page loads it when needed.

A browser fetches no data for a page that was opened as a file, but it runs scripts: so each file is a script that passes a
value to the page. The files are in a folder whose name is a digest of their content. The page names that folder, so it never
loads files of another report, even if a process was killed: the folder is complete before the page is written, and the folder
of an earlier report is removed last.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from passerby.interchange.output_folder import report_folder
from passerby.interchange.storage.atomic import PART, cannot_write, sync_folder
from passerby.interchange.storage.text_formats import plain

NAME = re.compile("[a-z0-9-]+")


class Parts:
    """Files of a report that are being written."""

    def __init__(self, new: Path, folder: Path) -> None:
        """Prepare to write files into the folder `new`, which `place` moves into `folder`."""
        self._new, self._folder = new, folder
        self._digest = hashlib.blake2b(digest_size=8)

    def add(self, name: str, value: Any) -> None:
        """Write a value, which the page's script requests by its name. Raises `OSError`."""
        told = json.dumps(plain(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
        self._write(name, f"passerbyPart({json.dumps(name)},{told});\n")

    def add_script(self, name: str, script: str) -> None:
        """Write a script, which the page's script runs by its name. Raises `OSError`."""
        self._write(name, f"{script}\npasserbyPart({json.dumps(name)},null);\n")

    def _write(self, name: str, text: str) -> None:
        assert NAME.fullmatch(name), name
        data = text.encode("utf-8")
        self._digest.update(data)
        with (self._new / f"{name}.js").open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())

    @property
    def stamp(self) -> str:
        """Digest of the content of all files, hexadecimal."""
        return self._digest.hexdigest()

    def place(self) -> str:
        """Move the complete set of files to its final folder, and return this folder relative to the page. Raises `OSError`."""
        self._folder.mkdir(exist_ok=True)
        target = self._folder / self.stamp
        sync_folder(self._new)
        if target.is_dir():  # written earlier with the same content, and possibly damaged since
            for path in self._new.iterdir():
                os.replace(path, target / path.name)
        else:
            os.chmod(self._new, self._folder.stat().st_mode)
            os.rename(self._new, target)
        sync_folder(target)
        sync_folder(self._folder)
        return f"{self._folder.name}/{self.stamp}"


@contextmanager
def parts_beside(page: Path) -> Iterator[Parts]:
    """Open the files beside a page. The block calls `place` and then writes the page. Raises `InputError`."""
    try:
        page.parent.mkdir(parents=True, exist_ok=True)
        new = Path(tempfile.mkdtemp(dir=page.parent, prefix=f".{page.name}.", suffix=PART))
    except OSError as error:
        raise cannot_write(page, error) from error
    try:
        yield Parts(new, report_folder(page))
    except OSError as error:
        raise cannot_write(report_folder(page), error) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)
