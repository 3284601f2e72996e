"""What contradicts a calibration, or is odd about its input, as a value: a code, a severity, cameras and figures.

Stages make findings, and later stages decide by code, severity, cameras and values. The sentences that people read are made at
the end, by `passerby.findings.texts`, which has the register of all codes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["notice", "doubt", "refusal"]
"""notice: odd, but it stops nothing; doubt: no rig is accepted with it; refusal: why there is no rig."""


@dataclass(frozen=True)
class Finding:
    """One finding."""

    code: str
    """What is found, a key of `texts.KINDS`."""
    severity: Severity
    cameras: tuple[str, ...] = ()
    """The cameras that it is about, the first one foremost; empty where it is about the whole."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """JSON-ready. `place`, where there is one, is the file or the table of it that the finding is about."""

    def says_same(self, other: Finding) -> bool:
        """Whether the other says the same, however much either weighs."""
        return (self.code, self.cameras, self.values) == (other.code, other.cameras, other.values)

    def as_value(self) -> dict[str, Any]:
        """JSON-ready; as such it can be among the values of another finding, as its cause."""
        return {"code": self.code, "severity": self.severity, "cameras": list(self.cameras), "values": dict(self.values)}

    @classmethod
    def of_value(cls, value: Mapping[str, Any]) -> Finding:
        """The finding that `as_value` made the value of. Raises `KeyError` where it lacks something."""
        return cls(value["code"], value["severity"], tuple(value["cameras"]), dict(value["values"]))


def notice(code: str, *cameras: str, **values: Any) -> Finding:
    """Something odd that stops nothing."""
    return Finding(code, "notice", cameras, values)


def doubt(code: str, *cameras: str, **values: Any) -> Finding:
    """Something that lets no rig be accepted."""
    return Finding(code, "doubt", cameras, values)


def refusal(code: str, *cameras: str, **values: Any) -> Finding:
    """A reason why there is no rig."""
    return Finding(code, "refusal", cameras, values)
