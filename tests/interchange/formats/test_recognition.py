"""Which format a file has: every format recognises what it writes or reads, no other does, and nothing makes it fail."""

import pytest

from passerby.interchange.formats import Given, all_formats, read_rig_as, recognise_format
from passerby.interchange.rig_toml import write_rig
from support.untrusted import example_files as example

BY_FOLDER = {
    "colmap": "cameras.txt", "colmap-bin": "cameras.bin", "opencv": "A.yml", "easymocap": "intri.yml",
    "ros": "camera_info/A.yaml", "mv3dt": "camInfo/A.yml",
}  # fmt: skip
"""The file of a folder's rig that has the intrinsics."""
BY_NAME = {"pose2sim": "Calib.toml"}
"""Where the content alone does not tell."""
READERS = [form for form in all_formats() if form.read is not None]


def laid_out(form, folder):
    if form.target == "folder":
        for name, content in example.exported(form.name, "").items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        return folder / BY_FOLDER[form.name]
    path = folder / BY_NAME.get(form.name, f"rig{form.suffixes[0]}")
    path.write_bytes(example.exported(form.name, path.name)[path.name])
    return path


@pytest.mark.parametrize("form", READERS, ids=lambda form: form.name)
def test_a_format_recognises_its_files_and_reads_what_it_recognises(form, tmp_path):
    path = laid_out(form, tmp_path)
    found = recognise_format(path)
    assert found.name == form.name
    size = None if form.name in example.READ_ONLY else (640, 480)
    assert len(read_rig_as(found.name, path, Given(size, 1.0), lossy=True)[0])


def test_what_is_no_other_tools_calibration(tmp_path):
    write_rig(tmp_path / "rig.toml", example.rig())
    (tmp_path / "scene.toml").write_text(example.SCENE)
    (tmp_path / "A.json").write_bytes(example.joints_file())
    (tmp_path / "notes.cal").write_text("a text that another tool wrote")
    (tmp_path / "model.pickle").write_bytes(b"\x80\x04K\x01.")
    for path in [*tmp_path.iterdir(), tmp_path, tmp_path / "missing.json"]:
        assert recognise_format(path) is None


def test_a_binary_calibration_of_motive_is_recognised(tmp_path):
    (tmp_path / "lab.cal").write_bytes(bytes(range(256)))
    assert recognise_format(tmp_path / "lab.cal").name == "motive"
