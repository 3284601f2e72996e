import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange import formats
from passerby.interchange.formats import Export, Format
from passerby.interchange.formats.values import tame_names

LENS = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(5))
RIG = Rig((Camera("A", LENS, Pose(np.eye(3), np.zeros(3))), Camera("B", LENS)))


@pytest.fixture
def made(monkeypatch):
    """A format that writes two files, and one that loses."""

    def write(rig, losses):
        rig.posed(losses)
        return {"a.txt": b"a", "below/b.txt": b"b"}

    known = {
        "two": Format("two", "two files", ("none",), "folder", write=write),
        "one": Format("one", "a file", ("none",), "file", (".one",), write=lambda rig, losses: {"": b"1"}),
        "read": Format("read", "read only", ("none",), "file", read=lambda path, given: RIG),
    }
    monkeypatch.setattr(formats, "MODULES", known)
    monkeypatch.setattr(formats, "find_format", known.__getitem__)


def test_a_loss_writes_nothing(made, tmp_path):
    with pytest.raises(InputError, match=r"camera B has no pose.*--lossy"):
        formats.export(Export(RIG), "two", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_lossy_tells_what_was_lost(made, tmp_path):
    told = formats.export(Export(RIG), "two", tmp_path / "out", lossy=True)
    assert told == ("camera B has no pose and is left out",)
    assert (tmp_path / "out/below/b.txt").read_bytes() == b"b"


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


def test_a_rig_without_poses_is_no_loss_but_an_error(made, tmp_path):
    with pytest.raises(InputError, match="none of the 1 cameras has a pose"):
        formats.export(Export(Rig((Camera("B", LENS),))), "two", tmp_path / "out", lossy=True)


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


def test_an_unknown_format_names_the_nearest():
    with pytest.raises(InputError, match="no format is called"):
        formats.find_format("colmpa")


def test_every_listed_format_is_there():
    for form in formats.all_formats():
        assert form.write or form.read or form.read_people, form.name
        assert all((form.title, form.tools, form.conventions)), form.name


def test_names_are_tamed_and_stay_apart():
    tame = tame_names(["../etc", "C1", "c/1", "C_1", "", "a<b>", "c1"])
    assert tame["C1"] == "C1"
    assert tame["C_1"] == "C_1"
    assert tame["../etc"] == "camera_.._etc"
    assert len({name.casefold() for name in tame.values()}) == 7
    assert not any(set(name) & set("/<>") for name in tame.values())
