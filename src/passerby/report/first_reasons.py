"""What a person should read first of a calibration, as sentences."""

from __future__ import annotations

from passerby.core.figures import adjusted
from passerby.findings.ranking import MOST_SHOWN, reasons_of
from passerby.interchange.calibration_json import CalibrationDocument
from passerby.report.recommendations import reported_doubts
from passerby.report.usable import good_for


def first_reasons(document: CalibrationDocument) -> list[str]:
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
