"""The scene file of an output folder that was copied, moved, or written somewhere else."""

import shutil
from pathlib import Path

import pytest

from passerby.common.errors import InputError
from passerby.interchange.output_folder import read_report, scene_of
from support.refusals import refused
from support.scenes.output_folders import written_output


def found(out: Path) -> Path:
    return scene_of(out, read_report(out), "name it")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return written_output(tmp_path / "site")


def test_of_a_folder_where_it_was_written(out: Path) -> None:
    assert found(out) == out.parent / "scene.toml"


@pytest.mark.parametrize("place", ["out", "results/first/out"])
def test_a_copy_edits_no_file_of_the_original(out: Path, tmp_path: Path, place: str) -> None:
    shutil.copytree(out.parent, tmp_path / "copy")
    copied = tmp_path / "copy" / place
    if place != "out":
        shutil.move(tmp_path / "copy" / "out", copied)
    with refused("seems to be a copy", tmp_path / "copy" / "scene.toml"):
        found(copied)


def test_what_was_moved_together_belongs_together(out: Path, tmp_path: Path) -> None:
    out.parent.rename(tmp_path / "moved")
    assert found(tmp_path / "moved" / "out") == tmp_path / "moved" / "scene.toml"


def test_of_a_folder_elsewhere(out: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    shutil.move(out, tmp_path / "elsewhere" / "out")
    (tmp_path / "elsewhere" / "scene.toml").write_text('[cameras.X]\nvideo = "x.mp4"\n')  # of other cameras
    assert found(tmp_path / "elsewhere" / "out") == out.parent / "scene.toml"


def test_of_a_folder_whose_scene_file_is_gone(out: Path) -> None:
    (out.parent / "scene.toml").unlink()
    with pytest.raises(InputError, match=r"no such file: .* name it"):
        found(out)
