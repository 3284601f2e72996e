"""Beside which camera the page shows what a calibration found."""

from __future__ import annotations

from pathlib import Path

from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, DiagnosticEntry, write_document
from passerby.page.session import outcome


def test_a_finding_stands_beside_every_camera_that_it_names_and_one_of_all_cameras_at_the_top(tmp_path: Path) -> None:
    said = {"alone": ("B",), "pair": ("A", "B"), "all": ("A", "B", "C"), "scene": ()}
    told = tuple(DiagnosticEntry(code="x", severity="doubt", cameras=names, text=text) for text, names in said.items())
    cameras = tuple(CameraEntry(name=name) for name in "ABC")
    write_document(tmp_path, CalibrationDocument(verdict="doubtful", reasons=tuple(said), diagnostics=told, cameras=cameras))
    found = outcome(tmp_path)
    assert {one["name"]: one["problems"] for one in found["cameras"]} == {"A": ["pair"], "B": ["alone", "pair"], "C": []}
    assert found["reasons"] == [*list(said)[:3], "and 1 more: see the report"]
