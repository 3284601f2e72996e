"""What a calibration found, as the page shows it: verdict, reasons, and a row for each camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.core.figures import adjusted
from passerby.core.lens_figures import LensFigures
from passerby.interchange.calibration_json import CALIBRATION_FILE, CalibrationDocument, parse_document, read_document
from passerby.report.recommendations import first_reasons


def outcome(folder: Path, kept: dict[str, Any] | None = None) -> dict[str, Any] | None:
    """The outcome of the calibration in a folder, or of one whose document was kept; None where there is none to be read."""
    try:
        if kept is not None:
            document = parse_document(json.dumps(kept))
        elif (folder / CALIBRATION_FILE).is_file():
            document = read_document(folder)
        else:
            return None
    except InputError:
        return None
    return _told(document)


def _told(document: CalibrationDocument) -> dict[str, Any]:
    lenses = adjusted(document.figures).lenses
    return {
        "verdict": document.verdict,
        "reasons": first_reasons(document),
        "findings": list(document.findings),
        "cameras": [
            {
                "name": one.name,
                "centre_m": None if one.centre_m is None else list(one.centre_m),
                "heading_deg": one.heading_deg,
                "tilt_deg": one.tilt_deg,
                "points_sigma_mm": one.points_sigma_mm,
                "ground_sigma_mm": one.ground_sigma_mm,
                "position_sigma_mm": one.position_sigma_mm,
                "orientation_sigma_deg": one.orientation_sigma_deg,
                "time_offset_s": one.time_offset_s,
                "time_offset_sigma_s": one.time_offset_sigma_s,
                "fps": one.fps,
                "registered": one.registered is not False,
                **_focal(lenses.get(one.name)),
                **_about(document, one.name),
            }
            for one in document.cameras
        ],
    }


def _focal(lens: LensFigures | None) -> dict[str, float | None]:
    """A focal length that was estimated, pixels; None where it was taken as stated."""
    focal = None if lens is None else lens.focal
    return {
        "focal_px": None if focal is None else focal.refined_px,
        "focal_sigma_px": None if focal is None else focal.sigma_px,
    }


def _about(document: CalibrationDocument, name: str) -> dict[str, list[str]]:
    """What the calibration says of one camera: problems, and warnings that change no verdict.

    It stands beside every camera that it names; what names all cameras stands at the top alone, with `reasons` and `findings`.
    """
    everywhere = {one.name for one in document.cameras}
    own = [one for one in document.diagnostics or () if name in one.cameras and not everywhere <= set(one.cameras)]
    return {
        "problems": [one.text for one in own if one.severity != "notice"],
        "warnings": [one.text for one in own if one.severity == "notice"],
    }
