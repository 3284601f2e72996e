"""What counts as a run's result on a machine that fails."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from passerby.calibration.kept_tracklets import FOLDER
from passerby.scene.video_inputs import KEPT_FOLDER


def test_what_is_kept_for_the_next_run_is_no_result(bench: Callable[[str], ModuleType], tmp_path: Path) -> None:
    """A run that is killed after it was written has changed nothing that a reader sees."""
    results = ("rig.toml", "tracks/C1.txt", f"{FOLDER}.txt", f"tracks/{FOLDER}/C1.txt")
    for name in (*results, f"{FOLDER}/a.npz", f"{KEPT_FOLDER}/C1/boxes-a/0.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    assert bench("reliability.machine").tree(tmp_path) == {name: name.encode() for name in results}
