"""Files as this release writes them, for all later ones to read: `python tests/releases/make_release.py VERSION`.

Run once for each release; what is there is never written again.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from passerby.cli.main import run

HERE = Path(__file__).parent
SIMULATE = ("--preset", "terrace", "--seed", "970", "--seconds", "16", "--people", "4", "--box-noise", "0.01")


def make_release(folder: Path) -> None:
    """Write a scene and its calibration into a folder that does not exist yet."""
    if folder.exists():
        sys.exit(f"{folder}: is there already: files of a release stay as they are")
    assert run(["simulate", "-o", str(folder / "scene"), *SIMULATE]) == 0
    assert run(["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(folder / "out"), "--no-report"]) == 0
    document = folder / "out" / "calibration.json"
    document.write_text(document.read_text().replace(str(folder.resolve()), "/somewhere"))
    for name in ("truth", "ground_positions.csv", "heights.csv"):
        path = folder / "scene" / name
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


if __name__ == "__main__":
    make_release(HERE / sys.argv[1])
