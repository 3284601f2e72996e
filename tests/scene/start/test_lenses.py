"""Calibration files of other tools in a user's folder: used where a reader knows them, else named."""

from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Export, Format, export, find_format
from passerby.interchange.rig_toml import read_lens
from passerby.perception.video_probe import VideoInfo
from passerby.scene.start import lenses
from passerby.scene.start.folders import FoundCamera
from passerby.scene.start.lenses import CameraLens, find_lenses

SIZES = {"a": (640, 480), "b": (1280, 720)}


def lens(focal: float, size: tuple[int, int] = (640, 480)) -> Lens:
    return Lens(size, np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]]), np.zeros(5))


def rig(**sizes: tuple[int, int]) -> Rig:
    """Focal lengths 500, 510, ... in the order of the cameras."""
    return Rig(
        tuple(
            Camera(name, lens(500.0 + 10 * number, size), Pose(np.eye(3), np.array([number, 0.0, 3.0])))
            for number, (name, size) in enumerate(sizes.items())
        )
    )


def cameras(folder: Path, **sizes: tuple[int, int]) -> list[FoundCamera]:
    return [
        FoundCamera(name, folder / f"{name}.mp4", VideoInfo(folder / name, size, "h264", 25.0, False, 25.0, 250, 10.0))
        for name, size in sizes.items()
    ]


def find(folder: Path, **sizes: tuple[int, int]) -> tuple[dict[str, CameraLens], list[str]]:
    notes: list[str] = []
    return find_lenses(folder, cameras(folder, **sizes), notes, folder / "scene.toml"), notes


def focals(found: dict[str, CameraLens]) -> dict[str, float]:
    return {name: one.lens.focal for name, one in found.items() if one.lens is not None}


@pytest.mark.parametrize("names", [("cam_0", "cam_1"), ("left", "right"), ("port 0", "port 1")])
def test_tables_of_caliscope_are_used_in_place(tmp_path: Path, names: tuple[str, str]) -> None:
    sizes = dict.fromkeys(names, (640, 480))
    export(Export(rig(**sizes)), "caliscope", tmp_path / "camera_array.toml")
    found, _ = find(tmp_path, **sizes)
    assert focals(found) == dict(zip(names, (500.0, 510.0), strict=True))
    for name, one in found.items():
        assert one.table is not None
        assert read_lens(one.source, one.table).focal == focals(found)[name]


def recognise(monkeypatch: pytest.MonkeyPatch, **forms: Format | str) -> None:
    """Files that a reader recognises, by their names without endings."""
    known = {name: find_format(form) if isinstance(form, str) else form for name, form in forms.items()}
    monkeypatch.setattr(lenses, "recognise_format", lambda path: known.get(Path(path).stem))


def test_the_size_of_the_videos_stands_in_for_one_that_is_not_stated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = {"1": (640, 480), "2": (640, 480)}
    export(Export(rig(**sizes)), "easymocap", tmp_path)
    recognise(monkeypatch, intri="easymocap")
    found, notes = find(tmp_path, **sizes)
    assert (focals(found), notes, {one.table for one in found.values()}) == ({"1": 500.0, "2": 510.0}, [], {None})
    path = tmp_path / "intri.yml"
    path.write_text("".join(line for line in path.read_text().splitlines(True) if not line.startswith(("H_", "W_"))))
    found, _ = find(tmp_path, **sizes)
    assert all(one.assumed_size for one in found.values())
    assert focals(found) == {"1": 500.0, "2": 510.0}
    found, notes = find(tmp_path, **{"1": (640, 480), "2": (1280, 720)})
    assert not found
    assert any("--size" in note and "passerby import" in note and "-f easymocap" in note for note in notes)


def test_lenses_without_a_camera_of_their_name_are_matched_by_the_number_or_the_image_size(tmp_path, monkeypatch):
    export(Export(rig(**{"20160": SIZES["a"], "20161": SIZES["b"]})), "easymocap", tmp_path)
    recognise(monkeypatch, intri="easymocap")
    found, notes = find(tmp_path, north=SIZES["b"], gate=SIZES["a"])
    assert focals(found) == {"north": 510.0, "gate": 500.0}
    assert sum("by the image size, which no other has" in note for note in notes) == 2
    found, notes = find(tmp_path, **{"view-20160": SIZES["a"], "view-20161": SIZES["b"]})
    assert focals(found) == {"view-20160": 500.0, "view-20161": 510.0}
    assert sum("by the number in its name" in note for note in notes) == 2
    # Lenses that fit several cameras are named and not used.
    alike = tmp_path / "alike"
    export(Export(rig(x=SIZES["a"], y=SIZES["a"])), "easymocap", alike)
    found, notes = find(alike, north=SIZES["a"], gate=SIZES["a"])
    assert not found
    assert any("x, y cannot be matched with the cameras north, gate" in note for note in notes)


def test_one_line_names_what_no_reader_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "calibration"
    place.mkdir()
    for name in ("session.bin", "walk.c3d", "board.jpg", "motive.cal"):
        (place / name).write_bytes(bytes(range(32)))
    (tmp_path / "notes.txt").write_text("a note")

    def refuse(path: Path, given: object) -> Rig:
        raise InputError(f"{path}: is binary: export it as text")

    recognise(monkeypatch, motive=Format("motive", "a binary file", ("Motive",), "file", read=refuse))
    monkeypatch.setattr(lenses, "read_rig_as", lambda name, path, given, lossy: (refuse(path, given), ()))
    found, notes = find(tmp_path, a=SIZES["a"], b=SIZES["b"])
    assert not found
    assert f"not used: {place / 'motive.cal'}: is binary: export it as text" in notes
    (unknown,) = (note for note in notes if "session.bin" in note)
    assert "walk.c3d" in unknown
    assert not any("board.jpg" in note or "notes.txt" in note for note in notes)
