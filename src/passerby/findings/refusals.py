"""Too little evidence, with the findings that say what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from passerby.common.errors import EvidenceError
from passerby.findings.finding import Finding, refusal
from passerby.findings.texts import text_of


class RefusalError(EvidenceError):
    """The input is sound, but too little for a calibration (exit status 3)."""

    findings: tuple[Finding, ...]
    """What is missing."""

    def __init__(self, findings: Finding | Sequence[Finding], message: str | None = None) -> None:
        """Of one finding or several; the message is the text of the first one unless another is given."""
        each = (findings,) if isinstance(findings, Finding) else tuple(findings)
        self.findings = tuple(replace(finding, severity="refusal") for finding in each)
        texts = tuple(map(text_of, self.findings))
        super().__init__(texts[0] if message is None else message, texts)

    def __reduce__(self) -> tuple[type[RefusalError], tuple[tuple[Finding, ...], str]]:
        # Between processes an exception is made anew from its arguments.
        return type(self), (self.findings, str(self))


def findings_of(error: EvidenceError) -> tuple[Finding, ...]:
    """The findings of an error, also of one that has only words."""
    if isinstance(error, RefusalError):
        return error.findings
    return tuple(refusal("too_little_evidence", why=reason) for reason in error.reasons)
