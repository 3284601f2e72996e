"""The files beside a report of many cameras: whole, under a name of their content, or not there at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from passerby.common.errors import InputError
from passerby.report import parts as module
from passerby.report.parts import parts_beside


def write(page: Path, **values: Any) -> str:
    with parts_beside(page) as parts:
        for name, value in values.items():
            parts.add(name, value)
        parts.add_script("plot", "drawn();")
        return parts.place()


def files(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_files_lie_in_a_folder_that_is_named_after_their_content(tmp_path: Path) -> None:
    place = write(tmp_path / "new" / "report.html", c1={"x": [1.0, float("nan")], "text": "</script>é"})
    assert place.startswith("report_files/")
    assert files(tmp_path / "new") == {
        f"{place}/c1.js": 'passerbyPart("c1",{"x":[1.0,null],"text":"</script>\\u00e9"});\n',
        f"{place}/plot.js": 'drawn();\npasserbyPart("plot",null);\n',
    }
    other = write(tmp_path / "new" / "report.html", c1=2)
    assert other != place
    assert {Path(name).parent.as_posix() for name in files(tmp_path / "new")} == {place, other}


def test_files_of_the_same_content_that_were_damaged_are_mended(tmp_path: Path) -> None:
    place = write(tmp_path / "report.html", c1=1, c2=2)
    whole = files(tmp_path)
    (tmp_path / place / "c1.js").write_text("damaged")
    (tmp_path / place / "c2.js").unlink()
    assert write(tmp_path / "report.html", c1=1, c2=2) == place
    assert files(tmp_path) == whole
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report_files"]


def test_a_place_that_cannot_be_written_to_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"file/report\.html: cannot be written"):
        write(tmp_path / "file" / "report.html", c1=1)
    (tmp_path / "report_files").write_text("mine")
    with pytest.raises(InputError, match="report_files: cannot be written"):
        write(tmp_path / "report.html", c1=1)
    assert files(tmp_path) == {"file": "mine", "report_files": "mine"}


def test_a_full_disk_leaves_the_files_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "report.html", c1=1)
    before = files(tmp_path)

    full = Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    monkeypatch.setattr(module.os, "fsync", full)
    with pytest.raises(InputError, match=r"report_files: cannot be written \(No space left on device\): make room there"):
        write(tmp_path / "report.html", c1=2)
    assert files(tmp_path) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report_files"]
