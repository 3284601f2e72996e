"""Order of findings for a reader: causes first, then findings without a cause; equal ones of several cameras are joined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from passerby.common.errors import EvidenceError
from passerby.common.text import merge_numbered
from passerby.findings.finding import Finding, refusal
from passerby.findings.texts import KINDS, problem_of, remedy_of, text_of
from passerby.findings.texts.kinds import RANKS

MOST_SHOWN = 3
"""Number of reasons on a first screen."""


@dataclass(frozen=True)
class Reason:
    """Findings that one sentence states."""

    findings: tuple[Finding, ...]
    """One finding, or equal ones of several cameras."""

    @property
    def problem(self) -> str:
        """The problem, in words."""
        first, others = self.findings[0], self.findings[1:]
        if not others:
            return problem_of(first)
        if KINDS[first.code].common and all(one.values == first.values for one in others):
            return problem_of(first, f"cameras {_listed([one.cameras[0] for one in self.findings])}")
        names = list(dict.fromkeys(name for one in others for name in one.cameras[:1]))
        return f"{problem_of(first)} (likewise camera{'s' if len(names) > 1 else ''} {_listed(names)})"

    @property
    def remedy(self) -> str:
        """The remedy, in words; empty without one."""
        return remedy_of(self.findings[0])

    @property
    def text(self) -> str:
        """Problem and remedy in one sentence."""
        first = self.findings[0]
        if len(self.findings) == 1:
            return text_of(first)
        return text_of(first).replace(problem_of(first), self.problem, 1)


def find_cause(finding: Finding, findings: Sequence[Finding]) -> Finding | None:
    """Return the cause of a finding among the findings; None without one.

    A cause is about one of the finding's cameras, or the cause or the finding is about all cameras.
    """
    rank = KINDS[finding.code].rank
    if rank not in ("lens", "symptom"):
        return None
    least = RANKS.index("motion" if rank == "lens" else "lens")
    causes = (one for one in findings if one.severity != "notice" and _order(one) <= least)
    return next(
        (one for one in causes if not one.cameras or not finding.cameras or set(one.cameras) & set(finding.cameras)), None
    )


def _order(finding: Finding) -> int:
    return RANKS.index(KINDS[finding.code].rank)


def reasons_of(findings: Sequence[Finding]) -> list[Reason]:
    """Return the problems of a rig in the order in which a person should read them.

    Causes come first, each group in the order of the findings. Findings that follow from a cause are left out.
    """
    doubts = [one for one in findings if one.severity != "notice"]
    left = [one for one in doubts if find_cause(one, doubts) is None]
    ordered = sorted(left, key=_order)
    groups: list[list[Finding]] = []
    for one in ordered:
        same = next((group for group in groups if _of_another_camera(one, group)), None)
        if same is None:
            groups.append([one])
        else:
            same.append(one)
    return [Reason(tuple(group)) for group in groups]


def _of_another_camera(finding: Finding, group: Sequence[Finding]) -> bool:
    """Check whether a finding about one camera has the topic of a group of findings about other cameras."""
    return (
        _topic(group[0]) == _topic(finding)
        and len(group[0].cameras) == len(finding.cameras) == 1
        and all(one.cameras != finding.cameras for one in group)
    )


def _topic(finding: Finding) -> tuple[object, ...]:
    """Return the topic of a finding, without its figures: its code, and its explanation."""
    why = finding.values.get("why")
    return finding.code, finding.values.get("what"), why["code"] if isinstance(why, Mapping) else why


def describe_first_reasons(findings: Sequence[Finding], where: str) -> str:
    """Return the reasons on a first screen, in one line; `where` names the place of the others."""
    reasons = reasons_of(findings)
    texts = [" ".join(one.text.split()) for one in reasons[:MOST_SHOWN]]
    left = len(reasons) - len(texts)
    return "; ".join([*texts, *([f"and {left} more: see {where}"] if left > 0 else [])])


def _listed(names: Sequence[str]) -> str:
    """Join names as in a sentence."""
    runs = merge_numbered(names)
    return " and ".join([", ".join(runs[:-1]), runs[-1]]) if len(runs) > 1 else runs[0]


class RefusalError(EvidenceError):
    """The input has no fault, but is not enough for a calibration (exit status 3)."""

    findings: tuple[Finding, ...]
    """Refusals that state what is missing."""

    def __init__(self, findings: Finding | Sequence[Finding], message: str | None = None) -> None:
        """Take one finding or several; the message is the text of the first one unless another is given."""
        each = (findings,) if isinstance(findings, Finding) else tuple(findings)
        self.findings = tuple(replace(finding, severity="refusal") for finding in each)
        texts = tuple(map(text_of, self.findings))
        super().__init__(texts[0] if message is None else message, texts)

    def __reduce__(self) -> tuple[type[RefusalError], tuple[tuple[Finding, ...], str]]:
        # An exception that is sent between processes is made again from its arguments.
        return type(self), (self.findings, str(self))


def findings_of(error: EvidenceError) -> tuple[Finding, ...]:
    """Return the findings of an error; one that has only texts gives `too_little_evidence`."""
    if isinstance(error, RefusalError):
        return error.findings
    return tuple(refusal("too_little_evidence", why=reason) for reason in error.reasons)
