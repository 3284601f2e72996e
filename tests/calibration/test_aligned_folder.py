"""An output folder in another frame of the world: nothing of the old one stays in it."""

from pathlib import Path

import pytest

from passerby.calibration.alignment.folder import write_aligned
from passerby.calibration.alignment.world import align_to_camera
from passerby.interchange.output_folder import read_output
from support.scenes.output_folders import written_output


def test_parts_of_a_report_that_the_user_deleted_go_with_the_old_frame(tmp_path: Path) -> None:
    out = written_output(tmp_path)
    part = out / "report_files" / "0123456789abcdef" / "camera.js"
    part.parent.mkdir(parents=True)
    part.write_text("of the old frame")
    write_aligned(out, out, align_to_camera(read_output(out).rig, "B"))
    assert not (out / "report_files").exists()
    assert read_output(out).rig["B"].pose is not None


@pytest.mark.parametrize("name", ["out", "new"])
def test_the_report_is_made_again_in_the_new_frame(tmp_path: Path, name: str) -> None:
    """In place, or in a new folder; where there was none, none is made."""
    out = written_output(tmp_path, report=True)
    (out / "report.html").write_text("of the old frame")
    aligned = align_to_camera(read_output(out).rig, "B")
    write_aligned(out, tmp_path / name, aligned)
    page = (tmp_path / name / "report.html").read_text(encoding="utf-8")
    assert "camera B" in page
    assert "of the old frame" not in page
    (tmp_path / name / "report.html").unlink()
    write_aligned(tmp_path / name, tmp_path / "third", aligned)
    assert not (tmp_path / "third" / "report.html").exists()
