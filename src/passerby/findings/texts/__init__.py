"""The register of all codes of findings; only this package turns findings into sentences.

Each code has a `Kind`: its severities, its meaning, and templates of the sentence and of the remedy. An unknown code, or a
value that a template needs and the finding lacks, raises `KeyError`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from passerby.common.text import list_names
from passerby.findings.finding import Finding
from passerby.findings.texts.association import ASSOCIATION
from passerby.findings.texts.calibration import ALIGNMENT, CALIBRATION, MONITORING
from passerby.findings.texts.input_files import INPUT_FILES, VIDEOS
from passerby.findings.texts.kinds import Fields, Kind, Said, Subject, Template
from passerby.findings.texts.lenses import LENSES
from passerby.findings.texts.solver import GEOPOSE, SOLVER

__all__ = ["KINDS", "Kind", "diagnostic", "problem_of", "remedy_of", "subjects_of", "text_of", "texts_of"]

KINDS: Mapping[str, Kind] = {
    **SOLVER, **LENSES, **GEOPOSE, **ASSOCIATION, **CALIBRATION, **ALIGNMENT, **INPUT_FILES, **VIDEOS, **MONITORING,
}  # fmt: skip
"""Kinds of findings by code, in the order of the stages."""


def text_of(finding: Finding) -> str:
    """Return the sentence of a finding: the problem and, if the sentence has one, the remedy."""
    return _said(finding).text


def texts_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the sentences of findings."""
    return tuple(map(text_of, findings))


def problem_of(finding: Finding, who: str | None = None) -> str:
    """Return the problem without the remedy; `who` replaces the cameras' names."""
    return _said(finding, who).problem


def remedy_of(finding: Finding) -> str:
    """Return the remedy; empty without one."""
    return _said(finding).remedy or KINDS[finding.code].advice


def subjects_of(finding: Finding) -> tuple[Subject, ...]:
    """Return the subjects of a finding other than cameras."""
    subjects = KINDS[finding.code].subjects
    return subjects(finding.values) if callable(subjects) else subjects


def diagnostic(finding: Finding) -> dict[str, Any]:
    """Return a finding as in files: its code, severity, cameras and values, and the texts made from them."""
    return finding.as_value() | {"text": text_of(finding), "remedy": remedy_of(finding)}


def _said(finding: Finding, who: str | None = None) -> Said:
    kind, fields = KINDS[finding.code], _fields(finding, who)
    place = f"{finding.values['place']}: " if "place" in finding.values else ""
    problem, remedy = place + _filled(kind.problem, fields), _filled(kind.remedy, fields)
    joint = _filled(kind.joint, fields)
    return Said(problem, remedy, joint, f"{problem}{joint}{remedy}" if remedy else problem)


def _fields(finding: Finding, who: str | None) -> Fields:
    names = finding.cameras
    listed = list_names(names)
    several = f"camera{'s' if len(names) > 1 else ''} {listed}"
    values = {key: _said(Finding.of_value(one)) if _is_finding(one) else one for key, one in finding.values.items()}
    about = dict(zip(("camera", "second"), names, strict=False))
    who = several if who is None else who
    return {"severity": finding.severity, "names": names, "cameras": listed, "who": who, **about, **values}


def _is_finding(value: Any) -> bool:
    return isinstance(value, Mapping) and "code" in value


def _filled(template: Template, fields: Fields) -> str:
    return template.format_map(fields) if isinstance(template, str) else template(fields)
