"""What a calibration found, as the page shows it: verdict, reasons, and a row for each camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.interchange.calibration_json import CALIBRATION_FILE, CalibrationDocument, parse_document, read_document


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
    return {
        "verdict": document.verdict,
        "reasons": list(document.reasons),
        "findings": list(document.findings),
        "cameras": [
            {
                "name": one.name,
                "centre_m": None if one.centre_m is None else list(one.centre_m),
                "heading_deg": one.heading_deg,
                "tilt_deg": one.tilt_deg,
                "position_sigma_mm": one.position_sigma_mm,
                "orientation_sigma_deg": one.orientation_sigma_deg,
                "time_offset_s": one.time_offset_s,
            }
            for one in document.cameras
        ],
    }
