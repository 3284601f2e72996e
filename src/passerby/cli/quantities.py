"""Lengths and times on the command line."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from passerby.common.errors import InputError

METRES: Mapping[str, float] = {"mm": 0.001, "cm": 0.01, "m": 1.0}
SECONDS: Mapping[str, float] = {"s": 1.0, "min": 60.0, "h": 3600.0}


def parse_length(text: str, option: str) -> float:
    """Return the metres of a text such as "5cm". Raises `InputError` that names the option."""
    return _parse(text, METRES, option, "a length above 0, such as 5cm")


def parse_seconds(text: str, option: str) -> float:
    """Return the seconds of a text such as "2min". Raises `InputError` that names the option."""
    return _parse(text, SECONDS, option, "a time above 0, such as 2min")


def _parse(text: str, units: Mapping[str, float], option: str, wanted: str) -> float:
    found = re.fullmatch(rf"\s*(\d+(?:\.\d+)?|\.\d+)\s*({'|'.join(units)})\s*", text)
    value = float(found[1]) * units[found[2]] if found else 0.0
    if not (value > 0 and math.isfinite(value)):
        raise InputError(f"{option} {text}: give {wanted} (units: {', '.join(units)})")
    return value
