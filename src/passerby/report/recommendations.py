"""Problems of a calibration and their remedies, as the report shows them.

The module also selects the most important problems as sentences, and describes in one line what a doubtful rig can be used for.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from passerby.common.text import list_names
from passerby.core.figures import adjusted
from passerby.core.measuring import MeasuringFigures
from passerby.findings.finding import Finding
from passerby.findings.ranking import MOST_SHOWN, reasons_of
from passerby.findings.texts import problem_of, remedy_of, subjects_of
from passerby.interchange.calibration_json import CalibrationDocument, DiagnosticEntry

FOR_ANY = "run passerby check on the scene file, and record more people walking where the views overlap"
"""Remedy of a problem without a specific remedy."""


@dataclass(frozen=True)
class Point:
    """A problem or a weakness, and its remedy."""

    problem: str
    remedy: str


@dataclass(frozen=True)
class Reported:
    """A diagnostic of `calibration.json`."""

    cameras: tuple[str, ...]
    """Cameras that it concerns."""
    subjects: tuple[str, ...]
    """Other subjects that it concerns, as in `Kind`."""
    problem: str
    remedy: str
    finding: Finding | None = None
    """None if this version of Passerby does not know its code."""

    @property
    def point(self) -> Point:
        """Problem and remedy as full sentences, as the report shows them."""
        return Point(sentence(self.problem), sentence(self.remedy or FOR_ANY))


def reported_doubts(document: CalibrationDocument) -> list[Reported]:
    """Return the problems of the rig from `calibration.json`; older versions of Passerby wrote only sentences."""
    if document.diagnostics is None:
        return [Reported((), (), reason, "") for reason in document.reasons]
    return [_reported(row) for row in document.diagnostics if row.severity != "notice"]


def points_of(doubts: Sequence[Reported]) -> list[Point]:
    """Return doubts as points, causes first; consequences of causes are left out, equal doubts about several cameras merged."""
    known = reasons_of([one.finding for one in doubts if one.finding is not None])
    points = [Point(sentence(one.problem), sentence(one.remedy or FOR_ANY)) for one in known]
    return [*points, *(one.point for one in doubts if one.finding is None)]


def sentence(text: str) -> str:
    """Return text with an initial capital and a full stop; a name at its beginning keeps its spelling."""
    text = " ".join(text.split())
    # A path, as in "videos/north.mp4: ...", is not a word and gets no capital.
    first = re.match(r"([^\W\d_]+)[,:;]?(?:\s|$)", text)
    if first is not None and first[1].islower():
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else text + "."


def _reported(row: DiagnosticEntry) -> Reported:
    """Return a diagnostic with the texts of its finding, or with its written texts if its code is unknown."""
    try:
        finding = Finding.of_value(vars(row))
        subjects, problem, remedy = subjects_of(finding), problem_of(finding), remedy_of(finding)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):  # written by another version of Passerby
        return Reported(row.cameras, (), row.text, row.remedy)
    return Reported(row.cameras, subjects, problem, remedy, finding)


def choose_first_reasons(document: CalibrationDocument) -> list[str]:
    """Return the most important problems as sentences, and for a doubtful rig what it can still be used for."""
    doubts = reported_doubts(document)
    known = [one.finding for one in doubts if one.finding is not None]
    texts = [*(one.text for one in reasons_of(known)), *(one.problem for one in doubts if one.finding is None)]
    more = len(texts) - MOST_SHOWN
    texts = [*texts[:MOST_SHOWN], *([f"and {more} more: see the report"] if more > 0 else [])]
    if document.verdict == "doubtful" and known:
        posed = [one.name for one in document.cameras if one.registered is not False]
        texts.append(good_for(known, posed, adjusted(document.figures).measuring))
    return texts


def good_for(doubts: Sequence[Finding], posed: Sequence[str], measuring: MeasuringFigures | None) -> str:
    """Describe what a doubtful rig can be used for, as a sentence.

    Doubts about only the scale or the up direction leave the shape of the rig usable. Doubts about some cameras leave the
    other cameras usable.

    Args:
        doubts: the evidence against the rig.
        posed: names of the cameras with a pose.
        measuring: the rig's measuring accuracy; None if unknown.
    """
    causes = [one for reason in reasons_of(doubts) for one in reason.findings]
    about_shape = [one for one in causes if not subjects_of(one)]
    named = {name for one in about_shape for name in one.cameras}
    sound = [name for name in posed if name not in named]
    if any(not one.cameras for one in about_shape) or (named and len(sound) < 2):
        return "Still good for the rough layout of the cameras and for counting people."
    subjects = {subject for one in causes for subject in subjects_of(one)}
    lacks = [{"scale": "the scale", "vertical": "the up direction and the ground"}[one] for one in sorted(subjects)]
    who = f"what cameras {list_names(sound)} see" if named else "what the cameras see"
    text = f"Still good for {who}{_figures(measuring, ground='vertical' not in subjects, metres='scale' not in subjects)}"
    return f"{text}; not for {' and '.join(lacks)}." if lacks else f"{text}."


def _figures(measuring: MeasuringFigures | None, *, ground: bool, metres: bool) -> str:
    """Write the sigmas of points and ground positions, if the scale is known."""
    if measuring is None or not metres:
        return ", up to the scale" if not metres else ""
    told = [f"points to {measuring.points.median_mm / 10:.0f} cm"]
    if ground and measuring.ground is not None:
        told.append(f"positions on the ground to {measuring.ground.median_mm / 10:.0f} cm")
    return f": {', '.join(told)} (1 sigma)"
