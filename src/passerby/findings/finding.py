"""Evidence against a calibration, or an unusual fact about its input, as a value: a code, a severity, cameras and figures.

Stages make findings, and later stages use their code, severity, cameras and values. The sentences that users read are made at
the end, by `passerby.findings.texts`, which has the register of all codes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["notice", "doubt", "refusal"]
"""notice: unusual, without effect on the verdict; doubt: no rig with it is accepted; refusal: a reason why there is no rig."""


@dataclass(frozen=True)
class Finding:
    """One finding."""

    code: str
    """Kind of the finding, a key of `texts.KINDS`."""
    severity: Severity
    cameras: tuple[str, ...] = ()
    """The cameras that it is about, the most important one first; empty if it is about the whole."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """JSON-ready values. `place`, if present, is the file, or the table in it, that the finding is about."""

    def says_same(self, other: Finding) -> bool:
        """Check whether the other finding is the same, except for its severity."""
        return (self.code, self.cameras, self.values) == (other.code, other.cameras, other.values)

    def as_value(self) -> dict[str, Any]:
        """Return the finding as a JSON-ready value, which another finding may have among its values, as its cause."""
        return {"code": self.code, "severity": self.severity, "cameras": list(self.cameras), "values": dict(self.values)}

    @classmethod
    def of_value(cls, value: Mapping[str, Any]) -> Finding:
        """Return the finding of a value from `as_value`. Raises `KeyError` if a key is missing."""
        return cls(value["code"], value["severity"], tuple(value["cameras"]), dict(value["values"]))


def notice(code: str, *cameras: str, **values: Any) -> Finding:
    """Make a notice: an unusual fact without effect on the verdict."""
    return Finding(code, "notice", cameras, values)


def doubt(code: str, *cameras: str, **values: Any) -> Finding:
    """Make a doubt: a rig with it is not accepted."""
    return Finding(code, "doubt", cameras, values)


def refusal(code: str, *cameras: str, **values: Any) -> Finding:
    """Make a refusal: a reason why there is no rig."""
    return Finding(code, "refusal", cameras, values)
