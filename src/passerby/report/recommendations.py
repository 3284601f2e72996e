"""The problems of a calibration, and what to do about them, as the report shows both."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from passerby.findings.finding import Finding
from passerby.findings.ranking import reasons_of
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
