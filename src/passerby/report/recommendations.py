"""Problems of a calibration and their remedies, as the report shows them.

What a person should read first of a calibration, as sentences.

What a doubtful rig is still good for, in one line.
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
"""What to do about anything of which nothing better is known."""


@dataclass(frozen=True)
class Point:
    """Something that is wrong or weak, and what to do."""

    problem: str
    remedy: str


@dataclass(frozen=True)
class Reported:
    """A diagnostic of `calibration.json`."""

    cameras: tuple[str, ...]
    """The cameras that it is about."""
    subjects: tuple[str, ...]
    """What else it is about, as of `Kind`."""
    problem: str
    remedy: str
    finding: Finding | None = None
    """None where this Passerby does not know its code."""

    @property
    def point(self) -> Point:
        """As the report shows it."""
        return Point(sentence(self.problem), sentence(self.remedy or FOR_ANY))


def reported_doubts(document: CalibrationDocument) -> list[Reported]:
    """The problems of the rig, by a `calibration.json`; an older Passerby wrote sentences only."""
    if document.diagnostics is None:
        return [Reported((), (), reason, "") for reason in document.reasons]
    return [_reported(row) for row in document.diagnostics if row.severity != "notice"]


def points_of(doubts: Sequence[Reported]) -> list[Point]:
    """The doubts as points, causes first; what follows from a cause is left out, and the same of several cameras is one."""
    known = reasons_of([one.finding for one in doubts if one.finding is not None])
    points = [Point(sentence(one.problem), sentence(one.remedy or FOR_ANY)) for one in known]
    return [*points, *(one.point for one in doubts if one.finding is None)]


def sentence(text: str) -> str:
    """Text with a capital and a full stop; names that begin it keep their spelling."""
    text = " ".join(text.split())
    # A path, as in "videos/north.mp4: ...", is no word.
    first = re.match(r"([^\W\d_]+)[,:;]?(?:\s|$)", text)
    if first is not None and first[1].islower():
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else text + "."


def _reported(row: DiagnosticEntry) -> Reported:
    """A diagnostic as its finding says it, or else as it is written."""
    try:
        finding = Finding.of_value(vars(row))
        subjects, problem, remedy = subjects_of(finding), problem_of(finding), remedy_of(finding)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):  # another Passerby's
        return Reported(row.cameras, (), row.text, row.remedy)
    return Reported(row.cameras, subjects, problem, remedy, finding)


def choose_first_reasons(document: CalibrationDocument) -> list[str]:
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


def good_for(doubts: Sequence[Finding], posed: Sequence[str], measuring: MeasuringFigures | None) -> str:
    """What a doubtful rig can be used for, as a sentence.

    Doubts about the scale or the up direction alone leave the shape of the rig; doubts about some cameras leave the others.

    Args:
        doubts: the evidence against the rig.
        posed: names of the cameras with a pose.
        measuring: how well the rig measures; None where that is unknown.
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
    """How well points and positions are known, where that can be said in metres."""
    if measuring is None or not metres:
        return ", up to the scale" if not metres else ""
    told = [f"points to {measuring.points.median_mm / 10:.0f} cm"]
    if ground and measuring.ground is not None:
        told.append(f"positions on the ground to {measuring.ground.median_mm / 10:.0f} cm")
    return f": {', '.join(told)} (1 sigma)"
