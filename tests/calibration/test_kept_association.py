"""A run that uses the tracklets of the run before it writes what a run in an empty folder writes."""

from pathlib import Path

import numpy as np
import pytest

from passerby.calibration import kept_tracklets
from passerby.cli.main import run
from passerby.interchange.rig_toml import read_rig


@pytest.mark.slow
def test_a_new_length_gives_the_files_of_a_run_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ["--people", "4", "--seconds", "10", "--box-noise", "0.02", "--seed", "713", "--unrelated-ids"]
    assert run(["simulate", "-o", str(tmp_path / "scene"), *options]) == 0
    scene = tmp_path / "scene" / "scene.toml"
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "again")]) in (0, 3)
    truth = read_rig(tmp_path / "scene" / "truth.toml")
    ends = np.mean([camera.centre for camera in truth], axis=0) * [1, 1, 0] + [[-2.0, -2.5, 0.0], [2.0, 2.5, 0.0]]
    marks = ", ".join(f"{name} = {truth[name].project(ends).round(2).tolist()}" for name in truth.names[:2])
    with scene.open("a") as file:
        file.write(f"\n[[scale.lengths]]\nmetres = 6.0\nsd_m = 0.02\npoints = {{ {marks} }}\n")
    used: list[bool] = []
    load = kept_tracklets.KeptTracklets.load

    def counted(self, seen, fps):
        found = load(self, seen, fps)
        used.append(found is not None)
        return found

    monkeypatch.setattr(kept_tracklets.KeptTracklets, "load", counted)
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "again")]) in (0, 3)
    assert used
    assert all(used)
    assert run(["calibrate", str(scene), "-o", str(tmp_path / "new")]) in (0, 3)
    files = [path.relative_to(tmp_path / "new") for path in (tmp_path / "new").rglob("*") if path.is_file()]
    assert Path("rig.toml") in files
    for path in files:
        assert (tmp_path / "again" / path).read_bytes() == (tmp_path / "new" / path).read_bytes(), path
