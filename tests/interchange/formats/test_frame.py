import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange import formats
from passerby.interchange.formats import Export, Format

LENS = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(5))
RIG = Rig((Camera("A", LENS, Pose(np.eye(3), np.zeros(3))), Camera("B", LENS)))


@pytest.fixture
def made(monkeypatch):
    known = {
        "two": Format("two", "two files", ("none",), "folder", write=lambda *told: {"a.txt": b"a", "below/b.txt": b"b"}),
        "one": Format("one", "a file", ("none",), "file", (".one",), write=lambda *told: {"": b"1"}),
        "read": Format("read", "read only", ("none",), "file", read=lambda path, given: RIG),
    }
    monkeypatch.setattr(formats, "MODULES", known)
    monkeypatch.setattr(formats, "find_format", known.__getitem__)


def test_a_format_that_is_only_written_is_not_read(made, tmp_path):
    (tmp_path / "a.one").write_text("")
    with pytest.raises(InputError, match="format one holds no cameras that can be read: choose one of read"):
        formats.read_rig_as("one", tmp_path / "a.one")


@pytest.mark.parametrize("far", [1e308, 1e12])
def test_a_camera_that_is_nowhere_is_told(tmp_path, far):
    """A translation of 1e308 overflows on the way: NaN and infinity come out."""
    path = tmp_path / "gate.yml"
    path.write_text(f"projectionMatrix_3x4_w2p: [10, 0, 1, {far}, 0, 10, 1, -{far}, 0, 0, 1, 1]\n".replace("e+", "e"))
    with pytest.raises(InputError, match=f"{path}: camera gate: the translation of its pose is .*: correct its pose"):
        formats.read_rig_as("mv3dt", path, formats.Given((640, 480), 100.0))


def test_files_of_another_rig_are_not_left_beside_it(made, tmp_path):
    rig = Export(RIG.posed())
    for _ in range(2):
        formats.export(rig, "two", tmp_path / "out")
    (tmp_path / "out/notes.md").write_text("")
    formats.export(rig, "two", tmp_path / "out")
    (tmp_path / "out/below/other.txt").write_text("")
    with pytest.raises(InputError, match=r"other\.txt: would be taken for a part of the rig"):
        formats.export(rig, "two", tmp_path / "out")


def test_file_and_folder_are_told_apart(made, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file, but format two is a folder"):
        formats.export(Export(RIG.posed()), "two", tmp_path / "file")
    with pytest.raises(InputError, match="is a folder, but format one is one file"):
        formats.export(Export(RIG), "one", tmp_path)
    with pytest.raises(InputError, match="only read"):
        formats.export(Export(RIG), "read", tmp_path / "x")
    with pytest.raises(InputError, match="no such file"):
        formats.read_rig_as("read", tmp_path / "x")
