"""What a calibration found, as the page shows it: verdict, reasons, and a row for each camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.core.figures import adjusted
from passerby.core.lens_figures import LensFigures
from passerby.findings.ranking import MOST_SHOWN, reasons_of
from passerby.interchange.calibration_json import CALIBRATION_FILE, CalibrationDocument, parse_document, read_document
from passerby.report.recommendations import reported_doubts
from passerby.report.usable import good_for


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
        "reasons": _reasons(document),
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


def _reasons(document: CalibrationDocument) -> list[str]:
    """What a person should read first, and what a doubtful rig is still good for."""
    doubts = reported_doubts(document)
    known = [one.finding for one in doubts if one.finding is not None]
    texts = [*(one.text for one in reasons_of(known)), *(one.problem for one in doubts if one.finding is None)]
    more = len(texts) - MOST_SHOWN
    texts = [*texts[:MOST_SHOWN], *([f"and {more} more: see the report"] if more > 0 else [])]
    if document.verdict == "doubtful" and known:
        posed = [one.name for one in document.cameras if one.registered is not False]
        texts.append(good_for(known, posed, adjusted(document.figures).measuring))
    return texts


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
