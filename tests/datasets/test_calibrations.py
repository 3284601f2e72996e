"""Published data sets as they are fetched, made into a scene folder and calibrated: the cameras are those of the truth."""

from functools import partial
from pathlib import Path

import pytest

from passerby.cli.main import run
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig
from support.datasets.cmc import write_cmc
from support.datasets.grids import write_multiviewx, write_wildtrack
from support.datasets.joints import write_panoptic, write_tum

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
    assert len(truth) == len(made.rig)
    found = compare(read_rig(out / "rig.toml"), truth)
    assert found.missing == ()
    assert found.similarity.mean_position_mm is not None
    assert found.similarity.mean_position_mm < most_mm
    assert found.similarity.mean_orientation_deg is not None
    assert found.similarity.mean_orientation_deg < most_deg
