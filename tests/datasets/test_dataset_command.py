"""`passerby dataset`: scene folders that calibrate to the true cameras, what is printed, what is refused."""

import csv
import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.datasets import READERS
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.perception.video import VideoReader
from support.datasets import tsai as tsai_sets
from support.datasets.cmc import write_cmc
from support.datasets.grids import write_multiviewx, write_wildtrack
from support.datasets.joints import write_panoptic, write_tum


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return tsai_sets.write_epfl(tmp_path_factory.mktemp("epfl"))


@pytest.mark.slow
def test_a_sequence_becomes_a_scene_that_calibrates(sequence, tmp_path, capsys):
    scene, out = tmp_path / "scene", tmp_path / "rig"
    assert run(["dataset", "epfl", str(sequence), "-o", str(scene)]) == 0
    told = capsys.readouterr().out
    assert "terrace1: 4 cameras, 7 people" in told
    assert f"passerby check {scene}/scene.toml" in told
    assert run(["check", str(scene / "scene.toml")]) == 0
    assert run(["calibrate", str(scene / "scene.toml"), "-o", str(out)]) == 0
    errors = compare(read_rig(out / "rig.toml"), read_rig(scene / "truth.toml"))
    similarity = errors.similarity.position_mm
    assert len(similarity) == 4
    assert max(similarity.values()) < 60  # 30 mm measured: of a box, three points are redrawn through the other lens
    assert abs(errors.scale_ratio - 1) < 0.05
    assert all(camera.pose is None for camera in read_rig(scene / "intrinsics.toml"))


def test_scene_of_boxes_and_scene_of_videos(sequence, tmp_path, capsys, monkeypatch):
    # Keypoints would do with a second; no network for them can be fetched.
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    assert run(["dataset", "epfl", str(sequence), "-o", str(tmp_path / "scene")]) == 0
    scene = tomllib.loads((tmp_path / "scene" / "scene.toml").read_text())
    assert (scene["association"]["mode"], scene["scene"]) == ("given", {"name": "terrace1", "fps": 5.0})
    videos = tomllib.loads((tmp_path / "scene" / "videos.toml").read_text())
    assert videos["association"]["mode"] == "combined"
    assert videos["cameras"]["c1"]["video"] == str(sequence / "terrace1-c1.avi")
    # The videos of the tests last a second: they are sound, but nobody can be followed in them.
    assert run(["check", str(tmp_path / "scene" / "videos.toml")]) == 3
    assert "too short to register cameras by how people walk" in capsys.readouterr().err
    with (tmp_path / "scene" / "ground_positions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["frame", "id", "x_m", "y_m"]
    assert len(rows) > 100


@pytest.mark.slow
def test_pictures_are_filmed_where_identities_are_to_be_found(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    recording = tsai_sets.write_pets(tmp_path / "set", views=False, pictures=9)
    scene = tmp_path / "scene"
    assert run(["dataset", "pets2009", str(recording), "-o", str(scene)]) == 0
    assert run(["check", str(scene / "scene.toml")]) == 3
    assert "too short to register cameras by how people walk" in capsys.readouterr().err
    reader = VideoReader(scene / "videos" / "View_003.mp4")
    levels = [float(frame.picture.mean()) for frame in reader]
    assert reader.info.average_fps == 7.0
    assert np.allclose(levels, 90 + np.arange(9), atol=2.0)
    assert len(read_boxes(scene / "truth" / "View_001.txt")) == len(tsai_sets.boxes(next(iter(tsai_sets.cameras()))))
    assert len((scene / "pictures.csv").read_text().splitlines()) == 1 + 4 * 9


def test_the_same_folder_gives_the_same_files_and_replaces_them(sequence, tmp_path):
    def files(folder):
        return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    assert run(["dataset", "epfl", str(sequence), "-o", str(tmp_path / "scene")]) == 0
    first = files(tmp_path / "scene")
    (tmp_path / "scene" / "old.txt").write_text("of an earlier run")
    assert run(["dataset", "epfl", str(sequence), "-o", str(tmp_path / "scene")]) == 0
    assert files(tmp_path / "scene") == first


def test_lists_the_sets(capsys):
    assert run(["dataset"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed and reader.where in listed for name, reader in READERS.items())
    assert (run(["dataset", "--list"]), capsys.readouterr().out) == (0, listed)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["wildtrac", "{set}", "-o", "{new}"], "no data set is called 'wildtrac': did you mean 'wildtrack'?"),
        (["epfl", "{set}/none", "-o", "{new}"], "no such folder"),
        (["epfl", "{set}"], "give the scene folder to write"),
        (["epfl"], "give the folder of its files"),
        (["epfl", "{set}", "-o", "{set}/scene"], "lies in the folder of the data set"),
        (["epfl", "{set}", "-o", "{full}"], "holds something other than a scene made from a data set"),
        (["pets2009", "{set}", "-o", "{new}"], "holds no calibrations View_00N.xml"),
    ],
)
def test_what_cannot_be_is_one_line_and_status_2(sequence, tmp_path, capsys, arguments, said):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    places = {"set": sequence, "new": tmp_path / "new", "full": tmp_path / "full"}
    assert run(["dataset", *(argument.format(**places) for argument in arguments)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert (error.count("\n"), sorted(path.name for path in tmp_path.iterdir())) == (1, ["full"])
    assert (tmp_path / "full" / "letter.txt").read_text() == "mine"


LARGE = {"frames": 30, "people": 12, "pictures": 0}
SETS = {
    # Keypoints are rounded at most. Measured: 0.0095 mm and 0.00007 degrees.
    "panoptic": (write_panoptic, 0.1, 0.001),
    # Measured: 0.0019 mm and 0.00004 degrees.
    "campus": (write_tum, 0.1, 0.001),
    # Boxes have whole pixels, rounded down, and end below the middle of a cylinder, not below its nearest edge.
    # Measured: 11.0 mm and 0.071 degrees.
    "wildtrack": (partial(write_wildtrack, **LARGE), 20, 0.12),
    # Measured: 9.8 mm and 0.072 degrees.
    "multiviewx": (partial(write_multiviewx, **LARGE), 20, 0.12),
    # Square cylinders, seen from above at 3 to 6 m, are no people: half as wide and half as fast, as giants would be; but
    # boxes do not reach beyond head and feet. Measured: 25.6 mm and 0.52 degrees.
    "cmc": (write_cmc, 35, 0.7),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_from_the_published_files_to_a_calibration(name: str, tmp_path: Path) -> None:
    write, most_mm, most_deg = SETS[name]
    folder, scene, out = (tmp_path / part for part in ("CMC1", "scene", "out"))
    made = write(folder)
    assert run(["dataset", name, str(folder), "-o", str(scene)]) == 0
    assert run(["calibrate", str(scene / "scene.toml"), "-o", str(out)]) == 0
    truth = read_rig(scene / "truth.toml")
    found = compare(read_rig(out / "rig.toml"), truth)
    assert (len(truth), found.missing) == (len(made.rig), ())
    assert found.similarity.mean_position_mm < most_mm
    assert found.similarity.mean_orientation_deg < most_deg
