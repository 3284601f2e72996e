"""The register of all codes of findings, and the one place where findings become sentences.

Each code has a `Kind`: the severities it occurs with, what it means, and templates of the sentence and of the remedy. An
unknown code, or a value that a template needs and the finding lacks, raises `KeyError`.
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
"""By code, in the order of the stages."""


def text_of(finding: Finding) -> str:
    """The sentence of a finding: what is the matter and, where the sentence says so, what to do."""
    return _said(finding).text


def texts_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The sentences of findings."""
    return tuple(map(text_of, findings))


def problem_of(finding: Finding, who: str | None = None) -> str:
    """What is the matter, without what to do; `who` stands in place of the cameras' names."""
    return _said(finding, who).problem


def remedy_of(finding: Finding) -> str:
    """What to do; empty where nothing is."""
    return _said(finding).remedy or KINDS[finding.code].advice


def subjects_of(finding: Finding) -> tuple[Subject, ...]:
    """What a finding is about besides cameras."""
    subjects = KINDS[finding.code].subjects
    return subjects(finding.values) if callable(subjects) else subjects


def diagnostic(finding: Finding) -> dict[str, Any]:
    """A finding as files hold it: its code, severity, cameras and values, and the texts made from them."""
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
